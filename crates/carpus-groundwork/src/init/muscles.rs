//! Which muscle of a model a channel of EMG is of: `FCR`, `Ch 3: FCR`, `R FLEXOR CARPI RADIALIS: EMG 4`, `FLEX.CARP.R`.

/// Muscles of the arm and hand under the abbreviations that models use, and their Latin names.
const NAMES: [(&str, &str); 44] = [
    ("ECRL", "extensor carpi radialis longus"),
    ("ECRB", "extensor carpi radialis brevis"),
    ("ECU", "extensor carpi ulnaris"),
    ("FCR", "flexor carpi radialis"),
    ("FCU", "flexor carpi ulnaris"),
    ("PL", "palmaris longus"),
    ("PT", "pronator teres"),
    ("PQ", "pronator quadratus"),
    ("SUP", "supinator"),
    ("BRD", "brachioradialis"),
    ("BRA", "brachialis"),
    ("BIC", "biceps brachii"),
    ("BIClong", "biceps brachii caput longum"),
    ("BICshort", "biceps brachii caput breve"),
    ("TRI", "triceps brachii"),
    ("TRIlong", "triceps brachii caput longum"),
    ("TRIlat", "triceps brachii caput laterale"),
    ("TRImed", "triceps brachii caput mediale"),
    ("ANC", "anconeus"),
    ("DELT1", "deltoideus anterior"),
    ("DELT2", "deltoideus medius"),
    ("DELT3", "deltoideus posterior"),
    ("FDS", "flexor digitorum superficialis"),
    ("FDSI", "flexor digitorum superficialis index"),
    ("FDSM", "flexor digitorum superficialis medius"),
    ("FDSR", "flexor digitorum superficialis ring"),
    ("FDSL", "flexor digitorum superficialis little"),
    ("FDP", "flexor digitorum profundus"),
    ("FDPI", "flexor digitorum profundus index"),
    ("FDPM", "flexor digitorum profundus medius"),
    ("FDPR", "flexor digitorum profundus ring"),
    ("FDPL", "flexor digitorum profundus little"),
    ("EDC", "extensor digitorum communis"),
    ("EDCI", "extensor digitorum communis index"),
    ("EDCM", "extensor digitorum communis medius"),
    ("EDCR", "extensor digitorum communis ring"),
    ("EDCL", "extensor digitorum communis little"),
    ("EDM", "extensor digiti minimi"),
    ("EIP", "extensor indicis proprius"),
    ("EPL", "extensor pollicis longus"),
    ("EPB", "extensor pollicis brevis"),
    ("FPL", "flexor pollicis longus"),
    ("APL", "abductor pollicis longus"),
    ("FDI", "interosseus dorsalis primus"),
];

/// Words of labels that say nothing about the muscle.
const OTHER_WORDS: [&str; 22] = [
    "m", "musc", "musculus", "muscle", "emg", "ch", "chan", "channel", "sensor", "avanti", "mini", "trigno", "right",
    "left", "rt", "lt", "r", "l", "raw", "uv", "mv", "v",
];

/// What a label says of the muscle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelMuscles {
    /// The model's muscles that are meant; several where the label does not tell them apart.
    pub muscles: Vec<String>,
    /// Whether the label is the muscle's name or abbreviation itself.
    pub is_exact: bool,
}

/// The muscles of a model that a label names; `None` if it names none.
pub fn named(label: &str, muscles: &[&str]) -> Option<ChannelMuscles> {
    let words = words(label);
    let is = |muscle: &&&str| {
        let plain = without_side(muscle).to_lowercase();
        words.contains(&plain) || words.concat() == plain.replace(|c: char| !c.is_alphanumeric(), "")
    };
    if let Some(muscle) = muscles.iter().filter(is).max_by_key(|muscle| muscle.len()) {
        return Some(ChannelMuscles { muscles: vec![(*muscle).to_owned()], is_exact: true });
    }
    // `flex carp r`: of every muscle whose Latin name the words begin, in their order.
    let wanted: Vec<&String> = words.iter().filter(|word| !word.chars().all(char::is_numeric)).collect();
    let missing = |muscle: &&str| {
        let latin = latin(muscle);
        let name: Vec<&str> = latin.split_whitespace().collect();
        let mut at = 0;
        let mut found = 0;
        for word in &wanted {
            let place = name[at..].iter().position(|full| begins(word, full));
            match place {
                Some(place) => {
                    at += place + 1;
                    found += 1;
                }
                None if is_filler(word) => {}
                None => return None,
            }
        }
        (found > 0 && (found >= 2 || name.len() == 1)).then(|| name.len() - found)
    };
    let candidates: Vec<(usize, &str)> = muscles.iter().filter_map(|m| Some((missing(m)?, *m))).collect();
    let least = candidates.iter().map(|(missing, _)| *missing).min()?;
    let found = candidates.iter().filter(|(missing, _)| *missing == least).map(|(_, m)| (*m).to_owned()).collect();
    Some(ChannelMuscles { muscles: found, is_exact: least == 0 })
}

/// Whether a muscle's name says that it flexes (1) or extends (−1) what it moves; 0 if it says neither.
pub fn flexes(muscle: &str) -> f64 {
    let latin = latin(muscle);
    match latin.split_whitespace().next() {
        Some("flexor" | "palmaris" | "biceps" | "brachialis" | "brachioradialis") => 1.0,
        Some("extensor" | "triceps" | "anconeus") => -1.0,
        _ => 0.0,
    }
}

/// The side that a label states.
pub fn side(label: &str) -> Option<&'static str> {
    let words: Vec<String> = split(label);
    let first = words.iter().find(|word| !word.chars().all(char::is_numeric))?;
    let last = words.last()?;
    let of = |word: &str| match word {
        "r" | "rt" | "right" => Some("right"),
        "l" | "lt" | "left" => Some("left"),
        _ => None,
    };
    of(first).or_else(|| of(last).filter(|_| label.contains('_')))
}

fn latin(muscle: &str) -> String {
    let plain = without_side(muscle);
    let known = NAMES.iter().find(|(short, _)| short.eq_ignore_ascii_case(plain));
    known.map_or_else(|| plain.replace(['_', '.'], " ").to_lowercase(), |(_, latin)| (*latin).to_owned())
}

/// Models of one side name it at the end: `FCR_r`.
fn without_side(muscle: &str) -> &str {
    ["_r", "_l", "_R", "_L"].iter().find_map(|end| muscle.strip_suffix(end)).unwrap_or(muscle)
}

fn is_filler(word: &str) -> bool {
    OTHER_WORDS.contains(&word) || word.chars().all(char::is_numeric)
}

/// Words of a label without those that say nothing; a single letter stays where a name may be abbreviated to it.
fn words(label: &str) -> Vec<String> {
    let words = split(label);
    let last = words.len();
    let keeps = |(i, word): &(usize, String)| {
        // `FLEX.CARP.R`: the radialis; `R FLEXOR`: the right side.
        let ends_a_name = matches!(word.as_str(), "r" | "u" | "l" | "b") && *i >= 2;
        (!is_filler(word) || ends_a_name) && *i < last
    };
    words.into_iter().enumerate().filter(keeps).map(|(_, word)| word).collect()
}

fn split(label: &str) -> Vec<String> {
    let words = label.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
    words.map(str::to_lowercase).collect()
}

/// Whether a word is the beginning of another, a slip of two letters of a longer one aside.
fn begins(word: &str, full: &str) -> bool {
    if full.starts_with(word) {
        return true;
    }
    let length = word.chars().count();
    let start: String = full.chars().take(length).collect();
    length >= 4 && carpus_study::study::nearest(word, [start.as_str()]).is_some() && same_letters(word, &start)
}

/// Whether two words have the same letters in another order: `capr` and `carp`.
fn same_letters(a: &str, b: &str) -> bool {
    let sorted = |text: &str| {
        let mut letters: Vec<char> = text.chars().collect();
        letters.sort_unstable();
        letters
    };
    sorted(a) == sorted(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WRIST: [&str; 5] = ["ECRL", "ECRB", "ECU", "FCR", "FCU"];

    fn found(label: &str) -> Vec<String> {
        named(label, &WRIST).map(|found| found.muscles).unwrap_or_default()
    }

    #[test]
    fn verif_labels_of_recorders_name_the_model_s_muscles() {
        for (label, muscle) in [
            ("FCR", "FCR"),
            ("emg_FCR", "FCR"),
            ("FCR_L", "FCR"),
            ("Ch 3: FCR", "FCR"),
            ("flexor carpi radialis", "FCR"),
            ("Flexor Carpi Ulnaris [V]", "FCU"),
            ("R FLEXOR CARPI RADIALIS: EMG 4 [V]", "FCR"),
            ("RT FLEX.CARP.R,uV", "FCR"),
            ("RT FLEX.CARP.U,uV", "FCU"),
            ("FLEX.CAPR.U,uV", "FCU"),
            ("RT EXT.CARP.RAD.L.,uV", "ECRL"),
            ("RT EXT.CARP.ULN.,uV", "ECU"),
            ("M. extensor carpi radialis brevis", "ECRB"),
        ] {
            assert_eq!(found(label), [muscle], "{label}");
        }
        assert_eq!(found("EXT.CARP.RAD."), ["ECRL", "ECRB"]);
        for label in ["BICEPS BR.", "Torque,V", "ACC.X 1", "R FLEXOR CARPI RADIALIS: ACC.X 1", "Sync", "EMG 1", ""] {
            assert_eq!(found(label), Vec::<String>::new(), "{label}");
        }
        let sided = named("FCU", &["FCR_r", "FCU_r"]).unwrap();
        assert_eq!(sided.muscles, ["FCU_r"]);
        assert_eq!((side("RT FLEX.CARP.R"), side("FCR_L"), side("FCR")), (Some("right"), Some("left"), None));
    }
}
