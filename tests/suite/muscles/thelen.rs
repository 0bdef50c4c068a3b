//! The Thelen 2003 muscle: closed forms of its curves, and balance. OpenSim's numbers are in `dynamics` and `tools`.

use approx::assert_relative_eq;
use carpus::muscles::{MuscleModel, MuscleState, Thelen2003};
use carpus::osim::spec::{Location, MuscleKind, MuscleSpec, OtherMuscleSpec, PathSpec, Thelen2003Spec};

fn spec() -> MuscleSpec {
    let thelen2003 = Thelen2003Spec {
        fmax_tendon_strain: 0.04,
        fmax_muscle_strain: 0.6,
        kshape_active: 0.45,
        kshape_passive: 5.0,
        af: 0.25,
        flen: 1.4,
        fv_linear_extrap_threshold: 0.95,
        maximum_pennation_angle: 0.1_f64.acos(),
        activation_time_constant: 0.015,
        deactivation_time_constant: 0.05,
        minimum_activation: 0.01,
        default_activation: 0.05,
        default_fiber_length: 0.1,
    };
    MuscleSpec {
        name: "m".into(),
        at: Location::default(),
        applies_force: true,
        path: PathSpec::default(),
        max_isometric_force: 500.0,
        optimal_fiber_length: 0.1,
        tendon_slack_length: 0.2,
        pennation_angle_at_optimal: 0.3,
        max_contraction_velocity: 10.0,
        ignore_tendon_compliance: false,
        ignore_activation_dynamics: false,
        min_control: 0.01,
        max_control: 1.0,
        kind: MuscleKind::OtherClass {
            class: "Thelen2003Muscle".into(),
            law: Some(Box::new(OtherMuscleSpec::Thelen2003(thelen2003))),
        },
    }
}

fn muscle() -> Thelen2003 {
    match MuscleModel::from_spec(&spec()).expect("its properties") {
        MuscleModel::Thelen2003(muscle) => *muscle,
        other => panic!("{other:?}"),
    }
}

#[test]
fn verif_thelen_closed_forms() {
    let muscle = muscle();
    let cos = 0.3_f64.cos();
    // A tendon strained by FmaxTendonStrain pulls with the maximum isometric force.
    let (_, force) = muscle.rates(0.1, 1.0, 0.1 * cos + 0.2 * 1.04);
    assert_relative_eq!(force, 500.0, max_relative = 1e-12);
    // At rest, at optimal length and fully active, behind a rigid tendon.
    let force = muscle.inextensible_tendon_active_fiber_force(0.1 * cos + 0.2, 0.0, 1.0);
    assert_relative_eq!(force, 500.0 * cos, max_relative = 1e-6);
    // A fibre strained by FmaxMuscleStrain bears that force passively; its velocity balances what the tendon pulls.
    let at = muscle.dynamics(0.16, 0.5, 0.16 * (0.1 * 0.3_f64.sin() / 0.16_f64).asin().cos() + 0.2 * 1.03, 0.1);
    assert_relative_eq!(at.passive_fiber_force, 500.0, max_relative = 1e-12);
    assert_relative_eq!(at.fiber_force_along_tendon, at.tendon_force, max_relative = 1e-9);
    assert_relative_eq!(at.tendon_velocity + at.fiber_velocity_along_tendon, 0.1, max_relative = 1e-12);
}

#[test]
fn verif_thelen_equilibrium_is_at_rest() {
    let muscle = muscle();
    for activation in [0.01, 0.3, 1.0] {
        for length in [0.28, 0.3, 0.33] {
            let fiber = muscle.equilibrium(length, 0.0, activation).expect("a balance");
            let (velocity, force) = muscle.rates(fiber, activation, length);
            assert!(velocity.abs() < 1e-6, "{velocity} m/s at {length} m, activation {activation}");
            assert!(force >= 0.0);
        }
    }
}

#[test]
fn verif_thelen_derivatives_and_bad_properties() {
    let model = MuscleModel::from_spec(&spec()).unwrap();
    let state = |fiber_length| MuscleState { activation: 0.4, equilibrium_state: fiber_length, fiber_velocity: 0.0 };
    let [_, by, _] = model.linearize(state(0.11), 0.31, 0.05);
    let (up, down) = (model.rates(state(0.11 + 1e-7), 0.31, 0.05), model.rates(state(0.11 - 1e-7), 0.31, 0.05));
    assert_relative_eq!(
        by.equilibrium_state,
        (up.equilibrium_state - down.equilibrium_state) / 2e-7,
        max_relative = 1e-5
    );
    assert_relative_eq!(by.tendon_force, (up.tendon_force - down.tendon_force) / 2e-7, max_relative = 1e-5);
    let mut broken = spec();
    if let MuscleKind::OtherClass { law: Some(law), .. } = &mut broken.kind
        && let OtherMuscleSpec::Thelen2003(p) = law.as_mut()
    {
        p.flen = 0.9;
    }
    let error = MuscleModel::from_spec(&broken).unwrap_err().to_string();
    assert!(error.contains("m: Flen is 0.9, expected a number above 1"), "{error}");
}
