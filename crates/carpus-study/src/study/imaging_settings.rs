//! `[ultrasound]` of `study.toml`: how imaging is compared with a model.

use super::posture::PostureCoordinate;
use super::problem::Problem;
use super::toml_section::{Sections, TomlSection};

/// Activation of a resting muscle.
const REST_ACTIVATION: f64 = 0.01;
/// Specific tension of the forearm's muscles [N/cm²]: Jacobson et al. (1992), Saul et al. (2015).
const SPECIFIC_TENSION: f64 = 50.8;

/// Scatter of fascicle lengths in repeated images: coefficients of variation up to about 10 % (Kwah et al. 2013,
/// doi:10.1152/japplphysiol.01430.2011).
const FASCICLE_ERROR: f64 = 0.08;

/// How imaging is compared with a model.
#[derive(Clone, Debug, PartialEq)]
pub struct ImagingSettings {
    /// Activation of all muscles while imaged, 0 to 1.
    pub activation: f64,
    /// Force per cross-sectional area [N/m²].
    pub specific_tension: f64,
    /// Coordinates held while imaging, in place of those of `[posture_deg]`.
    pub posture: Vec<PostureCoordinate>,
    /// Coordinates held for one muscle, in place of those above.
    pub muscle_posture: Vec<(String, Vec<PostureCoordinate>)>,
    /// Fibre length over belly length, by muscle.
    pub fiber_to_belly: Vec<(String, f64)>,
    /// External over total tendon length, by muscle.
    pub external_to_total_tendon: Vec<(String, f64)>,
    /// What fascicle lengths are for.
    pub fascicles: FascicleUse,
    /// Standard deviation of a fascicle length about the model's fibre length, as a share of it.
    pub fascicle_error: f64,
    /// Where these numbers are from, as the study says it.
    pub source: Option<String>,
    /// Line of the section.
    pub line: usize,
}

/// What measured fascicle lengths are for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FascicleUse {
    /// A check that no fit sees.
    #[default]
    Check,
    /// Data of a fit.
    Fit,
}

impl Default for ImagingSettings {
    fn default() -> Self {
        ImagingSettings {
            activation: REST_ACTIVATION,
            specific_tension: SPECIFIC_TENSION * 1e4,
            posture: Vec::new(),
            muscle_posture: Vec::new(),
            fiber_to_belly: Vec::new(),
            external_to_total_tendon: Vec::new(),
            fascicles: FascicleUse::Check,
            fascicle_error: FASCICLE_ERROR,
            source: None,
            line: 0,
        }
    }
}

impl ImagingSettings {
    /// Fibre length over belly length of a muscle.
    pub fn fiber_to_belly_of(&self, muscle: &str) -> Option<f64> {
        self.fiber_to_belly.iter().find(|(m, _)| m == muscle).map(|(_, v)| *v)
    }

    /// External over total tendon length of a muscle.
    pub fn external_to_total_tendon_of(&self, muscle: &str) -> Option<f64> {
        self.external_to_total_tendon.iter().find(|(m, _)| m == muscle).map(|(_, v)| *v)
    }

    /// All coordinates that are held while a muscle is imaged, the later ones in place of the earlier.
    pub fn posture_of<'a>(&'a self, muscle: &'a str) -> impl Iterator<Item = &'a PostureCoordinate> {
        self.posture.iter().chain(self.muscle_posture.iter().filter(move |(m, _)| m == muscle).flat_map(|(_, p)| p))
    }

    /// Names of muscles that the section uses.
    pub fn muscles(&self) -> impl Iterator<Item = &str> {
        let ratios = self.fiber_to_belly.iter().chain(&self.external_to_total_tendon).map(|(m, _)| m.as_str());
        ratios.chain(self.muscle_posture.iter().map(|(m, _)| m.as_str()))
    }

    pub(crate) fn parse(sections: &Sections<'_>, problems: &mut Vec<Problem>) -> ImagingSettings {
        let mut section = sections.section("ultrasound");
        let mut out = ImagingSettings { line: section.line_of("activation"), ..ImagingSettings::default() };
        let number = section.optional_number("activation", "0 to 1", |v| (0.0..=1.0).contains(&v));
        out.activation = number.unwrap_or(out.activation);
        let number =
            section.optional_number("specific_tension_n_per_cm2", "10 to 200 N/cm²", |v| (10.0..=200.0).contains(&v));
        out.specific_tension = number.map_or(out.specific_tension, |v| v * 1e4);
        let expected = "a table of degrees (metres for a translation), one per coordinate";
        out.posture = section.optional_table("posture_deg", expected, posture).unwrap_or_default();
        let expected = "a table of fractions, one per muscle";
        out.fiber_to_belly = section.optional_table("fiber_to_belly_length", expected, fractions).unwrap_or_default();
        out.external_to_total_tendon =
            section.optional_table("external_to_total_tendon_length", expected, fractions).unwrap_or_default();
        let expected = "a table of muscles, each with a table of degrees";
        out.muscle_posture = section
            .optional_table("muscle_posture_deg", expected, |inner| {
                let names = inner.keys();
                names
                    .into_iter()
                    .filter_map(|muscle| {
                        let held = inner.inner_table(&muscle, "muscle_posture_deg", "a table of degrees", posture)?;
                        Some((muscle, held))
                    })
                    .collect()
            })
            .unwrap_or_default();
        let uses = [("check", FascicleUse::Check), ("fit", FascicleUse::Fit)];
        out.fascicles = section.optional_word("fascicles", "use", &uses).unwrap_or_default();
        let number = section.optional_number("fascicle_error_percent", "0.5 to 50 %", |v| (0.5..=50.0).contains(&v));
        out.fascicle_error = number.map_or(out.fascicle_error, |v| v / 100.0);
        out.source = section.optional_string("source");
        section.finish(problems);
        out
    }
}

fn posture(section: &mut TomlSection<'_>) -> Vec<PostureCoordinate> {
    let all = section.all_numbers("degrees (metres for a translation)");
    all.into_iter()
        .map(|(coordinate, value_deg_or_m, line)| PostureCoordinate { coordinate, line, value_deg_or_m })
        .collect()
}

fn fractions(section: &mut TomlSection<'_>) -> Vec<(String, f64)> {
    let all = section.all_numbers("a fraction, more than 0 and at most 1");
    for (muscle, value, _) in &all {
        if !(*value > 0.0 && *value <= 1.0) {
            section.bad_value(muscle, "a fraction, more than 0 and at most 1", &value.to_string());
        }
    }
    all.into_iter().map(|(muscle, value, _)| (muscle, value)).collect()
}
