//! The name that was meant.

/// The candidate most like `name`, if it is alike enough to be a slip: case, spaces and underscores do not count, and
/// at most a third of the letters differ.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let plain = |text: &str| -> String {
        text.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).take(80).collect()
    };
    let wanted = plain(name);
    candidates
        .into_iter()
        .map(|candidate| (strsim::osa_distance(&wanted, &plain(candidate)), candidate))
        .filter(|(distance, candidate)| *distance * 3 <= plain(candidate).chars().count().max(wanted.chars().count()))
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_nearest_name() {
        let names = ["emg", "columns", "max_isometric_force"];
        assert_eq!(nearest("egm", names).as_deref(), Some("emg"));
        assert_eq!(nearest("Max Isometric Force", names).as_deref(), Some("max_isometric_force"));
        assert_eq!(nearest("colums", names).as_deref(), Some("columns"));
        assert_eq!(nearest("trigger", names), None);
        assert_eq!(nearest("", names), None);
    }
}
