//! `[scaling]` and `[strength_scaling]` of `study.toml`: how a participant's model follows from the study's.

use super::fault::Fault;
use super::problem::Problem;
use super::toml_section::{Sections, TomlSection};

/// Window of the mean that counts as a maximum voluntary moment, unless the study says otherwise \[s\].
const DEFAULT_MVC_WINDOW_S: f64 = 0.1;

/// `[strength_scaling]`: one factor for the forces of all flexors and one for all extensors.
#[derive(Clone, Debug, PartialEq)]
pub struct StrengthSettings {
    /// Angle of the dynamometer's coordinate in the maximum contractions, in degrees as written (metres for a
    /// translation); `None`: that of the MVC trials.
    pub posture_deg: Option<f64>,
    /// Window over which the moment of an MVC trial is averaged \[s\]; 0 takes the largest sample.
    pub mvc_window: f64,
    /// Whether flexion is the positive direction of the dynamometer's coordinate.
    pub flexion_is_positive: bool,
    /// Muscles that count as flexors; `None`: those whose moment arm points to flexion.
    pub flexors: Option<Vec<String>>,
    /// Muscles that count as extensors; `None`: those whose moment arm points to extension.
    pub extensors: Option<Vec<String>>,
}

/// `[scaling]`: what OpenSim's Scale Tool does, driven by `<segment>_length_m` of `participants.csv`.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ScalingSettings {
    /// Whether bodies keep their share of the model's mass (`preserve_mass_distribution`).
    pub preserve_mass_distribution: bool,
    /// Mass of the scaled model.
    pub final_mass: FinalMass,
    /// The segments, in the order of the file.
    pub segments: Vec<SegmentScaling>,
}

/// Mass of a scaled model.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum FinalMass {
    /// What scaling the bodies gives.
    #[default]
    FromBodies,
    /// The participant's mass: the model is a whole body.
    Participant,
    /// The model's mass in proportion to the participant's: the model is part of a body of this mass \[kg\].
    InProportionTo(f64),
}

/// A segment, a column of `participants.csv`, and the bodies that it scales.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentScaling {
    /// The column without `_length_m`.
    pub segment: String,
    /// Line of the table.
    pub line: usize,
    /// Bodies that are scaled.
    pub bodies: Vec<String>,
    /// Which of the bodies' x, y, z are scaled.
    pub axes: [bool; 3],
    /// The same length in the model.
    pub model_length: ModelLength,
}

/// Where the length of a segment is found in the model.
#[derive(Clone, Debug, PartialEq)]
pub enum ModelLength {
    /// As stated \[m\].
    Stated(f64),
    /// Distance of two markers in the default pose.
    Markers([String; 2]),
    /// Distance of the centres of two joints in the default pose.
    Joints([String; 2]),
}

/// Reads `[strength_scaling]`.
pub(crate) fn strength(sections: &Sections<'_>, active: &[String], problems: &mut Vec<Problem>) -> StrengthSettings {
    let mut section = sections.section("strength_scaling");
    let flexors = group(&mut section, "flexors", active);
    let extensors = group(&mut section, "extensors", active);
    let settings = StrengthSettings {
        posture_deg: section.optional_number("posture_deg", "an angle in degrees", |v| v.abs() <= 360.0),
        mvc_window: section
            .optional_number("mvc_window_s", "a number of seconds, 0 or more", |v| v >= 0.0)
            .unwrap_or(DEFAULT_MVC_WINDOW_S),
        flexion_is_positive: section
            .optional_word("flexion", "direction", &[("positive", true), ("negative", false)])
            .unwrap_or(true),
        flexors,
        extensors,
    };
    if let (Some(flexors), Some(extensors)) = (&settings.flexors, &settings.extensors)
        && let Some(both) = flexors.iter().find(|muscle| extensors.contains(muscle))
    {
        section.bad_value("extensors", "muscles that are not among the flexors", &format!("`{both}`"));
    }
    section.finish(problems);
    settings
}

fn group(section: &mut TomlSection<'_>, key: &'static str, active: &[String]) -> Option<Vec<String>> {
    let muscles = section.optional_strings(key, "list of muscles")?;
    for muscle in muscles.iter().filter(|muscle| !active.contains(muscle)) {
        section.bad_value(key, "muscles listed in [muscles] active", &format!("`{muscle}`"));
    }
    Some(muscles)
}

/// Reads `[scaling]`; `None` if the study has none.
pub(crate) fn linear(
    sections: &Sections<'_>,
    file: &std::path::Path,
    problems: &mut Vec<Problem>,
) -> Option<ScalingSettings> {
    let mut section = sections.section("scaling");
    if section.is_empty() {
        section.finish(problems);
        return None;
    }
    let preserve = section.optional_bool("preserve_mass_distribution").unwrap_or(false);
    let whole_body = section.optional_bool("whole_body").unwrap_or(false);
    let reference = section.optional_number("reference_mass_kg", "a positive mass in kg", |v| v > 0.0);
    if whole_body && reference.is_some() {
        section.bad_value("reference_mass_kg", "no such key beside whole_body = true", "both");
    }
    let final_mass = match (whole_body, reference) {
        (true, _) => FinalMass::Participant,
        (false, Some(mass)) => FinalMass::InProportionTo(mass),
        (false, None) => FinalMass::FromBodies,
    };
    let segments: Vec<SegmentScaling> = section
        .optional_table("segments", "a table of segments", segments)
        .unwrap_or_default()
        .into_iter()
        .flatten()
        .collect();
    section.finish(problems);
    for (i, segment) in segments.iter().enumerate() {
        let clash = |a: &SegmentScaling, b: &str| {
            a.bodies.iter().any(|x| x == b) && (0..3).any(|k| a.axes[k] && segment.axes[k])
        };
        for body in &segment.bodies {
            if let Some(before) = segments[..i].iter().find(|earlier| clash(earlier, body)) {
                let found = format!("`{body}`, also scaled by {}", before.segment);
                let expected = "each body in one segment, or along different axes".to_owned();
                let fault = Fault::BadValue { key: format!("segments.{}", segment.segment), expected, found };
                problems.push(Problem::error(file, segment.line, fault));
            }
        }
    }
    Some(ScalingSettings { preserve_mass_distribution: preserve, final_mass, segments })
}

fn segments(table: &mut TomlSection<'_>) -> Vec<Option<SegmentScaling>> {
    table.all_tables("a table { bodies = [..], model_length_m = .. }", segment)
}

fn segment(name: &str, line: usize, table: &mut TomlSection<'_>) -> Option<SegmentScaling> {
    let bodies = table.required_strings("bodies", "list of the bodies that this length scales");
    let axes = table.optional_words("axes", "axis", &[("x", 0), ("y", 1), ("z", 2)]);
    let mut scaled = [axes.is_none(); 3];
    axes.unwrap_or_default().into_iter().for_each(|axis: usize| scaled[axis] = true);
    let pair =
        |found: Option<Vec<String>>, key: &str, table: &mut TomlSection<'_>| match found.map(<[String; 2]>::try_from) {
            None => None,
            Some(Ok(pair)) => Some(pair),
            Some(Err(other)) => {
                table.bad_value(key, "two names", &format!("{} names", other.len()));
                None
            }
        };
    let stated = table.optional_number("model_length_m", "a positive length in m", |v| v > 0.0);
    let markers = table.optional_strings("markers", "list of two markers");
    let joints = table.optional_strings("joints", "list of two joints");
    let given = [stated.is_some(), markers.is_some(), joints.is_some()].into_iter().filter(|given| *given).count();
    let markers = pair(markers, "markers", table);
    let joints = pair(joints, "joints", table);
    let expected =
        "the model's length: one of model_length_m = 0.25, markers = [\"A\", \"B\"], joints = [\"a\", \"b\"]";
    let model_length = match (given, stated, markers, joints) {
        (1, Some(stated), _, _) => Some(ModelLength::Stated(stated)),
        (1, _, Some(markers), _) => Some(ModelLength::Markers(markers)),
        (1, _, _, Some(joints)) => Some(ModelLength::Joints(joints)),
        (1, ..) => None,
        (count, ..) => {
            table.bad_value("model_length_m", expected, &format!("{count} of them"));
            None
        }
    };
    Some(SegmentScaling { segment: name.to_owned(), line, bodies: bodies?, axes: scaled, model_length: model_length? })
}
