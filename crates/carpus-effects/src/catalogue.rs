//! All effects that there are: the catalogue and a laboratory's own.

use std::sync::{PoisonError, RwLock};

use super::effect::Effect;
use super::own_effect::{self, TakenId};

pub use super::effects::CATALOGUE;

/// Effects that a program has defined by code of its own.
static OF_PROGRAM: RwLock<Vec<&'static dyn Effect>> = RwLock::new(Vec::new());

/// Puts an effect that a program defines by code of its own beside the catalogue, until it is taken away
/// ([`withdraw`]). A formula needs no code: [`own_effect::register`].
///
/// # Errors
/// Another effect has its identifier.
pub fn register(effect: &'static dyn Effect) -> Result<(), TakenId> {
    let id = effect.description().id.to_owned();
    if CATALOGUE.iter().any(|e| e.description().id == id) {
        return Err(TakenId::Catalogue { id });
    }
    let mut registered = OF_PROGRAM.write().unwrap_or_else(PoisonError::into_inner);
    let own = own_effect::registered();
    let file = own.iter().find(|e| e.defined().id == id).map(|e| e.defined().file.display().to_string());
    let is_known = registered.iter().any(|e| e.description().id == id);
    if let Some(other) = file.or_else(|| is_known.then(|| "this program".to_owned())) {
        return Err(TakenId::Defined { id, other });
    }
    registered.push(effect);
    Ok(())
}

/// Takes an effect of a program ([`register`]) away again. Returns whether it was there.
pub fn withdraw(id: &str) -> bool {
    let mut registered = OF_PROGRAM.write().unwrap_or_else(PoisonError::into_inner);
    let before = registered.len();
    registered.retain(|e| e.description().id != id);
    registered.len() < before
}

/// All effects: those of the catalogue, then those that a laboratory has defined ([`own_effect`]), then those of a
/// program ([`register`]).
pub fn with_own() -> Vec<&'static dyn Effect> {
    let own = own_effect::registered().into_iter().map(|e| e as &dyn Effect);
    let of_program = OF_PROGRAM.read().unwrap_or_else(PoisonError::into_inner);
    CATALOGUE.iter().copied().chain(own).chain(of_program.iter().copied()).collect()
}

/// The effect of that identifier, of the catalogue or of a laboratory's own.
pub fn effect(id: &str) -> Option<&'static dyn Effect> {
    let known = CATALOGUE.iter().copied().find(|e| e.description().id == id);
    known.or_else(|| with_own().into_iter().find(|e| e.description().id == id))
}
