//! What a model that cannot be compiled is told.

use super::FIXTURES;
use carpus::multibody::{CompileError, CouplerProblem, Model};
use carpus::osim::OsimFile;
use carpus::osim::spec::{ConstraintKind, FrameIndex, FrameKind, FunctionSpec, JointKind, ModelSpec};
use nalgebra::Vector3;

fn spec() -> ModelSpec {
    OsimFile::parse(FIXTURES[0].1.as_bytes(), "joints.osim").expect("our own model").spec
}

fn error(change: impl FnOnce(&mut ModelSpec)) -> CompileError {
    let mut spec = spec();
    change(&mut spec);
    Model::compile(&spec).expect_err("must not compile")
}

#[test]
fn verif_dangling_references_are_named() {
    let e = error(|spec| spec.joints[1].child_frame = FrameIndex(999));
    assert!(matches!(e, CompileError::BadReference { what: "frame", index: 999, .. }), "{e}");
}

#[test]
fn verif_frame_cycle_is_named() {
    let e = error(|spec| {
        let frame = spec.joints[0].parent_frame;
        let FrameKind::Offset { parent, .. } = &mut spec.frames[frame.0].kind else { panic!("an offset frame") };
        *parent = frame;
    });
    assert!(matches!(e, CompileError::FrameCycle { .. }), "{e}");
}

#[test]
fn verif_loop_of_joints_is_cut_at_the_child() {
    let mut spec = spec();
    let whole = Model::compile(&spec).expect("compiles");
    let mut joint = spec.joints[0].clone();
    joint.name = "second".into();
    spec.joints.push(joint);
    let model = Model::compile(&spec).expect("compiles");
    let [weld] = model.loop_welds.as_slice() else { panic!("one loop") };
    assert_eq!(weld.joint.0, spec.joints.len() - 1);
    // Body and part share the mass.
    let child = weld.bases[0].body().expect("a body");
    let part = weld.bases[1].body().expect("a part");
    assert_eq!(part.0, spec.bodies.len());
    for body in [child, part] {
        assert_eq!(model.bodies[body.0].mass, 0.5 * whole.bodies[child.0].mass);
        assert_eq!(model.bodies[body.0].inertia, 0.5 * whole.bodies[child.0].inertia);
    }
    assert_eq!(model.bodies[part.0].name, format!("{}_slave_0", whole.bodies[child.0].name));
}

#[test]
fn verif_joint_within_a_body_is_named() {
    let e = error(|spec| spec.joints[1].child_frame = spec.joints[1].parent_frame);
    assert!(matches!(&e, CompileError::JointWithinBody { body, .. } if body == "base"), "{e}");
}

#[test]
fn verif_parallel_and_missing_axes_are_named() {
    let custom = |spec: &mut ModelSpec, change: fn(&mut [carpus::osim::spec::TransformAxisSpec; 6])| {
        let joint = spec.joints.iter_mut().find(|j| j.name == "custom_joint").expect("custom_joint");
        let JointKind::Custom(axes) = &mut joint.kind else { panic!("a CustomJoint") };
        change(axes);
    };
    let e = error(|spec| custom(spec, |axes| axes[2].axis = axes[0].axis * -2.0));
    assert!(matches!(e, CompileError::ParallelAxes { kind: "rotation", first: 1, second: 3, .. }), "{e}");
    let e = error(|spec| custom(spec, |axes| axes[4].axis = Vector3::zeros()));
    assert!(matches!(e, CompileError::DegenerateAxis { axis: 5, .. }), "{e}");
    let e = error(|spec| custom(spec, |axes| axes[1].coordinates.clear()));
    assert!(matches!(e, CompileError::ArgumentCount { found: 0, .. }), "{e}");
    let e = error(|spec| custom(spec, |axes| axes[0].function = FunctionSpec::SimmSpline { x: vec![], y: vec![] }));
    assert!(matches!(e, CompileError::Function { .. }), "{e}");
}

#[test]
fn verif_coupler_cycles_are_named() {
    let e = error(|spec| {
        let ConstraintKind::CoordinateCoupler { independent_coordinates, .. } = &mut spec.constraints[1].kind else {
            panic!("a coupler")
        };
        // pin_angle → slide → u_y becomes u_y → slide → u_y
        *independent_coordinates = vec![carpus::osim::spec::CoordinateIndex(
            spec.coordinates.iter().position(|c| c.name == "u_y").expect("u_y"),
        )];
    });
    assert!(matches!(e, CompileError::Coupler { problem: CouplerProblem::Cycle, .. }), "{e}");
    let e = error(|spec| {
        let copy = spec.constraints[0].clone();
        spec.constraints.push(copy);
    });
    assert!(matches!(e, CompileError::Coupler { problem: CouplerProblem::DrivenTwice, .. }), "{e}");
}

#[test]
fn verif_nan_is_named() {
    let e = error(|spec| spec.bodies[2].mass = f64::NAN);
    assert!(matches!(e, CompileError::NotFinite { property: "mass", .. }), "{e}");
}

#[test]
fn verif_body_without_joint_rests_at_ground_and_is_listed() {
    let mut spec = spec();
    // Without its joint, "freed" hangs on nothing.
    spec.joints.retain(|joint| joint.name != "free");
    let model = Model::compile(&spec).expect("compiles");
    let freed = model.body("freed").expect("freed");
    assert_eq!(model.unattached_bodies, [freed]);
    let mut cache = model.new_cache();
    model.update_positions(&model.default_coordinates(), &mut cache);
    assert_eq!(*cache.X_GB(freed), carpus::spatial::Transform::identity());
}
