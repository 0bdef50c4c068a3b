//! What experiments do for pairs of explanations, for a terminal.

use super::table::{fixed, table};
use carpus_diagnosis::separation::{SEPARABLE_Z, Separation};

/// A row for every experiment.
pub fn separation_table<'a>(separations: impl IntoIterator<Item = &'a Separation>) -> String {
    let rows = separations.into_iter().map(|s| {
        let told = if s.z_then >= SEPARABLE_Z { "yes" } else { "no" };
        vec![s.separates.join(" | "), s.trials.to_owned(), fixed(s.z_now, 1), fixed(s.z_then, 1), told.to_owned()]
    });
    table(&["tell apart", "record", "z now", "z then", "told apart"], 2, rows)
}
