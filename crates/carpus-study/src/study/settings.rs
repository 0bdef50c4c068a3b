//! `study.toml`: what was measured, how the trial files are named inside, and what personalization may change.

use std::path::{Path, PathBuf};

use super::column_settings::{columns, warn_of_units};
use super::columns::{Columns, FurtherMoment};
use super::emg_recorder::{self, EmgRecorder};
use super::fault::Fault;
use super::imaging_settings::ImagingSettings;
use super::posture::{PostureCoordinate, radian_evidence};
use super::problem::{Problem, Severity};
use super::processing::settings::{self as processing, ProcessingSettings};
use super::raw_emg::{self, EmgSignal};
use super::scaling::{self, ScalingSettings, StrengthSettings};
use super::toml_section::Sections;
use carpus_numerics::plausible::{self, Doubt};

/// Bounds of table 3.2 of Jadelis (2025): three standard deviations of Lieber et al. (1990)
/// and Loren & Lieber (1995) for the lengths, the span of wrist moments of Holzbaur et al. (2007) for force.
const DEFAULT_BOUNDS_PERCENT: [(&str, [f64; 2]); 3] = [
    ("optimal_fiber_length", [82.2, 117.8]),
    ("tendon_slack_length", [86.8, 113.2]),
    ("max_isometric_force", [42.0, 251.4]),
];

/// Everything `study.toml` says.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Name of the study.
    pub name: String,
    /// The model of all participants that name none of their own.
    pub model: PathBuf,
    /// Line that names the model.
    pub model_line: usize,
    /// Folder that the files of `trials.csv` are relative to; empty: that of the study.
    pub recordings: PathBuf,
    /// The dynamometer.
    pub dynamometer: Dynamometer,
    /// Coordinates held in every trial.
    pub posture: Vec<PostureCoordinate>,
    /// Muscles that EMG drives, in the order of the file; all others are disabled.
    pub active_muscles: Vec<String>,
    /// Line that lists the active muscles.
    pub active_line: usize,
    /// A recorder of its own that the EMG is from.
    pub emg_recorder: Option<EmgRecorder>,
    /// What the EMG columns hold.
    pub emg: EmgSignal,
    /// Names of the columns of trial files.
    pub columns: Columns,
    /// How far personalization may go.
    pub bounds: ParameterBounds,
    /// What happens to recordings before they are trials; only `carpus dynamometer` does it.
    pub processing: ProcessingSettings,
    /// How the study's model becomes a participant's; `None` if the study does not say.
    pub scaling: Option<ScalingSettings>,
    /// How forces are scaled to maximum voluntary moments.
    pub strength: StrengthSettings,
    /// How imaging is compared with a model.
    pub imaging: ImagingSettings,
    /// Largest time step allowed in a trial \[s\]; `None`: five median steps.
    pub max_gap: Option<f64>,
    /// Files that define effects beside the catalogue.
    pub own_effects: Vec<PathBuf>,
    /// Line that lists them.
    pub own_effects_line: usize,
}

/// The machine that measures the moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Dynamometer {
    /// OpenSim coordinate about which it measures; the moment is positive in the coordinate's positive direction.
    pub coordinate: String,
    /// Line that names the coordinate.
    pub coordinate_line: usize,
    /// Viscous drag of the machine itself [N·m·s/rad], ≥ 0.
    pub damping: f64,
    /// What the simulated moment sums.
    pub include: Vec<MomentPart>,
}

impl Dynamometer {
    /// Whether the simulated moment contains this part.
    pub fn includes(&self, part: MomentPart) -> bool {
        self.include.contains(&part)
    }
}

/// A part of the moment about the dynamometer's coordinate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MomentPart {
    /// Active muscles.
    Muscles,
    /// Forces of the model that are not muscles (limits, springs, bushings, ligaments).
    Passive,
    /// Weight of the moving segments.
    Gravity,
    /// Inertia of the moving segments.
    Inertia,
}

/// Bounds of one parameter as fractions of the scaled model's value (1 = unchanged).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RelativeBounds {
    /// Least allowed fraction.
    pub lower: f64,
    /// Greatest allowed fraction.
    pub upper: f64,
}

/// Bounds of the muscle parameters that personalization changes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ParameterBounds {
    /// Optimal fibre length.
    pub optimal_fiber_length: RelativeBounds,
    /// Tendon slack length.
    pub tendon_slack_length: RelativeBounds,
    /// Maximum isometric force.
    pub max_isometric_force: RelativeBounds,
}

impl Default for ParameterBounds {
    fn default() -> Self {
        let bounds = DEFAULT_BOUNDS_PERCENT
            .map(|(_, [lower, upper])| RelativeBounds { lower: lower / 100.0, upper: upper / 100.0 });
        Self { optimal_fiber_length: bounds[0], tendon_slack_length: bounds[1], max_isometric_force: bounds[2] }
    }
}

impl Settings {
    /// Reads the text of a `study.toml`. Problems go to `problems`; `None` if a part without default is unusable.
    /// Beside the settings: whether muscles and columns were read without an error, so that trial files can be judged.
    pub(crate) fn parse(text: &str, file: &Path, problems: &mut Vec<Problem>) -> Option<(Settings, bool)> {
        let sections = Sections::parse(text, file, problems)?;
        let mut study = sections.section("study");
        let name = study.required_string("name", "the study's name");
        let model = study.required_string("model", "path of the .osim model");
        let model_line = study.line_of("model");
        let recordings = study.optional_string("recordings").map(PathBuf::from).unwrap_or_default();
        study.finish(problems);

        let (dynamometer, further_moments) = dynamometer(&sections, file, problems);
        let posture = posture(&sections, dynamometer.as_ref().map(|d| d.coordinate.as_str()), file, problems);

        let before = problems.len();
        let mut muscles = sections.section("muscles");
        let active = muscles.required_strings("active", "list of the muscles that EMG drives");
        let active_line = muscles.line_of("active");
        muscles.finish(problems);

        let (mut columns, lines) = columns(&sections, active.as_deref().unwrap_or_default(), problems);
        columns.further_moments = further_moments;
        let columns_sound = problems[before..].iter().all(|problem| problem.severity != Severity::Error);
        let emg = raw_emg::settings(&sections, problems);
        let emg_recorder = emg_recorder::settings(&sections, problems);
        let bounds = bounds(&sections, file, problems);
        let processing = processing::settings(&sections, problems);
        let scaling = scaling::linear(&sections, file, problems);
        let strength = scaling::strength(&sections, active.as_deref().unwrap_or_default(), problems);
        let imaging = ImagingSettings::parse(&sections, problems);

        let mut checks = sections.section("checks");
        let max_gap = checks.optional_number("max_gap_s", "a positive number of seconds", |v| v > 0.0);
        checks.finish(problems);

        let mut effects = sections.section("effects");
        let own = effects.optional_strings("own", "list of files that define effects").unwrap_or_default();
        let own_effects_line = effects.line_of("own");
        effects.finish(problems);

        sections.report_unknown(problems);
        let settings = Settings {
            name: name?,
            model: PathBuf::from(model?),
            model_line,
            recordings,
            dynamometer: dynamometer?,
            posture,
            active_muscles: active?,
            active_line,
            emg,
            emg_recorder,
            columns,
            bounds,
            processing,
            scaling,
            strength,
            imaging,
            max_gap,
            own_effects: own.into_iter().map(PathBuf::from).collect(),
            own_effects_line,
        };
        let recorder_time = settings.emg_recorder.as_ref().and_then(|recorder| recorder.time.as_deref());
        warn_of_units(&settings.columns, &settings.emg, recorder_time, &lines, file, problems);
        Some((settings, columns_sound))
    }
}

fn dynamometer(
    sections: &Sections<'_>,
    file: &Path,
    problems: &mut Vec<Problem>,
) -> (Option<Dynamometer>, Vec<FurtherMoment>) {
    let mut section = sections.section("dynamometer");
    let coordinate =
        section.required_string("coordinate", "the OpenSim coordinate whose generalized force is measured");
    let coordinate_line = section.line_of("coordinate");
    let damping = section.optional_number("damping_n_m_s_per_deg", "a number, 0 or more, in N·m·s/deg", |v| v >= 0.0);
    let damping_line = section.line_of("damping_n_m_s_per_deg");
    let parts = [
        ("muscles", MomentPart::Muscles),
        ("passive", MomentPart::Passive),
        ("gravity", MomentPart::Gravity),
        ("inertia", MomentPart::Inertia),
    ];
    let include = section
        .optional_words("include", "part of the moment", &parts)
        .unwrap_or_else(|| vec![MomentPart::Muscles, MomentPart::Passive]);
    let expected = "a table: coordinate = \"column of its moment\"";
    let further = section
        .optional_table("further_moments", expected, |inner| {
            let keys = inner.keys();
            let mut read = |coordinate: String| {
                let (line, column) = (inner.line_of(&coordinate), inner.optional_string(&coordinate)?);
                Some(FurtherMoment { coordinate, column, line })
            };
            keys.into_iter().filter_map(&mut read).collect::<Vec<_>>()
        })
        .unwrap_or_default();
    section.finish(problems);
    for same in further.iter().filter(|f| Some(&f.coordinate) == coordinate.as_ref()) {
        let fault = Fault::BadValue {
            key: same.coordinate.clone(),
            expected: "a coordinate other than the dynamometer's, whose moment has its own column".to_owned(),
            found: format!("`{}`", same.coordinate),
        };
        problems.push(Problem::error(file, same.line, fault));
    }
    // One degree is π/180 rad, so a drag per degree is the larger number per radian.
    if let Some(doubt) = damping.and_then(|damping| plausible::DYNAMOMETER_DAMPING.doubt(damping)) {
        let fault = Fault::Implausible { name: "`damping_n_m_s_per_deg`".to_owned(), doubt };
        problems.push(Problem::warning(file, damping_line, fault));
    }
    let damping = damping.unwrap_or(0.0) / 1f64.to_radians();
    let dynamometer = coordinate.map(|coordinate| Dynamometer { coordinate, coordinate_line, damping, include });
    (dynamometer, further)
}

fn posture(
    sections: &Sections<'_>,
    driven: Option<&str>,
    file: &Path,
    problems: &mut Vec<Problem>,
) -> Vec<PostureCoordinate> {
    let mut section = sections.section("posture_deg");
    let held: Vec<PostureCoordinate> = section
        .all_numbers("degrees (metres for a translation)")
        .into_iter()
        .map(|(coordinate, value_deg_or_m, line)| PostureCoordinate { coordinate, line, value_deg_or_m })
        .collect();
    section.finish(problems);
    for held in &held {
        if Some(held.coordinate.as_str()) == driven {
            problems.push(Problem::error(
                file,
                held.line,
                Fault::BadValue {
                    key: held.coordinate.clone(),
                    expected: "a coordinate other than the dynamometer's, which follows the recorded angle".to_owned(),
                    found: format!("`{}`", held.coordinate),
                },
            ));
        }
        if let Some(evidence) = radian_evidence(held.value_deg_or_m) {
            let fault = Fault::LooksLikeRadians { name: held.coordinate.clone(), evidence };
            problems.push(Problem::warning(file, held.line, fault));
        }
    }
    held
}

fn bounds(sections: &Sections<'_>, file: &Path, problems: &mut Vec<Problem>) -> ParameterBounds {
    let mut section = sections.section("personalization");
    let mut bounds = ParameterBounds::default();
    let plausible = [&plausible::LENGTH_BOUND, &plausible::LENGTH_BOUND, &plausible::FORCE_BOUND];
    for (((key, _), slot), plausible) in DEFAULT_BOUNDS_PERCENT.iter().zip(bounds.each_mut()).zip(plausible) {
        let expected = "[lower, upper] in percent, 0 < lower ≤ upper";
        if let Some([lower, upper]) = section.optional_pair(key, expected, |[a, b]| a > 0.0 && a <= b) {
            *slot = RelativeBounds { lower: lower / 100.0, upper: upper / 100.0 };
            // Only a slip that explains both ends is likely.
            let doubts: Vec<Doubt> = [lower, upper].into_iter().filter_map(|bound| plausible.doubt(bound)).collect();
            let unexplained = doubts.iter().find(|doubt| doubt.slip().is_none());
            if let Some(&doubt) = unexplained.or(doubts.first()) {
                let fault = Fault::Implausible { name: format!("`{key}`"), doubt };
                problems.push(Problem::warning(file, section.line_of(key), fault));
            }
        }
    }
    section.finish(problems);
    bounds
}

impl ParameterBounds {
    /// The bounds in the order of `DEFAULT_BOUNDS_PERCENT`.
    fn each_mut(&mut self) -> [&mut RelativeBounds; 3] {
        [&mut self.optimal_fiber_length, &mut self.tendon_slack_length, &mut self.max_isometric_force]
    }
}
