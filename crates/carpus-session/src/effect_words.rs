//! Descriptions of effects in words.

use serde::Serialize;

use carpus_effects::effect::{Description, NeutralShift, OsimForm, Parameter, Role, Stage};

/// Effects of the catalogue, for programs.
#[derive(Debug, Serialize)]
pub struct Catalogue<'a> {
    /// Name and version of the form.
    pub schema: &'static str,
    /// The effects.
    pub effects: &'a [&'static Description],
}

impl<'a> Catalogue<'a> {
    /// Of these effects.
    pub fn of(effects: &'a [&'static Description]) -> Catalogue<'a> {
        Catalogue { schema: "carpus.catalogue/1", effects }
    }
}

/// Where an effect acts, in a word.
pub fn stage(stage: Stage) -> &'static str {
    match stage {
        Stage::Excitation => "excitation",
        Stage::Activation => "activation",
        Stage::Muscle => "muscle",
        Stage::Geometry => "geometry",
        Stage::Joint => "joint",
        Stage::Inertia => "segment",
        Stage::Sensor => "sensor",
    }
}

/// How an effect is kept in a model: the kind, and by what.
pub fn form(d: &Description) -> (&'static str, &'static str) {
    match d.osim_form {
        OsimForm::Native(what) => ("native", what),
        OsimForm::Controls(what) => ("controls", what),
        OsimForm::SideCar(what) => ("side-car", what),
    }
}

/// A parameter: unit, plausible range, role and source.
pub fn parameter(p: &Parameter) -> String {
    let role = match p.role {
        Role::Amplitude => "the effect is absent at 0".to_string(),
        Role::Shape if p.neutral != NeutralShift::None => {
            format!(
                "shape, usually {}, both from the joint's neutral angle (0, or the middle of a range that lies to one \
                 side of it)",
                p.start
            )
        }
        Role::Shape => format!("shape, usually {}", p.start),
    };
    format!("{} [{}]: plausible {} to {}; {role}. Range: {}", p.name, p.unit, p.plausible[0], p.plausible[1], p.source)
}
