//! Units in the names of columns, and units that a ratio of moments gives away.

/// Kinds of quantity that columns of trials hold, as far as units of names go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measured {
    /// Time \[s\].
    Time,
    /// Angle \[deg or rad\].
    Angle,
    /// Angular velocity \[deg/s or rad/s\].
    AngularVelocity,
    /// Moment [N·m].
    Moment,
    /// Force \[N\].
    Force,
    /// Moment per body mass [N·m/kg].
    MomentPerMass,
    /// Voltage \[V\].
    Voltage,
    /// Part of a whole \[1\].
    Part,
}

impl Measured {
    /// What it is, in words, with an article.
    pub fn words(self) -> &'static str {
        match self {
            Measured::Time => "a time",
            Measured::Angle => "an angle",
            Measured::AngularVelocity => "an angular velocity",
            Measured::Moment => "a moment",
            Measured::Force => "a force",
            Measured::MomentPerMass => "a moment per body mass",
            Measured::Voltage => "a voltage",
            Measured::Part => "a part of the maximum",
        }
    }
}

/// A unit as names of columns write it.
#[derive(Debug, PartialEq)]
pub struct NamedUnit {
    /// Ends of column names, letters and digits only, in lower case.
    pub written: &'static [&'static str],
    /// Symbol.
    pub symbol: &'static str,
    /// What is measured in it.
    pub of: Measured,
    /// One of it in the unit that [`Measured`] names; of angles in degrees.
    pub factor: f64,
}

const fn unit(of: Measured, symbol: &'static str, factor: f64, written: &'static [&'static str]) -> NamedUnit {
    NamedUnit { written, symbol, of, factor }
}

/// Units that recorders and dynamometers export (NIST SP 811, appendix B).
pub static NAMED_UNITS: [NamedUnit; 31] = [
    unit(Measured::Moment, "N·m", 1.0, &["nm", "newtonmeter", "newtonmeters", "newtonmetre", "newtonmetres"]),
    unit(Measured::Moment, "ft·lb", 1.355_818, &["ftlb", "ftlbs", "ftlbf", "lbft", "lbfft", "footpounds"]),
    unit(Measured::Moment, "in·lb", 0.112_985, &["inlb", "inlbs", "inlbf", "lbin", "lbfin"]),
    unit(Measured::Moment, "N·mm", 1e-3, &["nmm"]),
    unit(Measured::Moment, "N·cm", 1e-2, &["ncm"]),
    unit(Measured::Moment, "mN·m", 1e-3, &["mnm"]),
    unit(Measured::Moment, "kN·m", 1e3, &["knm"]),
    unit(Measured::Moment, "kgf·m", 9.806_65, &["kgm", "kgfm", "kpm"]),
    unit(Measured::Moment, "kgf·cm", 0.098_066_5, &["kgcm", "kgfcm", "kpcm"]),
    unit(Measured::MomentPerMass, "N·m/kg", 1.0, &["nmkg", "nmperkg"]),
    unit(Measured::Force, "N", 1.0, &["newton", "newtons"]),
    unit(Measured::Force, "kgf", 9.806_65, &["kgf", "kg", "kp"]),
    unit(Measured::Force, "lbf", 4.448_222, &["lbf", "lb", "lbs"]),
    unit(Measured::Time, "s", 1.0, &["s", "sec", "secs", "second", "seconds", "sek", "sekunden"]),
    unit(Measured::Time, "ms", 1e-3, &["ms", "msec", "millisecond", "milliseconds", "millisekunden"]),
    unit(Measured::Time, "µs", 1e-6, &["us", "usec", "microsecond", "microseconds"]),
    unit(Measured::Time, "ns", 1e-9, &["ns", "nsec", "nanosecond", "nanoseconds"]),
    unit(Measured::Time, "min", 60.0, &["min", "minute", "minutes"]),
    unit(Measured::Time, "h", 3600.0, &["hour", "hours"]),
    unit(Measured::Angle, "deg", 1.0, &["deg", "degs", "degree", "degrees", "grad"]),
    unit(Measured::Angle, "rad", 57.295_779_513_082_32, &["rad", "rads", "radian", "radians"]),
    unit(Measured::Angle, "mrad", 0.057_295_779_513_082_32, &["mrad"]),
    unit(Measured::Angle, "rev", 360.0, &["rev", "revs", "turns", "revolutions"]),
    unit(
        Measured::AngularVelocity,
        "deg/s",
        1.0,
        &["degs", "degpers", "degsec", "degpersec", "degreespersecond", "degreess", "dps", "ds", "grads"],
    ),
    unit(Measured::AngularVelocity, "rad/s", 57.295_779_513_082_32, &["rads", "radpers", "radsec", "radpersec"]),
    unit(Measured::AngularVelocity, "rev/min", 6.0, &["rpm", "revmin", "revpermin"]),
    unit(Measured::Voltage, "V", 1.0, &["v", "volt", "volts"]),
    unit(Measured::Voltage, "mV", 1e-3, &["mv", "millivolt", "millivolts"]),
    unit(Measured::Voltage, "µV", 1e-6, &["uv", "microvolt", "microvolts"]),
    unit(Measured::Part, "%", 0.01, &["percent", "pct", "percentmvc", "pctmvc", "mvcpercent"]),
    unit(Measured::Part, "1", 1.0, &["fraction", "ratio"]),
];

/// Words of the longest unit: `deg_per_s`.
const MOST_WORDS_OF_A_UNIT: usize = 3;

/// The unit that the end of a column's name states: `time_ms`, `Zeit [ms]`, `torque (ft-lb)`, `velocity_deg_per_s`.
/// `None` if it states none that is known.
///
/// - `holds`: the quantity that the column is to hold; of units that are written alike, one of it is meant
pub fn unit_in_name(column: &str, holds: Measured) -> Option<&'static NamedUnit> {
    let find = |written: &str| {
        // `°/s` and `µV` have signs that are no letters of ASCII; `%` stands for itself.
        let signs = written.replace('°', "deg").replace(['µ', 'μ'], "u").replace('%', "percent");
        let plain: String = signs.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect();
        let mut found = NAMED_UNITS.iter().filter(|unit| unit.written.contains(&plain.as_str()));
        let first = found.next()?;
        Some(if first.of == holds { first } else { found.find(|unit| unit.of == holds).unwrap_or(first) })
    };
    let column = column.trim();
    if let Some((open, close)) =
        column.chars().last().and_then(|end| [('[', ']'), ('(', ')')].into_iter().find(|b| b.1 == end))
    {
        let inside = column.rsplit_once(open)?.1.trim_end_matches(close).trim();
        // A letter that is too short to be a unit at the end of a name.
        let newton = || (inside == "N").then(|| NAMED_UNITS.iter().find(|unit| unit.symbol == "N")).flatten();
        return newton().or_else(|| find(inside));
    }
    let ends: Vec<usize> = column
        .char_indices()
        .rev()
        .filter(|(_, c)| ['_', ' ', '.', '-', '/', ','].contains(c))
        .map(|(i, _)| i + 1)
        .collect();
    // The longest end that is a unit: `ft_lb` rather than `lb`.
    let ends = ends.into_iter().take(MOST_WORDS_OF_A_UNIT).rev();
    let ended = ends.map(|from| &column[from..]).find_map(find);
    ended.or_else(|| moment_unit_in_name(column).filter(|_| holds == Measured::Moment))
}

/// The unit of moment that ends a column's name without anything between: `torqueNmm`. Not N·m, which ends other words,
/// too.
fn moment_unit_in_name(column: &str) -> Option<&'static NamedUnit> {
    let plain: String = column.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect();
    let mut units = NAMED_UNITS.iter().filter(|unit| unit.of == Measured::Moment && unit.factor != 1.0);
    units.find(|unit| unit.written.iter().any(|end| plain.ends_with(end)))
}

/// The unit in which a moment was written that is `ratio` times what was expected in N·m, within 4 %: repeated maximum
/// contractions differ by as much.
pub fn moment_unit_of_ratio(ratio: f64) -> Option<&'static NamedUnit> {
    let mut units = NAMED_UNITS.iter().filter(|unit| unit.of == Measured::Moment && unit.factor != 1.0);
    units.find(|unit| (ratio * unit.factor - 1.0).abs() < 0.04)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_units_are_read_from_names_and_ratios() {
        let named = |holds| move |column| (holds, column, unit_in_name(column, holds).map(|unit| unit.symbol));
        for (holds, cases) in [
            (
                Measured::Moment,
                &[
                    ("torque_ft_lb", Some("ft·lb")),
                    ("Torque [ft-lbs]", Some("ft·lb")),
                    ("torque_ftlb", Some("ft·lb")),
                    ("torqueFtLb", Some("ft·lb")),
                    ("moment (Nmm)", Some("N·mm")),
                    ("moment_Nm", Some("N·m")),
                    ("moment_n_m", Some("N·m")),
                    ("Moment [N·m/kg]", Some("N·m/kg")),
                    ("torque_mV", Some("mV")),
                    ("torque_v", Some("V")),
                    ("force [N]", Some("N")),
                    ("force_n", None),
                    ("torque", None),
                    ("moment_2", None),
                ][..],
            ),
            (
                Measured::Time,
                &[
                    ("time_ms", Some("ms")),
                    ("Zeit [ms]", Some("ms")),
                    ("time (µs)", Some("µs")),
                    ("time_s", Some("s")),
                    ("t", None),
                    ("times", None),
                ],
            ),
            (
                Measured::Angle,
                &[
                    ("Winkel [rad]", Some("rad")),
                    ("angle_deg", Some("deg")),
                    ("Winkel (°)", Some("deg")),
                    ("flexrad", None),
                ],
            ),
            (
                Measured::AngularVelocity,
                &[
                    ("velocity_deg_per_s", Some("deg/s")),
                    ("v_rad_s", Some("rad/s")),
                    ("w [rad/s]", Some("rad/s")),
                    ("w [°/s]", Some("deg/s")),
                    ("speed_rpm", Some("rev/min")),
                ],
            ),
            (
                Measured::Part,
                &[("FCR [%]", Some("%")), ("emg_FCR_mV", Some("mV")), ("emg_FCR", None), ("ECU_pct_mvc", Some("%"))],
            ),
        ] {
            for (column, unit) in cases {
                assert_eq!(named(holds)(column), (holds, *column, *unit));
            }
        }
        let of = |ratio| moment_unit_of_ratio(ratio).map(|unit| unit.symbol);
        assert_eq!([of(1.0 / 1.3558), of(1000.0), of(1.0), of(0.9)], [Some("ft·lb"), Some("N·mm"), None, None]);
    }
}
