//! Warnings as a page shows them: those that say the same of several places as one.

use super::results::WarningResult;

/// Warnings that say the same, but for numbers.
#[derive(Debug, PartialEq)]
pub struct WarningGroup {
    /// What they say; numbers in which several differ are "…".
    pub message: String,
    /// What to do.
    pub hint: Option<String>,
    /// Where, in the order of the warnings; empty where nowhere.
    pub places: Vec<Place>,
}

/// A place that a warning is about.
#[derive(Debug, PartialEq)]
pub struct Place {
    /// File and line, without folders.
    pub name: String,
    /// File and line.
    pub path: String,
    /// The warning in full.
    pub message: String,
}

/// Groups warnings, in the order of the first of each group.
pub fn groups(warnings: &[WarningResult]) -> Vec<WarningGroup> {
    let mut out: Vec<WarningGroup> = Vec::new();
    for warning in warnings {
        let (message, hint) = (&warning.message, &warning.hint);
        let known = out.iter_mut().find(|g| g.hint == *hint && words(&g.message) == words(message));
        let group = match known {
            Some(group) => {
                group.message = common(&group.message, message);
                group
            }
            None => {
                out.push(WarningGroup { message: message.clone(), hint: hint.clone(), places: Vec::new() });
                let last = out.len() - 1;
                &mut out[last]
            }
        };
        group.places.extend(warning.at.iter().map(|path| Place {
            name: path.rsplit(['/', '\\']).next().unwrap_or(path).to_owned(),
            path: path.clone(),
            message: message.clone(),
        }));
    }
    out
}

/// The words of a message, numbers as "…".
fn words(message: &str) -> Vec<&str> {
    let number = |word: &str| word.trim_matches(|c: char| !c.is_ascii_digit()).parse::<f64>().is_ok();
    message.split(' ').map(|word| if number(word) { "…" } else { word }).collect()
}

/// Two messages of the same words, numbers in which they differ as "…".
fn common(a: &str, b: &str) -> String {
    let pairs = a.split(' ').zip(b.split(' '));
    pairs.map(|(a, b)| if a == b { a } else { "…" }).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_warnings_that_say_the_same_are_one() {
        let warning = |at: &str, message: &str| WarningResult {
            at: Some(at.to_owned()),
            message: message.to_owned(),
            hint: Some("turn it over".to_owned()),
        };
        let found = groups(&[
            warning("/a/b/t1.csv:3", "mean moment is +0.344 N·m in 2 s"),
            warning("/a/b/model.osim", "no mass"),
            warning("/a/c/t2.csv", "mean moment is -1 N·m in 2 s"),
        ]);
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].message, "mean moment is … N·m in 2 s");
        let names: Vec<_> = found[0].places.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names, ["t1.csv:3", "t2.csv"]);
        assert_eq!(found[0].places[1].message, "mean moment is -1 N·m in 2 s");
        assert_eq!((found[1].message.as_str(), found[1].places.len()), ("no mass", 1));
    }
}
