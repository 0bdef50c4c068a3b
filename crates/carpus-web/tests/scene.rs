//! A model as it is drawn: curves along surfaces are as long as paths say, drawn moment arms are those of the paths.

use carpus_osim::osim::OsimFile;
use carpus_osim::osim::spec::CoordinateIndex;
use carpus_web::scene::Scene;

fn wrist() -> Scene {
    let model = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/wrist.osim")).unwrap();
    Scene::of(&OsimFile::parse(model, "wrist.osim").unwrap()).unwrap()
}

/// Postures all over the ranges of the coordinates.
fn postures(scene: &Scene) -> Vec<Vec<f64>> {
    let ranges: Vec<[f64; 2]> = scene.model.coordinates.iter().map(|c| c.range).collect();
    let at = |k: usize| {
        let part = |c: usize| ((k * [1, 3, 7, 11][c % 4]) % 25) as f64 / 24.0;
        ranges.iter().enumerate().map(|(c, [low, high])| low + (high - low) * part(c)).collect()
    };
    (0..25).map(at).collect()
}

#[test]
fn verif_drawn_curves_are_as_long_as_the_paths() {
    /// A chord is shorter than its arc by (0.15 rad)²/24, a thousandth of a curve of some centimetres.
    const CHORDS: f64 = 1e-4;
    /// No muscle of the wrist has more points along straight lines and at the ends of a curve.
    const STRAIGHT: usize = 5;
    let mut scene = wrist();
    let mut curved = 0;
    for q in postures(&scene) {
        for muscle in scene.posture(&q).muscles {
            let drawn: f64 = muscle.points.windows(2).map(|p| (p[1] - p[0]).norm()).sum();
            assert!((drawn - muscle.length).abs() < CHORDS, "{drawn} beside {}", muscle.length);
            curved += usize::from(muscle.points.len() > STRAIGHT);
        }
    }
    assert!(curved > 20, "{curved} paths with a curve");
}

#[test]
fn verif_a_drawn_moment_arm_is_that_of_the_path() {
    let mut scene = wrist();
    let flexion = scene.model.coordinate("flexion").unwrap();
    let mut compared = 0;
    for q in postures(&scene) {
        let arms = scene.moment_arms(&q, flexion);
        for (muscle, arm) in arms.iter().enumerate() {
            let lever = scene.lever(&q, flexion, muscle).expect("all cross the wrist");
            let along = (lever.piece[1] - lever.piece[0]).normalize();
            // Moment of a unit force about the axis.
            let drawn = (lever.on_line - lever.on_axis).cross(&along).dot(&lever.axis).abs();
            assert!((drawn - arm.abs()).abs() < 1e-12, "{drawn} beside {arm}");
            let across = lever.on_line - lever.on_axis;
            assert!(across.dot(&lever.axis).abs() < 1e-12 && across.dot(&along).abs() < 1e-12, "the shortest way");
            compared += 1;
        }
    }
    assert_eq!(compared, 125);
}

#[test]
fn verif_a_sweep_is_the_postures_one_after_the_other() {
    let mut scene = wrist();
    let (start, deviation) = (scene.model.default_coordinates(), scene.model.coordinate("deviation").unwrap());
    let values = [-0.2, 0.0, 0.3];
    let swept = scene.sweep(&start, deviation, &values, &[3, 0, 99]);
    assert_eq!(swept.len(), 2, "a muscle that is not there is left out");
    for (k, value) in values.iter().enumerate() {
        let mut q = start.clone();
        q[deviation.0] = *value;
        let (posture, arms) = (scene.posture(&q), scene.moment_arms(&q, deviation));
        for (swept, muscle) in swept.iter().zip([3, 0]) {
            assert_eq!((swept.length[k], swept.moment_arm[k]), (posture.muscles[muscle].length, arms[muscle]));
        }
    }
    assert!(scene.lever(&start, CoordinateIndex(0), 99).is_none());
    assert_eq!(scene.posture(&[]).q, start, "coordinates that are missing are as the model gives them");
}

#[test]
fn verif_every_body_has_a_plain_bone_from_its_joint() {
    let mut scene = wrist();
    let start = scene.model.default_coordinates();
    let bones = scene.plain_bones(&start);
    for body in 1..scene.model.n_bases() {
        assert!(bones.iter().any(|bone| bone.base.0 == body), "{}", scene.model.bodies[body - 1].name);
    }
    assert!(bones.iter().all(|bone| (bone.to - bone.from).norm() > 1e-3 && (bone.to - bone.from).norm() < 0.5));
    let description = scene.description();
    assert_eq!(description["coordinates"][0]["unit"], "deg");
    assert_eq!(description["muscles"].as_array().unwrap().len(), 5);
}
