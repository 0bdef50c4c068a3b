//! The terms of which formulas are made.

use super::trial_table::TrialTable;
use carpus_osim::functions::{Dialect, Expression};

/// Wave numbers of the angle that are scanned [1/rad]: least, largest, step. Over two radians neighbours correlate by
/// more than 0.9.
pub(super) const WAVES: [f64; 3] = [1.0, 30.0, 0.5];

/// A term of the library.
#[derive(Clone, Debug)]
pub(super) struct Term {
    pub(super) text: String,
    /// The shape `k`, and its unit.
    pub(super) shape: Option<(f64, &'static str)>,
    /// Powers of rad and s that the term has.
    pub(super) units: [i32; 2],
}

pub(super) fn variables(muscles: &[String]) -> Vec<String> {
    let plain = ["q", "qdot", "qddot", "t", "t_session"].map(String::from);
    plain.into_iter().chain(muscles.iter().map(|m| format!("a_{m}"))).chain(["k".to_owned()]).collect()
}

/// The terms that formulas are made of.
pub(super) fn library(muscles: &[String]) -> Vec<Term> {
    let mut all = Vec::new();
    let mut add = |text: &str, units| all.push(Term { text: text.to_owned(), shape: None, units });
    for (text, units) in [
        ("q", [1, 0]),
        ("q^2", [2, 0]),
        ("q^3", [3, 0]),
        ("step(q)", [0, 0]),
        ("hinge(q)", [1, 0]),
        ("hinge(-q)", [1, 0]),
        ("qdot", [1, -1]),
        ("qdot*abs(qdot)", [2, -2]),
        ("sign(qdot)", [0, 0]),
        ("hinge(qdot)", [1, -1]),
        ("hinge(-qdot)", [1, -1]),
        ("qddot", [1, -2]),
        ("q*qdot", [2, -1]),
        ("q^2*qdot", [3, -1]),
        ("q*sign(qdot)", [1, 0]),
        ("q^2*sign(qdot)", [2, 0]),
        ("q*abs(qdot)", [2, -1]),
        ("t", [0, 1]),
        ("t_session", [0, 0]),
        ("t_session*q", [1, 0]),
    ] {
        add(text, units);
    }
    for muscle in muscles {
        let a = format!("a_{muscle}");
        add(&a, [0, 0]);
        add(&format!("{a}^2"), [0, 0]);
        add(&format!("{a}*q"), [1, 0]);
        add(&format!("{a}*q^2"), [2, 0]);
        add(&format!("{a}*qdot"), [1, -1]);
        add(&format!("{a}*sign(qdot)"), [0, 0]);
        add(&format!("{a}*t_session"), [0, 0]);
    }
    let mut shaped = |text: &str, k: f64, unit| {
        all.push(Term { text: text.to_owned(), shape: Some((k, unit)), units: [0, 0] });
    };
    let [least, largest, step] = WAVES;
    for i in 0..=((largest - least) / step).round() as usize {
        let k = least + step * i as f64;
        shaped("sin(k*q)", k, "1/rad");
        shaped("cos(k*q)", k, "1/rad");
    }
    for k in [3.0, 6.0, 10.0] {
        shaped("exp(k*q)", k, "1/rad");
        shaped("exp(-k*q)", k, "1/rad");
    }
    for k in [0.5, 2.0] {
        shaped("exp(-k*t)", k, "1/s");
    }
    all
}

impl Term {
    /// Its values over a trial.
    pub(super) fn values(&self, trial: &TrialTable, variables: &[String]) -> Vec<f64> {
        let names: Vec<&str> = variables.iter().map(String::as_str).collect();
        let Ok(expression) = Expression::parse_as(&self.text, &names, Dialect::Extended) else { return Vec::new() };
        let k = self.shape.map_or(0.0, |(k, _)| k);
        let at = |i: usize| {
            let mut values = vec![trial.angle[i], trial.speed[i], trial.acceleration[i], trial.time[i], trial.session];
            values.extend(trial.activation.iter().map(|a| a[i]));
            values.push(k);
            expression.value_at(&values)
        };
        (0..trial.residual.len()).map(at).collect()
    }

    /// Unit of its coefficient.
    pub(super) fn unit(&self) -> String {
        let [rad, s] = self.units;
        let power = |unit: &str, n: i32| match n {
            1 => format!("·{unit}"),
            n => format!("·{unit}{}", if n == 2 { "²" } else { "³" }),
        };
        let above = if s < 0 { power("s", -s) } else { String::new() };
        let below = [("rad", rad), ("s", s)].into_iter().filter(|(_, n)| *n > 0).map(|(unit, n)| power(unit, n));
        let below: Vec<String> = below.map(|p| p.trim_start_matches('·').to_owned()).collect();
        let below = if below.is_empty() { String::new() } else { format!("/{}", below.join("/")) };
        format!("N·m{above}{below}")
    }
}
