//! Models written in the current format: the same to this program, and to OpenSim 4.6.

use std::path::{Path, PathBuf};

use carpus::multibody::Model;
use carpus::osim::OsimFile;
use carpus::paths::Path as MusclePath;
use serde_json::Value;

use crate::reference::{lab_models, opensim_python, run_script, stem};

/// Relative to the largest number of its kind; format numbers go through decimal text.
const TOLERANCE: f64 = 1e-9;

fn shipped() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/upgrade");
    ["arm_20302.osim", "arm_30000.osim"].iter().map(|name| folder.join(name)).collect()
}

fn lengths(file: &OsimFile) -> Vec<f64> {
    let model = Model::compile(&file.spec).unwrap();
    let q = model.default_coordinates();
    let mut cache = model.new_cache();
    model.update_positions(&q, &mut cache);
    let length = |path| {
        let path = MusclePath::compile(path, &file.spec, &model).unwrap();
        let mut geometry = path.new_geometry();
        path.update(&q, &cache, &mut geometry);
        geometry.length()
    };
    file.spec.muscles.iter().map(|m| length(&m.path)).collect()
}

#[test]
fn verif_upgraded_models_read_back_as_they_were() {
    for path in shipped() {
        let old = OsimFile::read(&path).unwrap();
        let upgraded = old.upgraded().unwrap();
        assert!(upgraded.left_out.is_empty(), "{:?}", upgraded.left_out);
        let new = &upgraded.file;
        assert_eq!(new.spec.document_version, 40600);
        assert_eq!(lengths(&old), lengths(new));
        let names = |file: &OsimFile| -> Vec<String> {
            let spec = &file.spec;
            let forces = spec.forces.iter().map(|f| format!("{} {:?}", f.at.path, f.applies_force));
            let muscles = spec.muscles.iter().map(|m| format!("{} {}", m.at.path, m.max_isometric_force));
            let coordinates =
                spec.coordinates.iter().map(|c| format!("{} {:?} {:?}", c.at.path, c.range, c.motion_type));
            let frames = spec.frames.iter().map(|f| f.at.path.clone());
            forces.chain(muscles).chain(coordinates).chain(frames).collect()
        };
        let (mut before, mut after) = (names(&old), names(new));
        before.sort();
        after.sort();
        assert_eq!(before, after);
        assert_eq!(old.spec.markers[0].location, new.spec.markers[0].location);
        assert!(String::from_utf8_lossy(new.document.bytes()).contains("<mesh_file>upper.vtp</mesh_file>"));
        // The current format stays as it is.
        assert_eq!(new.upgraded().unwrap().file.document.bytes(), new.document.bytes());
    }
}

/// OpenSim computes the same of the upgrade as of the old file.
fn compare_in_opensim(path: &Path, tolerance: f64) {
    let python = opensim_python();
    let folder = tempfile::tempdir().unwrap();
    let new = folder.path().join("new.osim");
    let upgraded = OsimFile::read(path).unwrap().upgraded().unwrap();
    upgraded.file.write(&new).unwrap();
    let out = folder.path().join("out.json");
    run_script(&python, "scripts/upgrade.py", &[path.as_os_str(), new.as_os_str(), out.as_os_str()]);
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
    let name = stem(path);
    println!("{name}: {found}");
    assert_eq!(found["same_names"], true, "{name}");
    // Forces and accelerations are compared where nothing was left out.
    let all = upgraded.left_out.is_empty();
    let kinds = ["masses", "lengths", "arms", "forces", "accelerations"];
    for kind in kinds.iter().take(if all { 5 } else { 3 }) {
        let difference = found[*kind].as_f64().unwrap_or(f64::INFINITY);
        assert!(difference <= tolerance, "{name}, {kind}: {}", found[*kind]);
    }
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_upgraded_shipped_models() {
    shipped().iter().for_each(|path| compare_in_opensim(path, TOLERANCE));
}

#[test]
#[cfg_attr(
    not(all(has_opensim, has_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and models (CARPUS_MODELS or CARPUS_SHARED)"
)]
fn val_opensim_upgraded_lab_models() {
    for path in lab_models() {
        let old = OsimFile::read(&path).is_ok_and(|file| file.spec.document_version < 40600);
        if old {
            compare_in_opensim(&path, TOLERANCE);
        }
    }
}

#[test]
fn verif_upgrade_keeps_what_assembly_and_sets_need() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/upgrade/arm_30000.osim");
    let text = std::fs::read_to_string(path).unwrap();
    let coordinate = text.find("<Coordinate name=").expect("a coordinate");
    let at = coordinate + text[coordinate..].find('>').expect("its end") + 1;
    let name = text[coordinate..].split('"').nth(1).expect("its name");
    let free = "<is_free_to_satisfy_constraints>true</is_free_to_satisfy_constraints>";
    let set = format!(
        "<ComponentSet name=\"componentset\"><objects><SpringGeneralizedForce \
         name=\"s\"><coordinate>{name}</coordinate><stiffness>5</stiffness></SpringGeneralizedForce></objects>\
         </ComponentSet></Model>"
    );
    let text = format!("{}{free}{}", &text[..at], &text[at..]).replace("</Model>", &set);
    let old = OsimFile::parse(text.into_bytes(), "old.osim").unwrap();
    let new = old.upgraded().unwrap().file;
    for file in [&old, &new] {
        let free: Vec<&str> = file
            .spec
            .coordinates
            .iter()
            .filter(|c| c.is_free_to_satisfy_constraints)
            .map(|c| c.name.as_str())
            .collect();
        assert_eq!(free, [name]);
        assert!(file.spec.forces.iter().any(|f| f.at.path == "/componentset/s"));
    }
}
