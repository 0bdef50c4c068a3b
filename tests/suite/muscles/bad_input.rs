//! Parameters and inputs that no muscle can have, and states that OpenSim cannot solve.

use super::tables::{fixtures, specs};
use carpus::muscles::curves::CurveError;
use carpus::muscles::{EquilibriumError, Millard2012, MuscleError};
use carpus::osim::spec::{Millard2012Spec, MuscleKind, MuscleSpec};

fn default_spec() -> MuscleSpec {
    specs(&fixtures()).into_iter().find(|spec| spec.name == "default").expect("default muscle")
}

/// The error for the default muscle after a change, without the layer that names the muscle.
fn refused(change: impl FnOnce(&mut MuscleSpec)) -> MuscleError {
    let mut spec = default_spec();
    change(&mut spec);
    match Millard2012::from_spec(&spec).expect_err("must be refused") {
        MuscleError::InMuscle { muscle, source } => {
            assert_eq!(muscle, "default");
            *source
        }
        other => other,
    }
}

fn millard(spec: &mut MuscleSpec) -> &mut Millard2012Spec {
    match &mut spec.kind {
        MuscleKind::Millard2012Equilibrium(millard) => millard,
        MuscleKind::OtherClass { class, .. } => panic!("{class}"),
    }
}

#[test]
fn verif_invalid_properties_are_named() {
    let property = |error: MuscleError| match error {
        MuscleError::InvalidProperty { property, .. } => property,
        other => panic!("{other}"),
    };
    assert_eq!(property(refused(|s| s.optimal_fiber_length = -0.1)), "optimal_fiber_length");
    assert_eq!(property(refused(|s| s.optimal_fiber_length = f64::NAN)), "optimal_fiber_length");
    assert_eq!(property(refused(|s| s.tendon_slack_length = 0.0)), "tendon_slack_length");
    let rigid = |s: &mut MuscleSpec| (s.ignore_tendon_compliance, s.tendon_slack_length) = (true, -0.1);
    assert_eq!(property(refused(rigid)), "tendon_slack_length");
    assert_eq!(property(refused(|s| s.max_isometric_force = f64::INFINITY)), "max_isometric_force");
    assert_eq!(property(refused(|s| s.pennation_angle_at_optimal = 2.0)), "pennation_angle_at_optimal");
    assert_eq!(property(refused(|s| s.min_control = 0.0)), "min_control");
    assert_eq!(property(refused(|s| millard(s).minimum_activation = -0.1)), "minimum_activation");
    assert_eq!(property(refused(|s| millard(s).activation_time_constant = 0.0)), "activation_time_constant");
    let undamped = refused(|s| {
        millard(s).fiber_damping = 0.0;
        millard(s).minimum_activation = 0.0;
    });
    assert_eq!(property(undamped), "minimum_activation");
}

#[test]
fn verif_invalid_curves_are_named() {
    let error = refused(|s| millard(s).tendon_force_length.curviness = Some(0.5));
    assert!(
        matches!(error, MuscleError::Curve(CurveError::PartlySet { curve: "TendonForceLengthCurve", .. })),
        "{error}"
    );
    let error = refused(|s| millard(s).force_velocity.isometric_slope = 0.5);
    let expected = CurveError::OutOfRange {
        curve: "ForceVelocityCurve",
        property: "isometric_slope",
        expected: "above 1".to_owned(),
        found: 0.5,
    };
    assert_eq!(error, MuscleError::Curve(expected));
    let error = refused(|s| millard(s).active_force_length.transition_norm_fiber_length = f64::NAN);
    assert!(error.to_string().contains("transition_norm_fiber_length"), "{error}");
}

#[test]
fn verif_other_classes_are_refused() {
    let error = refused(|s| s.kind = MuscleKind::OtherClass { class: "Thelen2003Muscle".to_owned(), law: None });
    assert_eq!(error, MuscleError::NotComputed { muscle: "default".into(), class: "Thelen2003Muscle".into() });
}

#[test]
fn verif_forces_that_are_not_finite_name_their_cause() {
    let mut spec = default_spec();
    spec.optimal_fiber_length = 1e308;
    let muscle = Millard2012::from_spec(&spec).expect("muscle");
    let error = muscle.equilibrium(0.3, 0.5).expect_err("no force");
    assert!(matches!(error, EquilibriumError::ForceNotFinite { .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.starts_with("default: ") && text.contains("optimal_fiber_length: 1e308 is not plausible"), "{text}");
    assert!(!text.contains("NaN"), "{text}");
}

#[test]
fn verif_equilibrium_refuses_unusable_input() {
    let muscle = Millard2012::from_spec(&default_spec()).expect("valid");
    let error = muscle.equilibrium(f64::NAN, 0.5).expect_err("NaN");
    assert!(matches!(error, EquilibriumError::NotFinite { quantity: "path length", .. }), "{error}");
    let error = muscle.equilibrium(0.25, f64::NAN).expect_err("NaN");
    assert!(matches!(error, EquilibriumError::NotFinite { quantity: "activation", .. }), "{error}");
    let error = muscle.equilibrium(-0.25, 0.5).expect_err("negative");
    assert!(matches!(error, EquilibriumError::PathLength { .. }), "{error}");
}

/// Every positive path length has an equilibrium or leaves the fibre at its minimum, however extreme.
#[test]
fn verif_equilibrium_exists_from_tiny_to_huge_paths() {
    for spec in specs(&fixtures()) {
        let muscle = Millard2012::from_spec(&spec).expect("valid");
        for i in 0..400 {
            let path_length = 1e-4 * 10_f64.powf(f64::from(i) / 80.0);
            for activation in [0.0, 0.01, 0.3, 1.0] {
                let at = muscle.equilibrium(path_length, activation).expect("equilibrium");
                assert!(at.tendon_force.is_finite() && at.fiber_length >= muscle.minimum_fiber_length());
                let velocity = muscle.fiber_velocity(at.fiber_length, activation, path_length, 0.0);
                assert!(velocity.fiber_velocity.is_finite(), "{} {path_length} {at:?}", spec.name);
            }
        }
    }
}
