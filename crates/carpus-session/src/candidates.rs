//! Effects by their identifiers, and of a size.

use std::path::Path;
use std::str::FromStr;

use super::diagnostic::{Diagnostic, Failure};
use super::loading::LoadedParticipant;
use super::prepared::active_specs;
use carpus_effects::catalogue::{effect, with_own};
use carpus_effects::effect::{Effect, lacks_property};
use carpus_effects::forward_model::Setting;
use carpus_effects::joint_traits::JointTraits;
use carpus_effects::synthesis::sized;
use carpus_osim::osim::spec::MuscleSpec;

/// An effect and the parameters named with it.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectSize {
    /// Identifier of the effect.
    pub id: String,
    /// Names and values, in the units of the catalogue.
    pub values: Vec<(String, f64)>,
}

impl FromStr for EffectSize {
    type Err = String;

    /// As typed: `joint_stiffness:stiffness=1.2,rest_angle=0.1`.
    fn from_str(text: &str) -> Result<EffectSize, String> {
        let (id, listed) = text.split_once(':').unwrap_or((text, ""));
        let value = |item: &str| {
            let (name, value) = item.split_once('=').ok_or_else(|| format!("expected NAME=VALUE, found `{item}`"))?;
            match value.trim().parse::<f64>() {
                Ok(number) if number.is_finite() => Ok((name.trim().to_owned(), number)),
                _ => Err(format!("{}: expected a number, found `{value}`", name.trim())),
            }
        };
        let values = listed.split(',').filter(|item| !item.trim().is_empty()).map(value).collect::<Result<_, _>>()?;
        Ok(EffectSize { id: id.trim().to_owned(), values })
    }
}

/// The effects of these identifiers; `all` or nothing: the whole catalogue and the laboratory's own.
///
/// # Errors
/// An unknown identifier.
pub fn candidates(ids: &[String]) -> Result<Vec<&'static dyn Effect>, Failure> {
    if ids.is_empty() || ids == ["all"] {
        return Ok(with_own());
    }
    let mut found: Vec<&'static dyn Effect> = Vec::new();
    for id in ids {
        let effect = known(id)?;
        if found.iter().all(|e| e.description().id != effect.description().id) {
            found.push(effect);
        }
    }
    Ok(found)
}

/// What is to be said of effects that change a property which none of the participant's active muscles has: the effect
/// is not there to be seen.
pub(super) fn without_property(effects: &[&'static dyn Effect], run: &LoadedParticipant) -> Vec<Diagnostic> {
    let muscles = active_specs(run);
    let of = |effect: &&'static dyn Effect| {
        let why = lacks_property(*effect, &muscles)?;
        let text = format!("{}: not testable: {why}", effect.description().id);
        Some(Diagnostic::warning(text).in_file(&run.loaded.path))
    };
    effects.iter().filter_map(of).collect()
}

/// The effect of an identifier.
///
/// # Errors
/// There is none.
pub fn known(id: &str) -> Result<&'static dyn Effect, Failure> {
    effect(id).ok_or_else(|| {
        let message = Diagnostic::error(format!("there is no effect `{id}`"));
        let hint = match carpus_study::study::nearest(id, with_own().iter().map(|e| e.description().id)) {
            Some(nearest) => format!("did you mean `{nearest}`? `carpus effects` lists all"),
            None if Path::new(id).exists() => {
                "the study comes first, then the effects; `carpus effects` lists all".to_string()
            }
            None => "`carpus effects` lists all".to_string(),
        };
        message.hint(hint).into()
    })
}

/// An effect of the size that was asked for with `--effect`.
///
/// Comes with warnings of what is not plausible: an angle in degrees, say.
///
/// - `muscles`, `joint`: of the model
///
/// # Errors
/// An unknown effect or parameter; a size out of reach.
pub fn at_size(
    asked: &EffectSize,
    muscles: &[MuscleSpec],
    joint: &JointTraits,
) -> Result<(Setting, Vec<Diagnostic>), Failure> {
    let mut warnings = Vec::new();
    for p in known(&asked.id)?.description().parameters {
        let [low, high] = joint.plausible(p);
        for (_, value) in asked.values.iter().filter(|(name, value)| name == p.name && !(low..=high).contains(value)) {
            let text =
                format!("--effect: {}.{} is {value} {}; plausible are {low} to {high}", asked.id, p.name, p.unit);
            warnings.push(Diagnostic::warning(text));
        }
    }
    match sized(known(&asked.id)?, &asked.values, muscles, joint) {
        Ok(setting) => Ok((setting, warnings)),
        Err(e) => {
            let hint = format!("carpus effects {} tells its parameters", asked.id);
            warnings.push(Diagnostic::error(format!("--effect: {e}")).hint(hint));
            Err(warnings.into())
        }
    }
}

/// The names of effects, joined.
pub fn names_of<S: AsRef<str>>(ids: &[S]) -> String {
    let name = |id: &S| effect(id.as_ref()).map_or(id.as_ref().to_owned(), |e| e.description().name.to_owned());
    ids.iter().map(name).collect::<Vec<_>>().join(" + ")
}
