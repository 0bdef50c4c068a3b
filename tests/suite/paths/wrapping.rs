//! Wrapping of one segment over one surface.

use carpus::osim::spec::{Quadrant, WrapMethod, WrapShape};
use carpus::paths::wrapping::{ConstrainedHalf, Surface, Wrap, WrapAction};
use nalgebra::Vector3;

/// One line of `fixtures/paths/wrapping.csv`.
struct Reference {
    line: usize,
    surface: Surface,
    p1: Vector3<f64>,
    p2: Vector3<f64>,
    length: f64,
    tangents: Option<(Vector3<f64>, Vector3<f64>)>,
}

fn references() -> Vec<Reference> {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/paths/wrapping.csv");
    let mut reader = csv::Reader::from_path(file).expect("the fixture is part of the project");
    reader
        .records()
        .enumerate()
        .map(|(row, record)| {
            let record = record.expect("well-formed row");
            let number = |i: usize| record[i].parse::<f64>().expect("a number");
            let vector = |i: usize| Vector3::new(number(i), number(i + 1), number(i + 2));
            let shape = match &record[0] {
                "sphere" => WrapShape::Sphere { radius: number(1) },
                "cylinder" => WrapShape::Cylinder { radius: number(1), length: number(2) },
                "ellipsoid" => WrapShape::Ellipsoid { dimensions: [number(1), number(2), number(3)] },
                "torus" => WrapShape::Torus { inner_radius: number(1), outer_radius: number(2) },
                other => panic!("unknown shape {other}"),
            };
            let method = match &record[5] {
                "hybrid" => WrapMethod::Hybrid,
                "midpoint" => WrapMethod::Midpoint,
                "axial" => WrapMethod::Axial,
                other => panic!("unknown method {other}"),
            };
            let quadrant = match record[4].split_at(record[4].len() - 1) {
                ("al", "l") => Quadrant::All,
                (sign, axis) => {
                    Quadrant::Half { axis: "xyz".find(axis).expect("an axis"), sign: if sign == "-" { -1 } else { 1 } }
                }
            };
            Reference {
                line: row + 2,
                surface: Surface {
                    shape,
                    half: ConstrainedHalf::from_quadrant(quadrant),
                    method,
                    is_only_wrap_of_path: &record[6] == "1",
                },
                p1: vector(7),
                p2: vector(10),
                length: number(13),
                tangents: (!record[14].is_empty()).then(|| (vector(14), vector(17))),
            }
        })
        .collect()
}

/// Path length, and tangent points if the wrap is used, as a path with this wrap alone has them.
fn path_of(reference: &Reference) -> (f64, Option<(Vector3<f64>, Vector3<f64>)>) {
    let Wrap { action, path } = reference.surface.wrap(&reference.p1, &reference.p2);
    match path {
        Some(path) if matches!(action, WrapAction::Wrapped | WrapAction::MandatoryWrap) => {
            let straight = (path.r1 - reference.p1).norm() + (path.r2 - reference.p2).norm();
            (straight + path.length, Some((path.r1, path.r2)))
        }
        _ => ((reference.p2 - reference.p1).norm(), None),
    }
}

/// Lengths and tangent points of 2,000 random segments equal OpenSim's (written with 10 decimals).
#[test]
fn val_opensim_wrapping_surfaces() {
    const LENGTH_TOLERANCE: f64 = 1e-11; // m; rounding alone
    const POINT_TOLERANCE: f64 = 2e-10; // m; the reference is rounded to 1e-10
    let mut failures = Vec::new();
    let (mut worst_length, mut worst_point) = (0.0_f64, 0.0_f64);
    let all = references();
    let mut wrapped = 0;
    for reference in &all {
        let (length, tangents) = path_of(reference);
        let difference = (length - reference.length).abs();
        let apart = match (tangents, reference.tangents) {
            (None, None) => 0.0,
            (Some((r1, r2)), Some((s1, s2))) => {
                wrapped += 1;
                (r1 - s1).amax().max((r2 - s2).amax())
            }
            _ => f64::INFINITY,
        };
        if !(difference <= LENGTH_TOLERANCE && apart <= POINT_TOLERANCE) {
            failures.push(format!(
                "line {}: {:?}: length off by {difference:.3e} m, points by {apart:.3e} m",
                reference.line, reference.surface
            ));
        } else {
            worst_length = worst_length.max(difference);
            worst_point = worst_point.max(apart);
        }
    }
    println!(
        "{} segments, {wrapped} wrapped; largest residuals: length {worst_length:.2e} m, points {worst_point:.2e} m",
        all.len()
    );
    assert!(failures.is_empty(), "{} of {}:\n{}", failures.len(), all.len(), failures.join("\n"));
    assert!(wrapped > 1000, "the fixture must contain wraps, has {wrapped}");
}
