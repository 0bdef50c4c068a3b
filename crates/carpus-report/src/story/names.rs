//! Names of effects.

use crate::sentence::within_sentence;
use carpus_effects::catalogue::effect;

/// The name of an effect.
pub(super) fn name(id: &str) -> String {
    effect(id).map_or_else(|| id.replace('_', " "), |e| e.description().name.to_owned())
}

pub(super) fn in_sentence(id: &str) -> String {
    within_sentence(&name(id))
}

pub(super) fn names(ids: &[String]) -> String {
    ids.iter().map(|id| name(id)).collect::<Vec<_>>().join(" + ")
}

pub(crate) fn named_in_sentence(ids: &[String]) -> String {
    ids.iter().map(|id| in_sentence(id)).collect::<Vec<_>>().join(" and ")
}

pub(super) fn listed(ids: &[String]) -> String {
    ids.iter().map(|id| name(id)).collect::<Vec<_>>().join(", ")
}
