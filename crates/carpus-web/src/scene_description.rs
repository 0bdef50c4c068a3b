//! What a page has to know of a model once, to draw it in any posture.

use carpus_multibody::multibody::BaseIndex;
use carpus_osim::osim::spec::{CoordinateIndex, MotionType, WrapShape};
use nalgebra::Vector3;
use serde_json::{Value, json};

use super::scene::Scene;

/// The tip of a body that carries no other lies at most this far from its joint [m].
const LONGEST_TIP: f64 = 0.45;
/// Joints nearer to one another than this have no bone between them [m].
const NO_BONE: f64 = 1e-3;

/// A plain shape in the place of a bone, in the frame of its body [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlainBone {
    /// Ground or the body.
    pub base: BaseIndex,
    /// Where it begins: at the joint towards ground.
    pub from: Vector3<f64>,
    /// Where it ends: at a joint away from ground, or at the tip of the body.
    pub to: Vector3<f64>,
}

impl Scene {
    /// Coordinates, bodies, muscles and wrapping surfaces as JSON.
    pub fn description(&mut self) -> Value {
        let start = self.model.default_coordinates();
        let bones: Vec<Value> = self.plain_bones(&start).iter().map(bone).collect();
        let (model, spec) = (&self.model, &self.spec);
        let coordinates: Vec<Value> =
            (0..model.n_coordinates()).map(|c| coordinate(self, CoordinateIndex(c), &start)).collect();
        let wraps: Vec<Value> = (spec.wrap_objects.iter().zip(&model.wrap_objects).enumerate())
            .map(|(w, (wrap, place))| {
                let wraps_it = |path: &carpus_multibody::paths::Path| path.wrap_objects().any(|o| o.0 == w);
                let muscles: Vec<usize> =
                    self.paths().enumerate().filter(|(_, path)| wraps_it(path)).map(|(m, _)| m).collect();
                json!({
                    "name": wrap.name, "base": place.base.0, "pose": place.X_BW.numbers(), "active": wrap.active,
                    "shape": shape(wrap.shape), "muscles": muscles,
                })
            })
            .collect();
        let muscle = |m: &carpus_osim::osim::spec::MuscleSpec| {
            json!({
                "name": m.name, "max_isometric_force": m.max_isometric_force,
                "optimal_fiber_length": m.optimal_fiber_length, "tendon_slack_length": m.tendon_slack_length,
            })
        };
        let bodies = std::iter::once("ground").chain(model.bodies.iter().map(|b| b.name.as_str()));
        json!({
            "name": model.name,
            "start": start,
            "coordinates": coordinates,
            "bodies": bodies.collect::<Vec<_>>(),
            "bones": bones,
            "wraps": wraps,
            "muscles": spec.muscles.iter().map(muscle).collect::<Vec<_>>(),
        })
    }

    /// Plain shapes for all bodies: from the joint towards ground to every joint away from it, or to the tip.
    ///
    /// - `q`: posture in which joints are where they are taken to be
    #[allow(non_snake_case)]
    pub fn plain_bones(&mut self, q: &[f64]) -> Vec<PlainBone> {
        let placed = self.posture(q);
        let (model, spec) = (&self.model, &self.spec);
        let in_base = |base: BaseIndex, p_G: Vector3<f64>| placed.X_GB[base.0].inverse_transform_point(&p_G);
        // Where every joint is: the origin of its frame on the body away from ground.
        let joints: Vec<[(BaseIndex, Vector3<f64>); 2]> = spec
            .joints
            .iter()
            .map(|joint| {
                let [parent, child] = [joint.parent_frame, joint.child_frame].map(|f| model.frame(f));
                let p_G = placed.X_GB[child.base.0] * child.X_BF.p;
                [(parent.base, in_base(parent.base, p_G)), (child.base, child.X_BF.p)]
            })
            .collect();
        let mut bones = Vec::new();
        for body in 0..model.bodies.len() {
            let base = BaseIndex(body + 1);
            let Some([_, (_, from)]) = joints.iter().find(|joint| joint[1].0 == base) else { continue };
            let onward = joints.iter().filter(|joint| joint[0].0 == base).map(|joint| joint[0].1);
            let onward: Vec<Vector3<f64>> = onward.filter(|to| (to - from).norm() > NO_BONE).collect();
            let has_more = joints.iter().any(|joint| joint[0].0 == base);
            let ends = if has_more { onward } else { vec![tip(self, body, *from)] };
            bones.extend(ends.into_iter().map(|to| PlainBone { base, from: *from, to }));
        }
        bones
    }
}

/// The far end of a body that carries no other: as far behind its mass centre as that is from its joint, or the point
/// of a muscle that is farthest from it.
fn tip(scene: &Scene, body: usize, from: Vector3<f64>) -> Vector3<f64> {
    let base = BaseIndex(body + 1);
    let behind = (scene.model.bodies[body].mass_center - from) * 2.0;
    let attached = scene.paths().flat_map(|path| path.fixed_points()).filter(|(on, _)| *on == base);
    let reach = attached.map(|(_, p)| p - from).fold(behind, |far, p| if p.norm() > far.norm() { p } else { far });
    from + reach * (LONGEST_TIP / reach.norm().max(LONGEST_TIP))
}

fn bone(bone: &PlainBone) -> Value {
    json!({ "base": bone.base.0, "from": bone.from.as_slice(), "to": bone.to.as_slice() })
}

/// - `scale`: from radians or metres to what is shown
fn coordinate(scene: &Scene, index: CoordinateIndex, start: &[f64]) -> Value {
    let c = &scene.model.coordinates[index.0];
    let (unit, scale) = match c.motion_type {
        MotionType::Rotational => ("deg", 180.0 / std::f64::consts::PI),
        MotionType::Translational => ("m", 1.0),
        MotionType::Coupled => ("", 1.0),
    };
    let follows = scene.model.is_dependent(index).then(|| scene.model.names_of_roots(index, ""));
    json!({
        "name": c.name, "joint": scene.spec.joints[c.joint.0].name, "unit": unit, "scale": scale, "range": c.range,
        "start": start[index.0], "locked": c.locked, "prescribed": c.prescribed.is_some(), "clamped": c.clamped,
        "follows": follows,
    })
}

fn shape(shape: WrapShape) -> Value {
    match shape {
        WrapShape::Sphere { radius } => json!({ "kind": "ellipsoid", "radii": [radius, radius, radius] }),
        WrapShape::Ellipsoid { dimensions } => json!({ "kind": "ellipsoid", "radii": dimensions }),
        WrapShape::Cylinder { radius, length } => json!({ "kind": "cylinder", "radius": radius, "length": length }),
        // OpenSim's names: radius of the tube, and of its centre circle.
        WrapShape::Torus { inner_radius, outer_radius } => {
            json!({ "kind": "torus", "tube": inner_radius, "radius": outer_radius })
        }
    }
}
