"""Models: edits are splices, properties have OpenSim's names, computations are those of OpenSim."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import carpus

# Where a path touches a cylinder is found to OpenSim's tolerance: the moment arm is not exactly the derivative [m].
DERIVATIVE_TOLERANCE = 5e-7

WRIST = ROOT / "models" / "wrist.osim"


@pytest.fixture
def model() -> carpus.Model:
    return carpus.Model.read(WRIST)


def test_verif_bytes_that_are_not_edited_stay(model: carpus.Model, tmp_path: Path) -> None:
    before = WRIST.read_bytes()
    assert model.to_bytes() == before
    model.muscles["FCR"].max_isometric_force = 123.5
    model.bodies["hand"].mass = 0.5
    changed = [(a, b) for a, b in zip(before.split(b"\n"), model.to_bytes().split(b"\n"), strict=True) if a != b]
    assert len(changed) == 2 and b"123.5" in changed[0][1] + changed[1][1]
    model.write(tmp_path / "edited.osim")
    again = carpus.Model.read(tmp_path / "edited.osim")
    assert again.muscles["FCR"].max_isometric_force == 123.5 and again.bodies["hand"].mass == 0.5


def test_verif_properties_have_the_names_of_opensim(model: carpus.Model) -> None:
    ecrl = model.muscles["ECRL"]
    assert ecrl.optimal_fiber_length == 0.081 and ecrl.to_dict()["class"] == "Millard2012EquilibriumMuscle"
    ecrl.set("FiberForceLengthCurve/strain_at_one_norm_force", 0.55)
    assert float(ecrl.get("FiberForceLengthCurve/strain_at_one_norm_force")) == 0.55
    flexion = model.coordinates["flexion"]
    assert flexion.range.shape == (2,) and flexion.motion_type == "rotational"
    with pytest.raises(AttributeError, match="no property"):
        _ = ecrl.nonsense
    with pytest.raises(carpus.InputError, match="tendon_slack_length"):
        ecrl.set("tendon_slack_lenght", 0.2)
    with pytest.raises(carpus.InputError):
        ecrl.optimal_fiber_length = -1.0
    assert ecrl.optimal_fiber_length == 0.081
    with pytest.raises(KeyError, match="ECRL"):
        _ = model.muscles["ECRX"]
    assert len(model.markers.to_pandas()) == len(model.markers)
    assert len(model.muscles.to_pandas()) == 5 and "ECRL" in model._repr_html_()


def test_verif_moment_arms_are_derivatives_of_lengths(model: carpus.Model) -> None:
    q = model.postures("flexion", np.linspace(-0.8, 0.8, 33))
    arms = model.paths(q, about="flexion").moment_arm
    h = 1e-6
    column = model.coordinate_names.index("flexion")
    up, down = q.copy(), q.copy()
    up[:, column] += h
    down[:, column] -= h
    difference = -(model.paths(up).length - model.paths(down).length) / (2 * h)
    np.testing.assert_allclose(arms, difference, atol=DERIVATIVE_TOLERANCE, rtol=0)


def test_verif_scaled_and_upgraded(model: carpus.Model, lab_models: Path | None = None) -> None:
    scaled, said = model.scaled({"hand": 1.1})
    assert said["mass_kg"] > said["mass_before_kg"]
    assert scaled.bodies["hand"].mass == pytest.approx(1.1**3 * model.bodies["hand"].mass)
    same, left_out = model.upgraded()
    assert not left_out and same.name == model.name
    with pytest.raises(carpus.InputError, match="hnad"):
        model.scaled({"hnad": 1.1})


def test_verif_forces_at_rest(model: carpus.Model) -> None:
    rest = model.equilibrium(0.5, about="flexion", flexion=0.3)
    assert list(rest.index) == model.muscle_names
    assert (rest["status"] == "converged").all()
    arms = model.paths(model.posture(flexion=0.3), about="flexion").moment_arm[0]
    np.testing.assert_allclose(rest["flexion_moment_arm_m"], arms, rtol=1e-12)
    np.testing.assert_allclose(rest["flexion_moment_n_m"], arms * rest["tendon_force_n"], rtol=1e-12)
    with pytest.raises(carpus.InputError, match="activation"):
        model.equilibrium(1.5)


def test_verif_motion_from_forces(model: carpus.Model) -> None:
    t = np.linspace(0, 0.2, 2001)
    still = model.forward(t, 0.01)
    flexed = model.forward(t, np.where(np.char.startswith(model.muscle_names, "F"), 0.5, 0.01))
    i = model.coordinate_names.index("flexion")
    assert still.q.shape == (2001, len(model.coordinate_names)) and flexed.q[-1, i] > still.q[-1, i] + 0.05
    frame = flexed.to_pandas()
    rate = np.gradient(frame["flexion/value"], t)[1:-1]
    # Central differences over 0.1 ms, of a motion that reaches 15 rad/s and hits a limit.
    assert np.quantile(np.abs(rate - frame["flexion/speed"].iloc[1:-1]), 0.99) < 0.05
    with pytest.raises(carpus.InputError, match="ascending"):
        model.forward(t[::-1])
    with pytest.raises(carpus.InputError, match=r"excitation: expected shape a number, \(5,\)"):
        model.forward(t, np.ones(9))
    with pytest.raises(carpus.InputError, match=r"q: expected shape \(4,\), found \(2,\)"):
        model.forward(t, q=[0.0, 0.1])
    with pytest.raises(carpus.InputError, match=r"q: expected shape"):
        model.paths(np.zeros((2, 2, 4)))


def test_verif_a_file_that_is_no_model_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.osim").write_text("<Nothing/>")
    with pytest.raises(carpus.InputError) as caught:
        carpus.Model.read(tmp_path / "a.osim")
    assert caught.value.diagnostics[0].file == str(tmp_path / "a.osim")


def test_val_opensim_lengths_and_moment_arms(model: carpus.Model, opensim) -> None:
    reference = opensim.Model(str(WRIST))
    state = reference.initSystem()
    angles = np.linspace(-0.9, 0.9, 13)
    paths = model.paths(model.postures("flexion", angles), about="flexion")
    coordinate = reference.getCoordinateSet().get("flexion")
    for k, angle in enumerate(angles):
        coordinate.setValue(state, angle)
        reference.realizePosition(state)
        for j, name in enumerate(model.muscle_names):
            muscle = reference.getMuscles().get(name)
            assert paths.length[k, j] == pytest.approx(muscle.getLength(state), abs=1e-9)
            assert paths.moment_arm[k, j] == pytest.approx(muscle.computeMomentArm(state, coordinate), abs=1e-7)


def test_val_opensim_equilibrium(model: carpus.Model, opensim) -> None:
    reference = opensim.Model(str(WRIST))
    state = reference.initSystem()
    reference.getCoordinateSet().get("flexion").setValue(state, 0.3)
    for name in model.muscle_names:
        reference.getMuscles().get(name).setActivation(state, 0.5)
    reference.equilibrateMuscles(state)
    reference.realizeDynamics(state)
    rest = model.equilibrium(0.5, flexion=0.3)
    for name in model.muscle_names:
        muscle = reference.getMuscles().get(name)
        force = muscle.getMaxIsometricForce()
        assert rest.loc[name, "tendon_force_n"] == pytest.approx(muscle.getTendonForce(state), abs=2e-5 * force)
        assert rest.loc[name, "fiber_length_m"] == pytest.approx(muscle.getFiberLength(state), abs=1e-6)


def test_val_opensim_poses(model: carpus.Model, opensim) -> None:
    reference = opensim.Model(str(WRIST))
    state = reference.initSystem()
    reference.getCoordinateSet().get("flexion").setValue(state, -0.4)
    reference.realizePosition(state)
    poses = model.poses(model.posture(flexion=-0.4))[0]
    for pose, name in zip(poses, model.bodies, strict=True):
        X = reference.getBodySet().get(name).getTransformInGround(state)
        p = X.p()
        np.testing.assert_allclose(pose[:3, 3], [p.get(i) for i in range(3)], atol=1e-12)
