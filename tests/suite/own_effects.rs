//! Effects of a laboratory's own: the guide's example, its errors, the loop as a user runs it, and OpenSim as the
//! referee.

use std::path::{Path, PathBuf};
use std::process::Command as Process;

use carpus::effects::catalogue::{CATALOGUE, with_own};
use carpus::effects::conformance::checks;
use carpus::effects::effect::{Effect, NativeForm};
use carpus::effects::export;
use carpus::effects::forward_model::{ForwardModel, Setting};
use carpus::effects::own_effect::{self, Definition, register};
use carpus::functions::Expression;
use carpus::osim::OsimFile;
use carpus::simulation::{MusculoskeletalModel, Setup};
use carpus::study::{Study, Trial};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::{Value, json};

use crate::reference::opensim_python;
use crate::user_loop::{carpus, column, json as read_json, read, root, small_study};

const EXAMPLE: &str = "docs/src/guide/cogging.toml";

/// A definition whose parameters are those given.
fn definition(id: &str, stage: &str, formula: &str, parameters: &[&str]) -> String {
    let head = format!("[effect]\nid = \"{id}\"\nname = \"{id}\"\nstage = \"{stage}\"\nformula = \"{formula}\"\n");
    let one = |p: &&str| {
        let (name, rest) = p.split_once(' ').unwrap();
        format!("\n[parameters.{name}]\nsource = \"a test\"\n{}\n", rest.replace("; ", "\n"))
    };
    parameters.iter().map(one).fold(head, |text, p| text + &p)
}

const AMPLITUDE: &str = "A unit = \"N·m\"; role = \"amplitude\"; plausible = [-1.0, 1.0]";

/// Trials of the bundled study.
fn forward() -> (OsimFile, Setup, ForwardModel) {
    let study = Study::read_tables(root("fixtures/demo_study/study.toml")).unwrap_or_else(|e| panic!("{e}"));
    let file = OsimFile::read(root("models/wrist.osim")).unwrap();
    let setup = Setup::from_settings(&study.settings);
    let model = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
    let stems = ["isometric_50_flexion_+30deg_1", "isotonic_50_extension_1", "isotonic_25_flexion_1", "passive_1"];
    let trial = |stem: &&str| {
        let info = study.trials_of("P01").find(|t| t.file_as_written.contains(*stem)).unwrap();
        study.trial(info).unwrap_or_else(|e| panic!("{e}"))
    };
    let trials: Vec<Trial> = stems.iter().map(trial).collect();
    let forward = ForwardModel::new(&file.spec, &model, &trials).unwrap();
    (file, setup, forward)
}

#[test]
fn verif_the_guide_shows_the_example_that_lies_beside_it() {
    let (example, guide) = (read(root(EXAMPLE)), read(root("docs/src/guide/own-effect.md")));
    assert!(guide.contains(&format!("```toml\n{example}```")), "the guide's example is another one");
    let definition = Definition::read(&root(EXAMPLE)).unwrap_or_else(|p| panic!("{p:?}"));
    assert_eq!((definition.id.as_str(), definition.parameters.len()), ("cogging", 2));
}

#[test]
fn verif_all_effects_pass_what_check_checks() {
    /// Effects that jump somewhere in value or slope, as excitations cut off at 0.
    const KINKED: [&str; 4] = ["emg_floor", "ligament_stop", "angle_offset", "joint_compliance"];
    let (.., forward) = forward();
    let own = [
        (
            "check_wave",
            "joint",
            "A*sin(n*q)",
            vec![AMPLITUDE, "n unit = \"1/rad\"; role = \"shape\"; start = 14; plausible = [8, 20]"],
        ),
        ("check_drag", "joint", "-A*hinge(qdot)", vec![AMPLITUDE]),
        ("check_active", "joint", "-A*q*(a_FCR+e_ECU)*l_FCR/(1+abs(v_FCR))*r_FCR/0.01", vec![AMPLITUDE]),
        (
            "check_creep",
            "joint",
            "A*tau*exp(-t/T)*t_session*(1+0.001*qddot)",
            vec![
                "A unit = \"1\"; role = \"amplitude\"; plausible = [-1, 1]",
                "T unit = \"s\"; role = \"shape\"; start = 1; plausible = [0.5, 4]",
            ],
        ),
        (
            "check_gain",
            "muscles",
            "A*(1-a)*(1+q)*tanh(r/0.01)^2",
            vec!["A unit = \"1\"; role = \"amplitude\"; plausible = [-0.5, 0.5]"],
        ),
    ];
    let own: Vec<&dyn Effect> = own
        .iter()
        .map(|(id, stage, formula, parameters)| {
            let text = definition(id, stage, formula, parameters);
            let definition = Definition::parse(&text, Path::new("own.toml")).unwrap_or_else(|p| panic!("{p:?}"));
            register(definition).unwrap() as &dyn Effect
        })
        .collect();
    assert!(own.iter().all(|e| with_own().iter().any(|o| o.description().id == e.description().id)));
    let mut failed = Vec::new();
    // The bundled model has no muscle that the study does not activate.
    let all = CATALOGUE.iter().copied().filter(|e| e.description().id != "unmodelled_muscles").chain(own);
    for effect in all {
        let id = effect.description().id;
        let kinked = KINKED.contains(&id) || own_effect::definition(effect).is_some_and(|d| d.expression.has_kinks());
        for check in checks(&forward, effect, kinked).unwrap() {
            if !check.passed {
                failed.push(format!("{id}: {}: {} (expected {})", check.what, check.found, check.expected));
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn verif_check_finds_what_is_wrong_with_an_effect() {
    let (.., forward) = forward();
    let failing = |id: &str, formula: &str, parameters: &[&str]| {
        let text = definition(id, "joint", formula, parameters);
        let definition = Definition::parse(&text, Path::new("own.toml")).unwrap_or_else(|p| panic!("{p:?}"));
        let effect = register(definition).unwrap();
        let found = checks(&forward, effect, effect.has_kinks()).unwrap();
        found.into_iter().filter(|c| !c.passed).map(|c| c.what).collect::<Vec<_>>().join("; ")
    };
    let place = "p unit = \"rad\"; role = \"shape\"; start = 0.1; plausible = [-0.5, 0.5]; typical = 100.0";
    let step = failing("wrong_step", "A*step(q-p)", &[AMPLITUDE, place]);
    assert!(step.contains("derivative by p"), "{step}");
    assert!(failing("wrong_square", "A^2*q", &[AMPLITUDE]).contains("three times"));
    let large = AMPLITUDE.replace("-1.0, 1.0", "-1.0, 1e6");
    assert!(failing("wrong_size", "A*(1+q)", &[&large]).contains("moments that a joint has"));
    assert!(failing("wrong_nothing", "A*q*1e-9", &[AMPLITUDE]).contains("shows in these trials"));
}

#[test]
fn verif_check_prints_what_is_so_and_fails_where_it_is_not() {
    let folder = tempfile::tempdir().unwrap();
    carpus().args(["effects", "check"]).arg(root(EXAMPLE)).assert().success().stdout(
        contains("Cogging of the machine (cogging)").and(contains("A*sin(n*q)")).and(contains("▁")).and(contains("ok")),
    );
    let put = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, text).unwrap();
        file
    };
    let refused = |file: &PathBuf, says: &[&str]| {
        let assert = carpus().args(["effects", "check"]).arg(file).assert().code(1);
        let text = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
        let flat = text.split_whitespace().collect::<Vec<_>>().join(" ");
        for part in says {
            assert!(flat.contains(part), "{part}: {text}");
        }
    };
    let example = read(root(EXAMPLE));
    let at = |file: &Path, line: usize| format!("{}:{line}:", file.display());
    let file = put("qdott.toml", &example.replace("n*q)", "n*qdott)"));
    refused(&file, &[&at(&file, 6), "`formula`", "found `qdott`", "did you mean `qdot`?"]);
    let file = put("muscle.toml", &example.replace("n*q)", "n*a_FCRR)"));
    refused(&file, &[&at(&file, 6), "found `FCRR`", "did you mean `FCR`?"]);
    let file = put("zero.toml", &example.replace("n*q)", "n/q)"));
    refused(&file, &[&at(&file, 6), "found NaN at q = 0", "narrow a plausible range"]);
    let file = put("id.toml", &example.replace("\"cogging\"", "\"gravity\""));
    refused(&file, &["which is an effect of the catalogue", "give it another id"]);
    let file = put("square.toml", &example.replace("A*sin", "A*A*sin"));
    refused(&file, &[&at(&file, 6), "checks failed"]);
    refused(&folder.path().join("none.toml"), &["none.toml"]);
}

#[test]
fn verif_an_own_effect_is_hidden_found_and_added_as_one_of_the_catalogue() {
    let folder = tempfile::tempdir().unwrap();
    let path = |relative: &str| folder.path().join(relative);
    let study = small_study(&path("given"));
    let example = root(EXAMPLE);
    carpus().arg("effects").arg("--own-effect").arg(&example).assert().success().stdout(contains("37 effects"));
    for (size, out) in [("A=0.4,n=13.4", "hidden"), ("A=0", "without")] {
        let mut command = carpus();
        command.arg("synth").arg(&study).args(["--seed", "5", "--noise", "small", "--own-effect"]).arg(&example);
        command.args(["--effect", &format!("cogging:{size}"), "--out"]).arg(path(out)).assert().success();
    }
    let [angle, with, without] = [("hidden", "angle_deg"), ("hidden", "moment_n_m"), ("without", "moment_n_m")]
        .map(|(study, name)| column(path(&format!("{study}/data/P01/passive_1.csv")), name));
    let largest = with.iter().zip(&without).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!((0.35..0.45).contains(&largest), "{largest} N·m over {} samples", angle.len());
    let hidden = path("hidden/study.toml");
    // The study that was written knows the effect by itself.
    carpus()
        .arg("diagnose")
        .arg(&hidden)
        .args(["--candidates", "cogging,joint_stiffness,gravity,coulomb_friction,torque_offset", "--out"])
        .arg(path("found"))
        .assert()
        .success()
        .stdout(contains("consistent with one missing effect: Cogging of the machine"));
    let diagnosis = read_json(path("found/P01/diagnosis.json"));
    assert_eq!(diagnosis["explanations"][0]["effects"], json!(["cogging"]));
    // As if by the whole catalogue, which takes long.
    let file = path("found/P01/diagnosis.json");
    let mut whole = diagnosis;
    whole["restricted_to"] = Value::Array(Vec::new());
    std::fs::write(&file, whole.to_string()).unwrap();
    carpus().args(["effect", "add"]).arg(&hidden).args(["cogging", "--out"]).arg(path("found")).assert().success();
    let ledger = read_json(path("found/P01/ledger.json"));
    let error = |step: usize| ledger["steps"][step]["held_out"].as_f64().unwrap();
    assert!(error(2) < 0.7 * error(1), "held out {} after {}", error(2), error(1));
    let value = |name: &str| ledger["steps"][2]["parameters"][name]["value"].as_f64().unwrap();
    let [size, wave] = [value("cogging.A"), value("cogging.n")];
    assert!((size - 0.4).abs() < 0.05 && (wave - 13.4).abs() < 0.3, "{size} sin {wave} q");
    let model = read(path("found/P01/model.osim"));
    assert!(model.contains("ExpressionBasedCoordinateForce") && !path("found/P01/effects.toml").exists());
    carpus().args(["effect", "remove"]).arg(path("found/P01")).arg("--own-effect").arg(&example).assert().success();
    assert!(!read(path("found/P01/model.osim")).contains("ExpressionBasedCoordinateForce"));
}

#[test]
fn verif_a_definition_travels_with_the_effects_beside_a_model() {
    let folder = tempfile::tempdir().unwrap();
    let path = |relative: &str| folder.path().join(relative);
    let study = small_study(&path("given"));
    let text = definition(
        "stiff_when_active",
        "joint",
        "-k*q*(a_FCR+a_ECU)",
        &["k unit = \"N·m/rad\"; role = \"amplitude\"; plausible = [0.0, 4.0]"],
    );
    let own = path("given/stiff.toml");
    std::fs::write(&own, &text).unwrap();
    let effects = path("effects.toml");
    let beside = |value: f64, definition: &str| {
        let text = format!(
            "schema = \"carpus.effects/1\"\ncoordinate = \"flexion\"\n\n[[effect]]\nid = \"stiff_when_active\"\n\
             k = {{ value = {value:?}, unit = \"N·m/rad\" }}\n{definition}"
        );
        std::fs::write(&effects, text).unwrap();
    };
    let moments = |out: &str, further: &[&Path]| {
        let mut command = carpus();
        command.arg("simulate").arg(&study).arg("--effects").arg(&effects);
        for file in further {
            command.arg("--own-effect").arg(file);
        }
        command.arg("--out").arg(path(out)).assert().success();
        let file = path(out).join("P01/series/isometric_25_flexion_-30deg_1.csv");
        read(file)
    };
    beside(1.5, &format!("definition = '''\n{text}'''\n"));
    let by_itself = moments("by_itself", &[]);
    assert_eq!(moments("beside", &[&own]), by_itself);
    beside(1.5, "");
    assert_eq!(moments("named", &[&own]), by_itself);
    beside(0.0, &format!("definition = '''\n{text}'''\n"));
    assert_ne!(moments("none", &[]), by_itself);
    // Named by the study; a muscle that it does not have is told with the line of the definition.
    let settings = read(study.clone()) + "\n[effects]\nown = [\"stiff.toml\"]\n";
    std::fs::write(&study, settings).unwrap();
    beside(1.5, "");
    assert_eq!(moments("of_the_study", &[]), by_itself);
    std::fs::write(&own, text.replace("a_ECU", "a_ECUU")).unwrap();
    let mut command = carpus();
    let refused = command.arg("compare").arg(&study).arg("--out").arg(path("refused")).assert().code(1);
    let stderr = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("stiff.toml:5:") && stderr.contains("did you mean `ECU`?"), "{stderr}");
    std::fs::remove_file(&own).unwrap();
    let mut command = carpus();
    let missing = command.arg("compare").arg(&study).arg("--out").arg(path("missing")).assert().code(1);
    let stderr = String::from_utf8(missing.get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("stiff.toml") && stderr.contains("study.toml:"), "{stderr}");
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_an_exported_formula_gives_the_moment_of_the_effect() {
    /// Of the moment, relative to the largest [N·m].
    const TOLERANCE: f64 = 1e-9;
    let python = opensim_python();
    let (file, setup, _) = forward();
    let folder = tempfile::tempdir().unwrap();
    let shape = "w unit = \"rad/s\"; role = \"shape\"; start = 0.4; plausible = [0.1, 2]";
    let cases = [
        ("exported_wave", "A*sin(14*q)+A*w*cos(2*pi*q)/7", -0.37),
        ("exported_friction", "-A*sign(qdot)*(1+q)^2-A*hinge(qdot-w)*2^-abs(q)", 0.4),
        ("exported_mixed", "A*tanh(-qdot/w)*exp(-q^2)+A*min(q,w)-A*max(-q,-1e-7)*step(q-0.1)", 0.25),
        ("exported_named", "A*s*sqrt(1+s^2);s=log(1+q^2)*atan(qdot/w)", 0.9),
    ];
    let mut exported = file.clone();
    let mut effects = Vec::new();
    for (id, formula, size) in cases {
        let text = definition(id, "joint", formula, &[AMPLITUDE, shape]);
        let definition = Definition::parse(&text, Path::new("own.toml")).unwrap_or_else(|p| panic!("{p:?}"));
        effects.push(Setting { effect: register(definition).unwrap(), values: vec![size, 0.43] });
    }
    let report = export::write(&mut exported, &setup, &effects).unwrap();
    assert_eq!((report.native.len(), report.side_car.effects.len()), (cases.len(), 0));
    let path = folder.path().join("exported.osim");
    exported.write(&path).unwrap();
    let states: Vec<[f64; 2]> =
        (0..60).map(|i| [-1.1 + 0.0367 * f64::from(i), 3.0 * (1.7 * f64::from(i)).sin()]).collect();
    let names: Vec<String> = cases.iter().map(|(id, ..)| format!("carpus_{id}")).collect();
    let request = json!({ "model": path, "coordinate": "flexion", "forces": names, "states": states });
    let asked = folder.path().join("states.json");
    std::fs::write(&asked, request.to_string()).unwrap();
    let script = root("fixtures/effects/opensim_states.py");
    let output = Process::new(python).arg(script).arg("--forces").arg(&asked).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let theirs: Vec<Vec<f64>> =
        serde_json::from_str(String::from_utf8_lossy(&output.stdout).lines().last().unwrap()).unwrap();
    let mut worst = 0.0_f64;
    for (i, setting) in effects.iter().enumerate() {
        let definition = own_effect::definition(setting.effect).unwrap();
        let words: Vec<&str> = ["q", "qdot"].to_vec();
        let Some(NativeForm::Formula(written)) = setting.effect.native_form(&setting.values, 0.0) else { panic!() };
        let written = Expression::parse_in(&written, &words).unwrap();
        for (state, theirs) in states.iter().zip(&theirs) {
            let variable =
                |v: &carpus::effects::own_effect::Variable| if v.word() == "q" { state[0] } else { state[1] };
            let values: Vec<f64> =
                definition.variables.iter().map(variable).chain(setting.values.iter().copied()).collect();
            let ours: f64 = definition.expression.value_at(&values);
            assert!((ours - written.value(state[0], state[1])).abs() <= 1e-14 * ours.abs().max(1.0));
            let off = (ours - theirs[i]).abs() / ours.abs().max(1e-3);
            assert!(off < TOLERANCE, "{}: {ours} and {} at {state:?}", definition.id, theirs[i]);
            worst = worst.max(off);
        }
    }
    println!("formulas in OpenSim: {worst:.1e}");
}
