//! An effect in full, for a terminal.

use carpus_effects::effect::Description;
use carpus_session::effect_words::{form, parameter, stage};

/// Lines of the description of one effect are broken before this column.
const WIDTH: usize = 100;
/// Width of the labels before them.
const LABEL: usize = 14;

/// All that is known of an effect.
pub fn details(d: &Description) -> String {
    let mut text = format!("{} ({})\n\n", d.name, d.id);
    let mut line = |label: &str, content: &str| text.push_str(&labelled(label, content));
    line("Equation", d.equation);
    line("Acts on", stage(d.stage));
    d.parameters.iter().for_each(|p| line("Parameter", &parameter(p)));
    line("Shows as", d.signature);
    line("Exposed by", d.experiment);
    line("Rivals", &if d.rivals.is_empty() { "none".to_string() } else { d.rivals.join(", ") });
    let (kind, what) = form(d);
    line("In a model", &format!("{kind}: {what}"));
    let identifiable = match d.unidentifiable {
        Some(why) => format!("no: {why}"),
        None => "where the trials allow it; carpus diagnose says so".to_string(),
    };
    line("Identifiable", &identifiable);
    text.trim_end().to_string()
}

/// A labelled paragraph, its lines indented behind the label.
fn labelled(label: &str, content: &str) -> String {
    let mut text = format!("{label:LABEL$}");
    let mut column = LABEL;
    for (i, word) in content.split_whitespace().enumerate() {
        let width = word.chars().count();
        if i > 0 && column + 1 + width > WIDTH {
            text.push_str(&format!("\n{:LABEL$}", ""));
            column = LABEL;
        } else if i > 0 {
            text.push(' ');
            column += 1;
        }
        text.push_str(word);
        column += width;
    }
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_effects::catalogue::CATALOGUE;

    #[test]
    fn verif_every_effect_is_told_in_full_and_in_lines_that_fit() {
        for d in CATALOGUE.iter().map(|e| e.description()) {
            let text = details(d);
            let flat = text.split_whitespace().collect::<Vec<_>>().join(" ");
            for part in [d.id, d.equation, d.signature, d.experiment, form(d).1] {
                let part = part.split_whitespace().collect::<Vec<_>>().join(" ");
                assert!(flat.contains(&part), "{}: {part}", d.id);
            }
            for p in d.parameters {
                assert!(flat.contains(p.name) && flat.contains(p.unit), "{}.{}", d.id, p.name);
            }
            assert!(text.lines().all(|l| l.chars().count() <= WIDTH), "{text}");
        }
    }
}
