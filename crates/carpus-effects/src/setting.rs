//! An effect of a certain size and shape.

use super::effect::Effect;

/// An effect and the values of its parameters.
#[derive(Clone)]
pub struct Setting {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// In the order of its parameters.
    pub values: Vec<f64>,
}

impl std::fmt::Debug for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple(self.effect.description().id).field(&self.values).finish()
    }
}

impl PartialEq for Setting {
    fn eq(&self, other: &Self) -> bool {
        self.effect.description().id == other.effect.description().id && self.values == other.values
    }
}

impl Setting {
    /// The effect, absent; of the usual shape at a joint whose neutral angle is 0.
    pub fn absent(effect: &'static dyn Effect) -> Setting {
        Setting { effect, values: effect.description().absent() }
    }

    /// Whether all amplitudes are 0.
    pub fn is_absent(&self) -> bool {
        self.effect.description().amplitudes().all(|i| self.values[i] == 0.0)
    }
}
