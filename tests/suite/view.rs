//! `carpus view`: the page of a model, opened in Chromium, gives the numbers of the program.

use std::path::Path;
use std::process::Command as Process;

use serde_json::{Value, json};

use crate::live::{assert_calm, downloaded};
use crate::reference::shared;
use crate::user_loop::{carpus, json as json_of, read, root};

/// Lengths and moment arms of page and program agree so well [m]: the two have another maths library.
const SAME: f64 = 1e-9;

fn seen_in_browser(page: &Path, plan: &Value) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    std::fs::write(file("plan.json"), plan.to_string()).unwrap();
    let mut browser = Process::new("node");
    browser.arg(root("crates/carpus-web/page/test/view.mjs")).arg(page).args([file("plan.json"), file("seen.json")]);
    let output = browser.output().expect("Node is here");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    json_of(file("seen.json"))
}

/// The page of a model; what the command says of it.
fn viewed(model: &Path, page: &Path, more: &[&str]) -> Value {
    let output = carpus().arg("view").arg(model).arg("-o").arg(page).arg("--json").args(more).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Lengths and moment arms of all muscles as `carpus paths` has them.
fn paths(model: &Path, sweep: &str, set: &[(&str, f64)]) -> Value {
    let mut command = carpus();
    command.arg("paths").arg(model).args(["--json", "--allow-unsupported", "--sweep", sweep]);
    for (coordinate, value) in set {
        command.args(["--set", &format!("{coordinate}={value}deg")]);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A posture of the page beside that of the program: the largest difference [m], and how many muscles were compared.
fn difference(seen: &Value, of_program: &Value) -> (f64, usize) {
    let muscles = of_program["muscles"].as_array().unwrap();
    let mut largest = 0.0f64;
    for muscle in muscles {
        let of_page = &seen["muscles"][muscle["name"].as_str().unwrap()];
        for (i, key) in ["length_m", "moment_arm_m"].iter().enumerate() {
            largest = largest.max((of_page[i].as_f64().unwrap() - muscle[key][0].as_f64().unwrap()).abs());
        }
    }
    (largest, muscles.len())
}

#[test]
#[cfg_attr(not(has_browser), ignore = "needs Chromium (CARPUS_CHROMIUM), Node and npm ci in crates/carpus-web/page")]
fn verif_a_slider_of_a_model_gives_lengths_and_moment_arms_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let (model, page) = (root("models/wrist.osim"), folder.path().join("view.html"));
    assert_eq!(viewed(&model, &page, &["--set", "deviation=5deg"])["muscles"], 5);
    let plan = json!({
        "set": [["elbow_flexion", 71.5], ["pro_sup", -33], ["flexion", 23.5]], "over": "flexion", "save": true,
    });
    let seen = seen_in_browser(&page, &plan);
    assert_calm(&seen);
    assert_eq!(seen["nameless"], json!([]), "controls without a name");
    let held = [("elbow_flexion", 71.5), ("pro_sup", -33.0), ("deviation", 5.0)];
    let (differs, count) = difference(&seen, &paths(&model, "flexion=23.5:23.5:1deg", &held));
    assert!(differs < SAME && count == 5, "{differs:.1e} m");

    // Curves, with all digits: at the ends of the range and in its middle.
    let curves = paths(&model, "flexion=-70:70:70deg", &held);
    for (file, key) in [("length.csv", "length_m"), ("moment_arm.csv", "moment_arm_m")] {
        let bytes = downloaded(&seen, file);
        let mut reader = csv::Reader::from_reader(&bytes[..]);
        let heads: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
        let rows: Vec<Vec<f64>> =
            reader.records().map(|r| r.unwrap().iter().map(|v| v.parse().unwrap()).collect()).collect();
        assert_eq!((heads[0].as_str(), heads.len(), rows.len()), ("flexion_deg", 6, 121), "{file}: {heads:?}");
        for muscle in curves["muscles"].as_array().unwrap() {
            let head = format!("{}_{key}", muscle["name"].as_str().unwrap());
            let column = heads.iter().position(|h| *h == head).unwrap_or_else(|| panic!("{head}: {heads:?}"));
            for (k, row) in [0, 60, 120].into_iter().enumerate() {
                let of_program = muscle[key][k].as_f64().unwrap();
                assert!((rows[row][column] - of_program).abs() < SAME, "{head} at {}", rows[row][0]);
            }
        }
    }
    for (file, starts) in [("length.svg", "<svg"), ("moment_arm.svg", "<svg"), ("length.png", "\u{fffd}PNG")] {
        assert!(String::from_utf8_lossy(&downloaded(&seen, file)).starts_with(starts), "{file}");
    }
    let picture = downloaded(&seen, "carpus_wrist.png");
    assert!(String::from_utf8_lossy(&picture).starts_with("\u{fffd}PNG"), "{} bytes", picture.len());
    let posture = String::from_utf8(downloaded(&seen, "posture.csv")).unwrap();
    assert!(posture.contains("coordinate,flexion,deg,23.5") && posture.contains("moment arm about flexion,FCR,m,"));
    assert!(String::from_utf8(downloaded(&seen, "points.csv")).unwrap().lines().count() > 20);
    // Keys turn the model; a muscle that is pointed at stands out everywhere; moment arms carry their numbers.
    assert_eq!(seen["turned"], json!([true, true, true]));
    assert_eq!(seen["pointed"][1], 2, "both curves of {}", seen["pointed"][0]);
    assert_eq!(seen["labels"].as_array().unwrap().len(), 5);
}

#[test]
#[cfg_attr(not(has_browser), ignore = "needs Chromium (CARPUS_CHROMIUM), Node and npm ci in crates/carpus-web/page")]
#[cfg_attr(not(has_lab_models), ignore = "needs the lab models (CARPUS_SHARED)")]
fn verif_a_laboratory_s_model_in_a_page_gives_the_numbers_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("view.html");
    let model = shared("models/MOBL_ARMS_41.osim");
    let set = [("elbow_flexion", 62.0), ("pro_sup", 20.0), ("shoulder_elv", 45.0)];
    viewed(&model, &page, &[]);
    let plan = json!({ "set": set, "over": "elbow flexion", "size": [1920, 1080], "theme": "dark" });
    let seen = seen_in_browser(&page, &plan);
    assert_calm(&seen);
    let (differs, count) = difference(&seen, &paths(&model, "elbow_flexion=62:62:1deg", &set[1..]));
    assert!(differs < SAME && count == 50, "{differs:.1e} m");
}

/// Lengths and moment arms of OpenSim's tables and of a page agree so well [m]: the bars of `val_opensim_…` along a motion.
const LENGTHS_AGREE: f64 = 1e-6;
const ARMS_AGREE: f64 = 1e-5;

#[test]
#[cfg_attr(not(has_browser), ignore = "needs Chromium (CARPUS_CHROMIUM), Node and npm ci in crates/carpus-web/page")]
fn val_opensim_tables_are_drawn_beside_the_curves_of_a_model() {
    let folder = tempfile::tempdir().unwrap();
    let (model, page) = (root("models/wrist.osim"), folder.path().join("view.html"));
    viewed(&model, &page, &["--set", "elbow_flexion=90deg"]);
    let table = |file: &str| root("fixtures/path_tables").join(file);
    let written = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).unwrap();
        folder.path().join(name)
    };
    // FCR 2 mm longer at 20°, and a muscle that the model lacks.
    let shifted = written("shifted.csv", &{
        let lengths = read(table("lengths.sto"));
        let rows = lengths.lines().skip_while(|line| *line != "endheader").skip(2);
        let row = |line: &str| {
            let cells: Vec<f64> = line.split('\t').map(|v| v.parse().unwrap()).collect();
            let more = if cells[0] == 20.0 { 2e-3 } else { 0.0 };
            format!("{},{},1\n", cells[0].to_radians(), cells[4] + more)
        };
        "flexion,FCR,brachialis\n".to_owned() + &rows.map(row).collect::<String>()
    });
    let ragged = written("ragged.csv", "flexion_deg,FCR_length\n0,0.3\n10\n");
    let other = written("other.csv", "deviation_deg,FCR_moment_arm_flexion\n0,0.01\n10,0.012\n");
    let plan = json!({ "set": [], "over": "deviation", "tables": [
        [table("lengths.sto")], [table("moment_arms.csv")], [shifted],
        [table("wrist_MuscleAnalysis_Length.sto"), table("wrist_Kinematics_q.sto")],
        [table("wrist_MuscleAnalysis_MomentArm_flexion.sto"), table("wrist_Kinematics_q.sto")],
        [ragged], [other],
        [table("wrist_MuscleAnalysis_Length.sto")],
    ]});
    let seen = seen_in_browser(&page, &plan);
    assert_calm(&seen);
    let tables = seen["tables"].as_array().unwrap();
    for (i, tolerance) in [(0, LENGTHS_AGREE), (1, ARMS_AGREE), (3, LENGTHS_AGREE), (4, ARMS_AGREE)] {
        let said = tables[i]["said"].as_str().unwrap();
        let rows = tables[i]["rows"].as_array().unwrap();
        assert_eq!((rows.len(), &tables[i]["error"]), (5, &json!(0)), "{said}");
        for row in rows {
            let difference: f64 = row["difference"].as_str().unwrap().parse().unwrap();
            assert!(difference.abs() < tolerance, "{row}");
        }
        let drawn = if tolerance == LENGTHS_AGREE { json!([5, 0]) } else { json!([0, 5]) };
        assert_eq!(json!([tables[i]["lengths"], tables[i]["arms"]]), drawn, "{said}");
        let words = if i < 3 { "agrees within" } else { "differs by at most" };
        assert!(said.contains("values of flexion, dashed") && said.contains(words), "{said}");
    }
    let (row, said) = (&tables[2]["rows"][0], tables[2]["said"].as_str().unwrap());
    let number = |key: &str| row[key].as_str().unwrap().parse::<f64>().unwrap();
    assert!((number("difference") - 2e-3).abs() < LENGTHS_AGREE && row["muscle"] == "FCR", "{row}");
    assert!((number("at").to_degrees() - 20.0).abs() < 1e-6, "{row}");
    for part in ["2\u{202f}mm, at flexion = 20°", "taken for radians", "taken for lengths", "compared: brachialis"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    for (i, part) in [
        (5, "ragged.csv, line 3: expected 2 values as in the heading, found 1"),
        (6, "FCR_moment_arm_flexion is a moment arm about flexion, but deviation changes"),
        (7, "choose the file of coordinates, too"),
    ] {
        let said = tables[i]["said"].as_str().unwrap();
        assert!(said.contains(part) && tables[i]["error"] == 1 && tables[i]["lengths"] == 0, "{said}");
    }
}

#[test]
#[cfg_attr(not(has_browser), ignore = "needs Chromium (CARPUS_CHROMIUM), Node and npm ci in crates/carpus-web/page")]
fn verif_hostile_names_of_a_model_are_only_text() {
    const NAME: &str = "<img src=x onerror=window.executed=1>";
    let folder = tempfile::tempdir().unwrap();
    let text = read(root("models/wrist.osim"));
    let escaped = NAME.replace('<', "&lt;").replace('>', "&gt;");
    let text = text.replace("name=\"FCR\"", &format!("name=\"{escaped}\""));
    let text = text.replace("name=\"carpus_wrist\"", "name=\"&lt;/script>&lt;script>window.executed=1&lt;/script>\"");
    let model = folder.path().join("wrist.osim");
    std::fs::write(&model, text).unwrap();
    let page = folder.path().join("view.html");
    viewed(&model, &page, &[]);
    let seen = seen_in_browser(&page, &json!({ "set": [["flexion", 10]], "over": "flexion", "save": false }));
    assert_calm(&seen);
    assert!(seen["text"].as_str().unwrap().contains(NAME));
}

/// Four corners of a hand, in metres.
const HAND: &str = "v 0 0 0\nv 0.02 -0.08 0\nv 0 -0.08 0.03\nv -0.02 -0.08 -0.03\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n";

/// The wrist model, its hand shown as this file.
fn with_mesh(folder: &Path, file: &str) -> std::path::PathBuf {
    let mesh = format!("<attached_geometry><Mesh name=\"m\"><mesh_file>{file}</mesh_file></Mesh></attached_geometry>");
    let text = read(root("models/wrist.osim"));
    let body = "<Body name=\"hand\">";
    assert!(text.contains(body));
    let model = folder.join("wrist.osim");
    std::fs::write(&model, text.replace(body, &format!("{body}{mesh}"))).unwrap();
    model
}

#[test]
fn verif_bone_geometry_is_found_where_it_is_and_nowhere_else() {
    let folder = tempfile::tempdir().unwrap();
    let lab = folder.path().join("lab");
    std::fs::create_dir_all(lab.join("Geometry")).unwrap();
    std::fs::create_dir_all(folder.path().join("other")).unwrap();
    let page = folder.path().join("view.html");
    let found = |model: &Path, more: &[&str]| viewed(model, &page, more)["geometry"].clone();

    let model = with_mesh(&lab, "hand.obj");
    assert_eq!(found(&model, &[]), json!({ "found": [], "missing": ["hand.obj"] }));
    let plain = std::fs::metadata(&page).unwrap().len();
    // So many corners that no packing hides them.
    let corner = |k: u32| f64::from(k.wrapping_mul(2_654_435_761) >> 8) * 1e-9;
    let corners = (0..600).map(|k| format!("v {} {} {}\n", corner(3 * k + 1), corner(3 * k + 2), corner(3 * k + 3)));
    let faces = (0..200).map(|k| format!("f {} {} {}\n", 3 * k + 5, 3 * k + 6, 3 * k + 7));
    let hand = HAND.to_owned() + &corners.chain(faces).collect::<String>();
    std::fs::write(folder.path().join("other/hand.obj"), hand).unwrap();
    let other = folder.path().join("other");
    assert_eq!(found(&model, &["--geometry", other.to_str().unwrap()])["found"], json!(["hand.obj"]));
    let with_mesh_in_it = std::fs::metadata(&page).unwrap().len();
    assert!(with_mesh_in_it > plain + 1_000, "{with_mesh_in_it} against {plain} bytes");
    std::fs::write(lab.join("Geometry/hand.obj"), HAND).unwrap();
    assert_eq!(found(&model, &[])["found"], json!(["hand.obj"]));
    // A name that leads out of the folders counts as the name of a file in them.
    std::fs::write(folder.path().join("secret.obj"), HAND).unwrap();
    assert_eq!(found(&with_mesh(&lab, "../secret.obj"), &[])["missing"], json!(["../secret.obj"]));
    // A file that is none is said, and the page is there all the same.
    std::fs::write(lab.join("Geometry/hand.stl"), "no mesh").unwrap();
    let model = with_mesh(&lab, "hand.stl");
    let output = carpus().arg("view").arg(&model).arg("-o").arg(&page).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && said.contains("hand.stl: is not shown: it ends early"), "{said}");
    let refused = carpus().arg("view").arg(&model).args(["--geometry", "nowhere"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("nowhere: this is no folder"));
}
