//! Units of parameters, as they are written.

/// Units that a product or quotient may be made of.
const KNOWN: [&str; 7] = ["1", "N", "m", "s", "rad", "kg", "session"];

/// A unit as the catalogue writes it: `N*m/rad`, `Nm/rad` and `N·m/rad` are the same, `s^2` is `s²`.
///
/// # Errors
/// What of it is no unit of SI.
pub fn spelled(unit: &str) -> Result<String, String> {
    let unit = unit.trim().replace(['*', '⋅'], "·").replace("^2", "²").replace("^3", "³").replace("Nm", "N·m");
    let plain = unit.replace(['(', ')'], "");
    for part in plain.split(['·', '/']) {
        let bare = part.trim_end_matches(['²', '³']);
        if !KNOWN.contains(&bare) {
            return Err(part.to_owned());
        }
    }
    Ok(unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_units_are_spelled_one_way_and_others_refused() {
        for (written, expected) in
            [("N*m/rad", "N·m/rad"), ("Nm", "N·m"), ("1", "1"), ("kg·m^2", "kg·m²"), ("N·m·s/rad", "N·m·s/rad")]
        {
            assert_eq!(spelled(written).as_deref(), Ok(expected));
        }
        for (written, wrong) in [("deg", "deg"), ("N·m/deg", "deg"), ("ft·lb", "ft"), ("", "")] {
            assert_eq!(spelled(written), Err(wrong.to_owned()));
        }
    }
}
