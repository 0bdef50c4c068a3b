//! Path points inside the surfaces that their path wraps around: the path goes straight through such a surface.

use nalgebra::Vector3;

use super::super::model::LoadedModel;
use super::finding::{Check, Finding, Level};
use super::poses::Poses;
use carpus_osim::osim::spec::{PathPointKind, WrapShape};

/// Points nearer to the surface than this lie on it [m].
const DEPTH: f64 = 1e-3;

/// Findings about every path and every surface that it wraps around, at the posture.
#[allow(non_snake_case)]
pub(super) fn findings(loaded: &LoadedModel, poses: &Poses) -> Vec<Finding> {
    let (spec, model) = (&loaded.file.spec, &loaded.model);
    let mut cache = model.new_cache();
    model.update_positions(&poses.posture, &mut cache);
    let mut findings: Vec<Finding> = Vec::new();
    for muscle in &spec.muscles {
        for wrap in &muscle.path.wraps {
            let object = &spec.wrap_objects[wrap.wrap_object.0];
            if !object.active {
                continue;
            }
            let placement = model.wrap_object(wrap.wrap_object);
            let X_GW = cache.X_GB(placement.base) * &placement.X_BW;
            // `range` counts from 1; negative: no limit.
            let first = usize::try_from(wrap.range[0]).map_or(0, |n| n.saturating_sub(1));
            let last = usize::try_from(wrap.range[1]).unwrap_or(muscle.path.points.len());
            for point in muscle.path.points.iter().take(last).skip(first) {
                let PathPointKind::Fixed { location } = &point.kind else { continue };
                let place = X_GW.inverse_transform_point(&(cache.X_GF(model, point.frame) * *location));
                let Some(depth) = depth(&object.shape, &place).filter(|depth| *depth > DEPTH) else { continue };
                let text = format!(
                    "point {} of {} lies {:.1} mm inside {}, which the path is to wrap around",
                    point.name,
                    muscle.name,
                    1e3 * depth,
                    object.name
                );
                let hint = "make the surface smaller, or move the point; from inside, the path goes straight through";
                let finding = Finding::new(Level::Warning, Check::Wrap, &object.at, text, hint);
                findings.push(finding.of_size(1e3 * depth, "mm"));
            }
        }
    }
    findings
}

/// How far a point is inside a surface [m].
fn depth(shape: &WrapShape, p: &Vector3<f64>) -> Option<f64> {
    match shape {
        WrapShape::Sphere { radius } => Some(radius - p.norm()),
        WrapShape::Cylinder { radius, length } => (p.z.abs() < 0.5 * length).then(|| radius - p.x.hypot(p.y)),
        WrapShape::Ellipsoid { dimensions: [a, b, c] } => {
            let scale = Vector3::new(p.x / a, p.y / b, p.z / c).norm();
            // Along the ray from the centre.
            (scale > 0.0).then(|| p.norm() * (1.0 / scale - 1.0))
        }
        WrapShape::Torus { .. } => None,
    }
}
