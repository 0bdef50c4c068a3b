//! What the name of a file says about its trial: `S01_isometric_flexion_50_+30deg_rep1`.

use carpus_study::study::{Contraction, Direction};

/// What a name says; `None` where it says nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Named {
    /// Kind of contraction.
    pub contraction: Option<Contraction>,
    /// Whether the name says that the machine kept the speed.
    pub is_isokinetic: bool,
    /// Direction of the effort.
    pub direction: Option<Direction>,
    /// Effort [% of the maximum].
    pub effort_percent: Option<f64>,
    /// Angle [deg].
    pub posture_deg: Option<f64>,
    /// Number of the repetition.
    pub repetition: Option<u32>,
}

impl Named {
    /// Takes from another name what this one does not say.
    pub fn add(&mut self, other: Named) {
        self.contraction = self.contraction.or(other.contraction);
        self.is_isokinetic |= other.is_isokinetic;
        self.direction = self.direction.or(other.direction);
        self.effort_percent = self.effort_percent.or(other.effort_percent);
        self.posture_deg = self.posture_deg.or(other.posture_deg);
        self.repetition = self.repetition.or(other.repetition);
    }
}

/// Words for contractions, as laboratories write them, and what they mean here.
const CONTRACTIONS: [(&str, Contraction); 31] = [
    ("mvc", Contraction::Mvc),
    ("mvic", Contraction::Mvc),
    ("mvif", Contraction::Mvc),
    ("max", Contraction::Mvc),
    ("maximal", Contraction::Mvc),
    ("maximum", Contraction::Mvc),
    ("isom", Contraction::Isometric),
    ("isometric", Contraction::Isometric),
    ("isometrisch", Contraction::Isometric),
    ("isometrico", Contraction::Isometric),
    ("iso", Contraction::Isometric),
    ("static", Contraction::Isometric),
    ("statisch", Contraction::Isometric),
    ("hold", Contraction::Isometric),
    ("isot", Contraction::Isotonic),
    ("isotonic", Contraction::Isotonic),
    ("isotonisch", Contraction::Isotonic),
    ("isok", Contraction::Isotonic),
    ("isokin", Contraction::Isotonic),
    ("isokinetic", Contraction::Isotonic),
    ("isokinetisch", Contraction::Isotonic),
    ("conc", Contraction::Isotonic),
    ("concentric", Contraction::Isotonic),
    ("ecc", Contraction::Isotonic),
    ("dynamic", Contraction::Isotonic),
    ("passive", Contraction::Passive),
    ("passiv", Contraction::Passive),
    ("relaxed", Contraction::Passive),
    ("rest", Contraction::Passive),
    ("free", Contraction::Freehand),
    ("freehand", Contraction::Freehand),
];

/// Words for directions.
const DIRECTIONS: [(&str, Direction); 10] = [
    ("flexion", Direction::Flexion),
    ("flex", Direction::Flexion),
    ("flx", Direction::Flexion),
    ("fl", Direction::Flexion),
    ("beugung", Direction::Flexion),
    ("extension", Direction::Extension),
    ("ext", Direction::Extension),
    ("ex", Direction::Extension),
    ("exten", Direction::Extension),
    ("streckung", Direction::Extension),
];

/// Ends of numbers that are angles.
const ANGLES: [&str; 4] = ["deg", "degrees", "grad", "°"];

/// Words of names that say which recorder a file is of.
pub const RECORDERS: [&str; 16] = [
    "emg",
    "semg",
    "delsys",
    "trigno",
    "noraxon",
    "biodex",
    "humac",
    "cybex",
    "raw",
    "export",
    "torque",
    "dyno",
    "dynamometer",
    "data",
    "isomed",
    "contrex",
];

/// Reads a name; words are separated by anything but letters, digits, signs and `%`, or by the change from letters to
/// digits.
pub fn of_name(name: &str) -> Named {
    let mut named = Named::default();
    let of_participant = participant(name).map_or(0, |participant| participant.len());
    let words = words(&name[of_participant..]);
    let mut numbers: Vec<(usize, f64)> = Vec::new();
    for (i, word) in words.iter().enumerate() {
        if let Some((_, contraction)) = CONTRACTIONS.iter().find(|(known, _)| known == word) {
            // `isometric MVC`: the maximum is what counts.
            if *contraction == Contraction::Mvc || named.contraction.is_none() {
                named.contraction = Some(*contraction);
            }
            named.is_isokinetic |= word.starts_with("isok");
        } else if let Some((_, direction)) = DIRECTIONS.iter().find(|(known, _)| known == word) {
            named.direction = Some(*direction);
        } else if let Some(percent) = number_before(word, &["%", "pct", "percent", "proz", "prozent"]) {
            named.effort_percent = Some(percent);
        } else if let Some(angle) = number_before(word, &ANGLES) {
            named.posture_deg = Some(angle);
        } else if let Some(angle) = signed(word) {
            named.posture_deg = Some(angle);
        } else if let Some(count) = after(word, &["rep", "r", "trial", "t", "run", "wdh", "set", "no"]) {
            named.repetition = Some(count);
        } else if let Ok(number) = word.parse::<f64>() {
            let before = i.checked_sub(1).map(|k| words[k].as_str());
            match before {
                Some("rep" | "trial" | "run" | "wdh" | "set" | "no" | "versuch") => {
                    named.repetition = whole(number);
                }
                Some("neg" | "minus") => named.posture_deg = Some(-number),
                Some("pos" | "plus" | "at") => named.posture_deg = Some(number),
                _ => numbers.push((i, number)),
            }
        }
    }
    // What is left without a word: a last small number counts repetitions, multiples of five are efforts.
    if let Some((i, number)) = numbers.last().copied()
        && i + 1 == words.len()
        && named.repetition.is_none()
        && whole(number).is_some_and(|n| n <= 20)
    {
        named.repetition = whole(number);
        numbers.pop();
    }
    let is_effort = |number: f64| (5.0..=100.0).contains(&number) && number % 5.0 == 0.0;
    if named.effort_percent.is_none()
        && let Some((_, effort)) = numbers.iter().find(|(_, number)| is_effort(*number))
    {
        named.effort_percent = Some(*effort);
    }
    named
}

fn words(name: &str) -> Vec<String> {
    let is_part = |c: char| c.is_alphanumeric() || matches!(c, '%' | '°' | '+' | '-' | '.');
    let mut words: Vec<String> = Vec::new();
    for word in name.to_lowercase().split(|c: char| !is_part(c)) {
        let word = word.trim_matches('.');
        // A minus is a sign before a number, and a dash elsewhere.
        if word.starts_with(['+', '-']) && word.chars().nth(1).is_some_and(char::is_numeric) {
            words.push(word.to_owned());
        } else {
            words.extend(word.split('-').filter(|part| !part.is_empty()).map(str::to_owned));
        }
    }
    words
}

fn number_before(word: &str, ends: &[&str]) -> Option<f64> {
    ends.iter().find_map(|end| {
        let number = word.strip_suffix(end)?;
        let number = number.strip_prefix('p').unwrap_or(number);
        match number.strip_prefix(['n', 'm']).or_else(|| number.strip_prefix("neg")) {
            Some(size) => size.parse::<f64>().ok().map(|size| -size),
            None => number.parse().ok(),
        }
    })
}

/// `+30`, `-30`, `n30`, `p30`, `neg30`.
fn signed(word: &str) -> Option<f64> {
    let size = |prefix: &str| word.strip_prefix(prefix)?.parse::<f64>().ok().filter(|size| size.fract() == 0.0);
    let minus = || ["-", "neg", "n", "m"].iter().find_map(|prefix| size(prefix)).map(|size| -size);
    minus().or_else(|| ["+", "pos", "p"].iter().find_map(|prefix| size(prefix)))
}

fn after(word: &str, begins: &[&str]) -> Option<u32> {
    begins.iter().find_map(|begin| word.strip_prefix(begin)?.parse().ok())
}

fn whole(number: f64) -> Option<u32> {
    (number.fract() == 0.0 && (0.0..=1e6).contains(&number)).then_some(number as u32)
}

/// A name of a participant that a word is: `S01`, `P2`, `Sub-12`, `VP_07`, `Proband 3`.
pub fn participant(word: &str) -> Option<String> {
    let letters: String = word.chars().take_while(|c| c.is_alphabetic()).collect();
    let rest = word[letters.len()..].trim_start_matches(['_', '-', ' ']);
    let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
    let starts =
        ["s", "sub", "subj", "subject", "p", "pat", "part", "participant", "vp", "proband", "prob", "id", "tn"];
    let is_known = starts.contains(&letters.to_lowercase().as_str());
    // A letter behind the number is a part of the name: the visits P01a and P01b.
    let after = &rest[digits.len()..];
    let letter = after.chars().next().filter(char::is_ascii_alphabetic).map_or(0, char::len_utf8);
    let ends = after[letter..].chars().next().is_none_or(|c| !c.is_alphanumeric());
    let length = word.len() - after.len() + letter;
    (is_known && !digits.is_empty() && ends).then(|| word[..length].to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_names_of_files_say_what_the_trial_is() {
        let of = |name: &str| {
            let n = of_name(name);
            (
                n.contraction.map(Contraction::word),
                n.direction.map(Direction::word),
                n.effort_percent,
                n.posture_deg,
                n.repetition,
            )
        };
        let flexion = Some("flexion");
        let isometric = Some("isometric");
        assert_eq!(of("S01_isometric_flexion_50_+30deg_rep1"), (isometric, flexion, Some(50.0), Some(30.0), Some(1)));
        assert_eq!(of("ISOM FLEX 50 -30deg 2"), (isometric, flexion, Some(50.0), Some(-30.0), Some(2)));
        assert_eq!(
            of("isometrisch_extension_50_0Grad_1"),
            (isometric, Some("extension"), Some(50.0), Some(0.0), Some(1))
        );
        assert_eq!(of("P02_ISOK_EXT_25%_r3"), (Some("isotonic"), Some("extension"), Some(25.0), None, Some(3)));
        assert_eq!(of("MVC_flexion_1"), (Some("mvc"), flexion, None, None, Some(1)));
        assert_eq!(of("isometric_MVC_ext"), (Some("mvc"), Some("extension"), None, None, None));
        assert_eq!(of("passiv_2"), (Some("passive"), None, None, None, Some(2)));
        assert_eq!(of("iso-flex-n30-50pct-rep 2"), (isometric, flexion, Some(50.0), Some(-30.0), Some(2)));
        assert_eq!(of("calibration"), (None, None, None, None, None));
    }

    #[test]
    fn verif_participants_are_known_by_their_names() {
        for (word, name) in [("S01_MVC", "S01"), ("P2", "P2"), ("Sub-12 x", "Sub-12"), ("S01a", "S01a")] {
            assert_eq!(participant(word).as_deref(), Some(name), "{word}");
        }
        assert_eq!(participant("Proband 3").as_deref(), Some("Proband 3"));
        for word in ["MVC_1", "isometric_50", "EMG", "P", "pos30", "p30deg"] {
            assert_eq!(participant(word), None, "{word}");
        }
    }
}
