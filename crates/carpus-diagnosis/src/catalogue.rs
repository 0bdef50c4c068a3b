//! All effects that there are: the catalogue and a laboratory's own.

use super::effect::Effect;
use super::own_effect;

pub use super::effects::CATALOGUE;

/// All effects: those of the catalogue, then those that a laboratory has defined ([`own_effect`]).
pub fn with_own() -> Vec<&'static dyn Effect> {
    let own = own_effect::registered().into_iter().map(|e| e as &dyn Effect);
    CATALOGUE.iter().copied().chain(own).collect()
}

/// The effect of that identifier, of the catalogue or of a laboratory's own.
pub fn effect(id: &str) -> Option<&'static dyn Effect> {
    let known = CATALOGUE.iter().copied().find(|e| e.description().id == id);
    known.or_else(|| with_own().into_iter().find(|e| e.description().id == id))
}
