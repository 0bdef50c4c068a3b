//! Groups and visits of participants, and the differences between them.

use crate::diagnostic::{Diagnostic, Failure};
use carpus_study::study::{Participant, Study as Tables};

/// Who was measured, in which cell of groups and visits.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// Cell of every participant, in the study's order.
    pub cells: Vec<usize>,
    /// Person of every participant.
    pub persons: Vec<usize>,
    /// Whether there are several visits.
    pub has_visits: bool,
    /// Names of the cells.
    pub names: Vec<String>,
    /// Differences in words, with a weight for every cell.
    pub contrasts: Vec<(String, Vec<f64>)>,
}

/// Different names in the order in which they come, and the place of each among them.
fn levels<'a>(of: impl Iterator<Item = &'a str>) -> (Vec<String>, Vec<usize>) {
    let mut names: Vec<String> = Vec::new();
    let places = of
        .map(|name| {
            names.iter().position(|known| known == name).unwrap_or_else(|| {
                names.push(name.to_owned());
                names.len() - 1
            })
        })
        .collect();
    (names, places)
}

impl Design {
    /// What the columns `person`, `group` and `visit` of `participants.csv` say of some participants.
    ///
    /// # Errors
    /// One group and one visit only; a participant without one where others have one.
    pub fn new(tables: &Tables, participants: &[Participant]) -> Result<Design, Failure> {
        let file = tables.folder.join("participants.csv");
        let factor = |column: &str, of: fn(&Participant) -> Option<&str>| {
            if participants.iter().all(|p| of(p).is_none()) {
                return Ok((vec![String::new()], vec![0; participants.len()]));
            }
            let lacking: Vec<Diagnostic> = participants
                .iter()
                .filter(|p| of(p).is_none())
                .map(|p| {
                    let text = format!("{}: `{column}` is empty, and others have one", p.name);
                    Diagnostic::error(text).in_file(&file).at_line(p.line)
                })
                .collect();
            match lacking.is_empty() {
                true => Ok(levels(participants.iter().filter_map(of))),
                false => Err(Failure::Input(lacking)),
            }
        };
        let (groups, group) = factor("group", |p| p.group.as_deref())?;
        let (visits, visit) = factor("visit", |p| p.visit.as_deref())?;
        if groups.len() * visits.len() == 1 {
            let text = "nothing to compare: all participants are of one group and one visit";
            let hint = "give participants.csv a column `group` (patients, controls) or `visit` (before, after); with \
                        visits also `person`, the same for all participants that are one person";
            return Err(Diagnostic::error(text).in_file(&file).hint(hint).into());
        }
        let person = participants.iter().map(|p| p.person.as_deref().unwrap_or(&p.name));
        Ok(Design {
            cells: group.iter().zip(&visit).map(|(g, v)| g * visits.len() + v).collect(),
            persons: levels(person).1,
            has_visits: visits.len() > 1,
            names: groups.iter().flat_map(|g| visits.iter().map(move |v| cell_name(g, v))).collect(),
            contrasts: contrasts(&groups, &visits),
        })
    }
}

impl Design {
    /// Said where visits are compared and no person came twice.
    pub fn warning(&self) -> Option<String> {
        let persons = self.persons.iter().collect::<std::collections::BTreeSet<_>>().len();
        (self.has_visits && persons == self.persons.len()).then(|| {
            "no person came to two visits: they are compared as different persons; the column person of \
             participants.csv says who is the same"
                .to_owned()
        })
    }
}

fn cell_name(group: &str, visit: &str) -> String {
    match (group.is_empty(), visit.is_empty()) {
        (true, _) => visit.to_owned(),
        (_, true) => group.to_owned(),
        _ => format!("{group}, {visit}"),
    }
}

/// Every later group minus the first, over all visits alike; every later visit minus the first, over all groups alike;
/// and by how much the latter differ between groups.
fn contrasts(groups: &[String], visits: &[String]) -> Vec<(String, Vec<f64>)> {
    let (n, m) = (groups.len(), visits.len());
    let weights = |of: &dyn Fn(usize, usize) -> f64| (0..n * m).map(|c| of(c / m, c % m)).collect::<Vec<_>>();
    let step = |i: usize, level: usize| f64::from(u8::from(i == level)) - f64::from(u8::from(i == 0));
    let mut found = Vec::new();
    for g in 1..n {
        let all = weights(&|i, _| step(i, g) / m as f64);
        found.push((format!("{} − {}", groups[g], groups[0]), all));
    }
    for v in 1..m {
        let all = weights(&|_, j| step(j, v) / n as f64);
        found.push((format!("{} − {}", visits[v], visits[0]), all));
    }
    for g in 1..n {
        for v in 1..m {
            let name = format!("({} − {}) in {} − in {}", visits[v], visits[0], groups[g], groups[0]);
            found.push((name, weights(&|i, j| step(i, g) * step(j, v))));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_contrasts_of_two_groups_at_two_visits() {
        let names = |a: &str, b: &str| vec![a.to_owned(), b.to_owned()];
        let found = contrasts(&names("controls", "patients"), &names("before", "after"));
        assert_eq!(
            found,
            [
                ("patients − controls".to_owned(), vec![-0.5, -0.5, 0.5, 0.5]),
                ("after − before".to_owned(), vec![-0.5, 0.5, -0.5, 0.5]),
                ("(after − before) in patients − in controls".to_owned(), vec![1.0, -1.0, -1.0, 1.0]),
            ]
        );
        let found = contrasts(&[String::new()], &["1", "2", "3"].map(str::to_owned));
        assert_eq!(found[1], ("3 − 1".to_owned(), vec![-1.0, 0.0, 1.0]));
    }
}
