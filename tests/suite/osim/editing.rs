//! Edits: one line changes, the file's own layout is kept, OpenSim reads the result.

use carpus::osim::spec::{ForceKind, MuscleKind};
use carpus::osim::{ComponentSet, EditError, OsimFile};

use super::against_opensim::opensim_dump;
use super::lab_models;
use super::small_models::{FORMAT_40000, format_30000};
use crate::reference::lab_models_if_here;

fn small() -> OsimFile {
    OsimFile::parse(FORMAT_40000.as_bytes(), "small.osim").expect("valid")
}

/// Lines of `after` that are not in `before` at the same place, when the number of lines is the same.
fn changed_lines(before: &[u8], after: &[u8]) -> Vec<String> {
    let lines = |bytes: &[u8]| -> Vec<String> {
        String::from_utf8_lossy(bytes).split_inclusive('\n').map(str::to_owned).collect()
    };
    let (before, after) = (lines(before), lines(after));
    assert_eq!(before.len(), after.len(), "no line added or removed");
    before.into_iter().zip(after).filter(|(a, b)| a != b).map(|(_, b)| b).collect()
}

#[test]
fn verif_setting_a_parameter_changes_one_line() {
    let mut file = small();
    file.set_muscle_property("BRD", "optimal_fiber_length", 0.1 + 0.2).expect("set");
    let changed = changed_lines(FORMAT_40000.as_bytes(), file.document.bytes());
    assert_eq!(changed, ["\t\t\t\t\t<optimal_fiber_length>0.30000000000000004</optimal_fiber_length>\n"]);
    assert_eq!(file.spec.muscles[0].optimal_fiber_length, 0.1 + 0.2);
    file.set_muscle_property("BRD", "optimal_fiber_length", 0.16).expect("set");
    assert_eq!(file.document.bytes(), FORMAT_40000.as_bytes(), "setting it back gives the same bytes");
}

#[test]
#[cfg_attr(not(has_models), ignore = "needs models (CARPUS_MODELS or CARPUS_SHARED)")]
fn verif_every_parameter_of_every_lab_muscle_changes_one_line() {
    for path in lab_models() {
        let original = OsimFile::read(&path).unwrap_or_else(|error| panic!("{error}"));
        // A sample of muscles: each change reads the whole file again.
        for i in (0..original.spec.muscles.len()).step_by(25) {
            let mut file = original.clone();
            let muscle = original.spec.muscles[i].clone();
            let value = 1.01 * muscle.optimal_fiber_length;
            file.set_muscle_property(&muscle.name, "optimal_fiber_length", value)
                .unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(changed_lines(original.document.bytes(), file.document.bytes()).len(), 1, "{}", muscle.name);
            assert_eq!(file.spec.muscles[i].optimal_fiber_length, value);
        }
    }
}

#[test]
fn verif_absent_properties_are_added_with_the_indentation_of_the_file() {
    let mut file = small();
    file.set_muscle_property("BRD", "max_contraction_velocity", 8.0).expect("added");
    file.set_muscle_property("BRD", "FiberForceLengthCurve/curviness", 0.5).expect("was empty");
    file.set_muscle_property("BRD", "TendonForceLengthCurve/strain_at_one_norm_force", 0.05).expect("new curve");
    let text = String::from_utf8_lossy(file.document.bytes()).into_owned();
    assert!(text.contains("\n\t\t\t\t\t<max_contraction_velocity>8</max_contraction_velocity>\n"), "{text}");
    assert!(text.contains("\n\t\t\t\t\t\t<curviness>0.5</curviness>\n"));
    assert!(text.contains(
        "\n\t\t\t\t\t<TendonForceLengthCurve>\n\
        \t\t\t\t\t\t<strain_at_one_norm_force>0.05</strain_at_one_norm_force>\n\
        \t\t\t\t\t</TendonForceLengthCurve>\n"
    ));
    let MuscleKind::Millard2012Equilibrium(millard) = &file.spec.muscles[0].kind else { panic!("class") };
    assert_eq!(millard.fiber_force_length.curviness, Some(0.5));
    assert_eq!(millard.tendon_force_length.strain_at_one_norm_force, 0.05);
    assert_eq!(file.spec.muscles[0].max_contraction_velocity, 8.0);
}

#[test]
fn verif_line_ends_of_the_file_are_kept() {
    let mut file = OsimFile::parse(format_30000(), "old.osim").expect("valid");
    file.set_muscle_property("BRD", "tendon_slack_length", 0.25).expect("added");
    let text = String::from_utf8_lossy(file.document.bytes()).into_owned();
    assert!(text.contains("\r\n          <tendon_slack_length>0.25</tendon_slack_length>\r\n"));
    assert_eq!(text.matches('\n').count(), text.matches("\r\n").count());
}

#[test]
fn verif_forces_can_be_added() {
    let mut file = small();
    let fragment =
        "<CoordinateLimitForce name=\"extra\">\n  <coordinate>elbow_flexion</coordinate>\n</CoordinateLimitForce>";
    file.add_force(fragment).expect("added");
    let text = String::from_utf8_lossy(file.document.bytes()).into_owned();
    assert!(text.contains(
        "\t\t\t\t</CoordinateLimitForce>\n\t\t\t\t<CoordinateLimitForce name=\"extra\">\n\
        \t\t\t\t\t<coordinate>elbow_flexion</coordinate>\n\t\t\t\t</CoordinateLimitForce>\n\t\t\t</objects>"
    ));
    assert!(matches!(file.spec.forces[1].kind, ForceKind::CoordinateLimit { .. }));
    let marker = "<Marker name=\"m\"><socket_parent_frame>/ground</socket_parent_frame></Marker>";
    file.add_component(ComponentSet::Markers, marker).expect("set created");
    assert_eq!(file.spec.markers.len(), 1);
}

#[test]
fn verif_components_come_and_go_together() {
    let marker = |name: &str| {
        format!(
            "<Marker name=\"{name}\">\n\t<socket_parent_frame>/ground</socket_parent_frame>\n\t<location>0 0 \
             0</location>\n</Marker>"
        )
    };
    let (mut one, mut two) = (small(), small());
    one.add_components(ComponentSet::Markers, &[marker("b")]).expect("added");
    two.add_components(ComponentSet::Markers, &[marker("a"), marker("b"), marker("c")]).expect("added");
    let changes = [("/markerset/a", "location", "1 0 0".to_owned()), ("/markerset/b", "fixed", "true".to_owned())];
    two.set_properties(&changes).expect("set");
    assert_eq!((two.spec.markers[0].location.x, two.spec.markers[1].fixed), (1.0, true));
    let changes = [("/markerset/c", "location", "3 0 0".to_owned()), ("/markerset/c", "location", "4 0 0".to_owned())];
    two.set_properties(&changes).expect("the last one counts");
    assert_eq!(two.spec.markers[2].location.x, 4.0);
    two.remove_components(&["/markerset/c", "/markerset/a", "/markerset/c"]).expect("removed");
    one.set_property("/markerset/b", "fixed", "true").expect("set");
    assert_eq!(String::from_utf8_lossy(two.document.bytes()), String::from_utf8_lossy(one.document.bytes()));
    let before = two.document.bytes().to_vec();
    let changes = [("/markerset/b", "location", "9 9 9".to_owned()), ("/markerset/gone", "fixed", "true".to_owned())];
    assert!(two.set_properties(&changes).is_err(), "all or none");
    assert!(two.remove_components(&["/markerset/b", "/markerset/gone"]).is_err());
    assert!(two.remove_components(&["/bodyset/forearm"]).is_err(), "a joint needs it");
    assert_eq!(two.document.bytes(), before);
}

#[test]
fn verif_refused_edits_leave_the_file_as_it_was() {
    let mut file = small();
    let before = file.document.bytes().to_vec();
    let unknown = file.set_muscle_property("BDR", "optimal_fiber_length", 0.1).expect_err("unknown muscle");
    assert_eq!(unknown.hint().as_deref(), Some("did you mean \"BRD\"?"));
    let unknown = file.set_muscle_property("BRD", "optimal_fibre_length", 0.1).expect_err("unknown property");
    assert_eq!(unknown.hint().as_deref(), Some("did you mean \"optimal_fiber_length\"?"));
    let negative = file.set_muscle_property("BRD", "optimal_fiber_length", -0.1).expect_err("negative");
    assert!(matches!(negative, EditError::Invalid(_)));
    assert!(file.set_muscle_property("BRD", "optimal_fiber_length", f64::NAN).is_err());
    let changes = [("BRD", "max_isometric_force", 300.0), ("BRD", "max_contraction_velocity", -1.0)];
    assert!(file.set_muscle_properties(&changes).is_err(), "all or none");
    assert!(file.add_force("<A/><B/>").is_err());
    assert!(file.add_force("<CoordinateLimitForce><coordinate>q</coordinate></CoordinateLimitForce>").is_err());
    assert!(matches!(file.set_property("/bodyset/hand", "mass", "1"), Err(EditError::UnknownComponent { .. })));
    assert!(matches!(
        file.set_property("/forceset/BRD", "FiberForceLengthCurve", "1"),
        Err(EditError::NotAValue { .. })
    ));
    assert_eq!(file.document.bytes(), before);
    file.set_property("/bodyset/forearm", "mass", "2").expect("set");
    assert_eq!(file.spec.bodies[0].mass, 2.0);
}

#[test]
fn verif_muscles_of_the_same_name_are_not_guessed() {
    let start = FORMAT_40000.find("\t\t\t\t<Millard2012").expect("muscle");
    let end = FORMAT_40000.find("\t\t\t\t<CoordinateLimitForce").expect("end");
    let text = format!("{}{}{}", &FORMAT_40000[..end], &FORMAT_40000[start..end], &FORMAT_40000[end..]);
    let mut file = OsimFile::parse(text, "twice.osim").expect("valid");
    assert_eq!(file.spec.muscles[1].name, "BRD_0");
    let refused = file.set_muscle_property("BRD", "optimal_fiber_length", 0.2).expect_err("ambiguous");
    assert!(matches!(refused, EditError::AmbiguousMuscle { ref lines, .. } if lines.len() == 2));
    file.set_muscle_property("BRD_0", "optimal_fiber_length", 0.2).expect("OpenSim's own name is clear");
    assert_eq!(file.spec.muscles[1].optimal_fiber_length, 0.2);
}

/// A model that a group may read stays so; a new one is not as private as a temporary file.
#[cfg(unix)]
#[test]
fn verif_a_file_that_is_replaced_keeps_its_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.osim");
    let mode = || std::fs::metadata(&path).unwrap().permissions().mode() & 0o777;
    small().write(&path).expect("written");
    assert_eq!(mode(), 0o644);
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o664)).unwrap();
    small().write(&path).expect("replaced");
    assert_eq!(mode(), 0o664);
}

#[test]
fn verif_writing_replaces_the_file_or_leaves_it() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("model.osim");
    let mut file = small();
    file.write(&path).expect("written");
    assert_eq!(std::fs::read(&path).expect("readable"), FORMAT_40000.as_bytes());
    file.set_muscle_property("BRD", "max_isometric_force", 300.0).expect("set");
    file.write(&path).expect("replaced");
    assert_eq!(std::fs::read(&path).expect("readable"), file.document.bytes());
    assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 1, "no temporary file is left");
    let error = file.write(folder.path().join("missing/model.osim")).expect_err("no such folder");
    assert!(error.to_string().contains("missing"), "{error}");
    assert!(error.hint().is_some());
    assert!(file.write(folder.path()).is_err(), "a folder is no file");
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_reads_edited_files_with_the_new_values() {
    let folder = tempfile::tempdir().expect("folder");
    let mut paths = Vec::new();
    let mut files = vec![small()];
    files
        .extend(lab_models_if_here().iter().map(|path| OsimFile::read(path).unwrap_or_else(|error| panic!("{error}"))));
    files.retain(|file| !file.spec.muscles.is_empty());
    for (i, file) in files.iter_mut().enumerate() {
        let muscle = file.spec.muscles[0].name.clone();
        let changes = [
            (muscle.as_str(), "optimal_fiber_length", 0.123_456_789_012_345_67),
            (muscle.as_str(), "tendon_slack_length", 0.1 + 0.2),
            (muscle.as_str(), "max_contraction_velocity", 7.25),
            (muscle.as_str(), "max_isometric_force", 1e-7),
        ];
        file.set_muscle_properties(&changes).unwrap_or_else(|error| panic!("{error}"));
        let coordinate = file.spec.coordinates[0].name.clone();
        let force = format!(
            "<CoordinateLimitForce name=\"added\">\n\t<coordinate>{coordinate}</coordinate>\n\
            \t<upper_stiffness>0.5</upper_stiffness>\n</CoordinateLimitForce>"
        );
        file.add_force(&force).unwrap_or_else(|error| panic!("{error}"));
        let path = folder.path().join(format!("edited_{i:02}.osim"));
        file.write(&path).expect("written");
        paths.push(path);
    }
    let theirs = opensim_dump(&paths);
    for (file, theirs) in files.iter().zip(&theirs) {
        let name = file.document.file();
        assert!(theirs.get("error").is_none(), "{name}: {}", theirs["error"]);
        let muscle = &theirs["muscles"][0];
        assert_eq!(muscle["optimal_fiber_length"], 0.123_456_789_012_345_67, "{name}");
        assert_eq!(muscle["tendon_slack_length"], 0.1 + 0.2, "{name}");
        assert_eq!(muscle["max_contraction_velocity"], 7.25, "{name}");
        assert_eq!(muscle["max_isometric_force"], 1e-7, "{name}");
        let added = theirs["forces"].as_array().expect("forces").last().expect("a force");
        assert_eq!((&added["name"], &added["upper_stiffness"]), (&"added".into(), &0.5.into()), "{name}");
    }
}
