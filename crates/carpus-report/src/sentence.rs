//! Names within sentences.

/// Names joined by ` + ` as they stand within a sentence: abbreviations keep their capitals.
pub(super) fn within_sentence(names: &str) -> String {
    let lowered = |name: &str| {
        let mut letters = name.chars();
        let first = letters.next();
        let abbreviation = letters.clone().next().is_some_and(char::is_uppercase);
        match first {
            Some(c) if !abbreviation => c.to_lowercase().collect::<String>() + letters.as_str(),
            _ => name.to_string(),
        }
    };
    names.split(" + ").map(lowered).collect::<Vec<_>>().join(" + ")
}
