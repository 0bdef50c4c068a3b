//! The ledger of effects, for a terminal.

use crate::table::{fixed, table};
use carpus_report::intervals::with_validity;
use carpus_report::ledger::Ledger;

/// The steps with their errors, for a terminal.
pub fn readable(ledger: &Ledger) -> String {
    let percent = |v: Option<f64>| v.map_or("–".to_owned(), |v| fixed(100.0 * v, 2));
    let mut rows: Vec<Vec<String>> = ledger
        .steps
        .iter()
        .enumerate()
        .map(|(i, step)| {
            let now = if i == ledger.current { " ◂ model.osim" } else { "" };
            let p = step.p_value.map_or("–".to_owned(), |p| fixed(p, 3));
            vec![i.to_string(), format!("{}{now}", step.label), percent(Some(step.train)), percent(step.held_out), p]
        })
        .collect();
    let floor = percent(Some(ledger.noise_floor));
    rows.push(vec![String::new(), "Noise floor".to_owned(), floor.clone(), floor, String::new()]);
    let header = ["step", "model", "training %", "held out %", "p (nothing left)"];
    let mut text = format!("{}: error ({})\n{}", ledger.participant, ledger.measure, table(&header, 2, rows));
    let parameters = ledger.now().map(|s| &s.parameters).filter(|p| !p.is_empty());
    if let Some(parameters) = parameters {
        let rows = parameters.iter().map(|(name, e)| {
            let plausible = if e.is_plausible() { "" } else { "  implausible" };
            let of = |v: f64| carpus_report::significant(v, 4).replace('−', "-");
            vec![
                name.clone(),
                with_validity(
                    format!("{} [{}, {}] {}", of(e.value), of(e.ci95[0]), of(e.ci95[1]), e.unit),
                    e.ci95,
                    e.value,
                ),
                format!("{} to {}{plausible}", e.plausible[0], e.plausible[1]),
            ]
        });
        text.push_str("\n\n");
        text.push_str(&table(&["parameter", "estimate, 95 % interval", "plausible"], 3, rows));
    }
    text
}
