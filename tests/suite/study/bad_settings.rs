use carpus::study::Fault;

use super::folder::{Folder, TOML, list, says};

#[test]
fn verif_missing_study_file() {
    let folder = Folder::good();
    std::fs::remove_file(folder.path("study.toml")).unwrap();
    says(&folder.only_error("study.toml", None), "study.toml not found", "");
}

#[test]
fn verif_broken_toml_is_an_error_at_its_line() {
    let error = Folder::spoilt("study.toml", "name = \"Two muscles\"", "name = \"Two muscles").errors();
    assert_eq!(error[0].line, Some(2), "{}", list(&error));
    assert!(matches!(error[0].fault, Fault::TomlSyntax { .. }));
}

#[test]
fn verif_unknown_key_is_an_error_with_a_near_name() {
    let folder = Folder::spoilt("study.toml", "damping_n_m_s_per_deg", "dampng_n_m_s_per_deg");
    says(
        &folder.only_error("study.toml", 7),
        "unknown key `dampng_n_m_s_per_deg` in [dynamometer]",
        "`damping_n_m_s_per_deg`",
    );
}

#[test]
fn verif_unknown_section_is_an_error_with_a_near_name() {
    let folder = Folder::spoilt("study.toml", "[posture_deg]", "[Posture]");
    let errors = folder.errors();
    assert_eq!(errors.len(), 1, "{}", list(&errors));
    assert_eq!(errors[0].line, Some(10));
    says(&errors[0], "unknown section [Posture]", "");
    let folder = Folder::spoilt("study.toml", "[emg]", "[egm]");
    says(&folder.only_error("study.toml", 17), "unknown section [egm]", "did you mean [emg]?");
}

#[test]
fn verif_missing_keys_are_reported_together() {
    let folder = Folder::good();
    folder.write("study.toml", "[study]\n[emg]\n");
    let errors = folder.errors();
    let missing: Vec<&str> = errors
        .iter()
        .filter_map(|e| match &e.fault {
            Fault::MissingKey { key, .. } => Some(key.as_str()),
            _ => None,
        })
        .collect();
    assert_eq!(missing, ["name", "model", "coordinate", "active"], "{}", list(&errors));
}

#[test]
fn verif_values_of_the_wrong_kind() {
    for (from, to, line, message) in [
        ("name = \"Two muscles\"", "name = 7", 2, "`name`: expected a non-empty string, found 7"),
        ("0.005", "-0.005", 7, "`damping_n_m_s_per_deg`: expected a number, 0 or more"),
        ("0.005", "nan", 7, "`damping_n_m_s_per_deg`: expected a number, 0 or more"),
        ("elbow_flexion = 90", "elbow_flexion = \"90\"", 11, "found the text \"90\""),
        ("active = [\"ECRL\", \"FCR\"]", "active = []", 15, "found an empty list"),
        ("active = [\"ECRL\", \"FCR\"]", "active = [\"ECRL\", \"ECRL\"]", 15, "list entry `ECRL` stands here again"),
        ("\"passive\"]", "\"pasive\"]", 8, "unknown part of the moment `pasive`"),
        ("elbow_flexion = 90", "flexion = 90", 11, "a coordinate other than the dynamometer's"),
        ("\"normalized\"", "\"normalised\"", 18, "unknown EMG kind `normalised`"),
    ] {
        says(&Folder::spoilt("study.toml", from, to).only_error("study.toml", line), message, "");
    }
}

#[test]
fn verif_bounds_must_be_ordered() {
    for bad in ["[110, 90]", "[0, 90]", "[90]", "[90, 100, 110]", "90", "[90, \"x\"]"] {
        let folder = Folder::good();
        folder.write("study.toml", format!("{TOML}[personalization]\nmax_isometric_force = {bad}\n"));
        says(&folder.only_error("study.toml", 20), "[lower, upper] in percent", "");
    }
}

#[test]
fn verif_emg_table_must_name_exactly_the_active_muscles() {
    let folder = Folder::good();
    folder.write("study.toml", format!("{TOML}[columns]\nemg = {{ ECRL = \"emg_ECRL\", FCRR = \"emg_FCR\" }}\n"));
    let errors = folder.read().unwrap_err().errors;
    let at_line_20 = errors.iter().filter(|e| e.line == Some(20)).count();
    assert_eq!(at_line_20, 2, "{}", list(&errors));
    assert!(errors.iter().any(|e| matches!(&e.fault, Fault::UnknownKey { nearest: Some(n), .. } if n == "FCR")));
    let folder = Folder::good();
    folder.write("study.toml", format!("{TOML}[columns]\nemg = \"emg\"\n"));
    assert!(folder.errors().iter().any(|e| e.line == Some(20) && e.to_string().contains("{muscle}")));
}

#[test]
fn verif_missing_model_is_named_with_the_line_that_names_it() {
    let folder = Folder::spoilt("study.toml", "wrist.osim", "models/hand.osim");
    says(&folder.only_error("models/hand.osim", None), "model not found", "study.toml:3");
}

#[test]
fn verif_not_text() {
    let folder = Folder::good();
    folder.write("study.toml", b"\xff\xfe\x00");
    says(&folder.only_error("study.toml", None), "not UTF-8", "UTF-8");
}

#[test]
fn verif_a_file_that_is_no_study_is_told_in_one_error() {
    let mut rows = "time_s,angle_deg\n".to_owned();
    (0..2000).for_each(|i| rows += &format!("{i},{i}\n"));
    let model = include_str!("../../../models/wrist.osim");
    let setup = "<?xml version=\"1.0\"?>\n<OpenSimDocument><AnalyzeTool/></OpenSimDocument>";
    for (text, found) in
        [(model, "a model"), (setup, "an XML file"), (rows.as_str(), "a table"), ("{\n\"a\": 1}", "a JSON file")]
    {
        let folder = Folder::good();
        folder.write("study.toml", text);
        let problem = folder.only_error("study.toml", None);
        says(&problem, &format!("this is {found}; expected a study"), "");
        assert!(problem.hint().is_some());
    }
}

#[test]
fn verif_a_column_holds_one_quantity() {
    let folder = Folder::good();
    folder.write("study.toml", format!("{TOML}\n[columns]\nmoment = \"emg_FCR\"\n"));
    let errors = folder.errors();
    assert!(errors.iter().any(|e| e.to_string().contains("expected a column of its own")), "{}", list(&errors));
}
