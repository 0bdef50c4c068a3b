"""Many sets of parameters: the same moments, exact derivatives, ready for optimizers."""

from __future__ import annotations

import numpy as np
import pytest

import carpus


def test_verif_a_set_gives_the_moments_of_a_simulation(session: carpus.Session) -> None:
    batch = session.simulate(session.parameters)
    simulated = session.simulate()
    for name in session.trial_names:
        np.testing.assert_allclose(batch[name][0], simulated[name].moment, rtol=1e-12, atol=1e-12)
    assert batch.rmse().shape == (1, 28)


def test_verif_sets_do_not_mix(session: carpus.Session) -> None:
    sets = session.parameters * np.random.default_rng(1).uniform(0.95, 1.05, (7, 5, 4))
    together = session.simulate(sets).moment
    alone = np.concatenate([session.simulate(s).moment for s in sets])
    np.testing.assert_array_equal(together, alone)
    # Not contiguous.
    np.testing.assert_array_equal(session.simulate(sets[::2]).moment, alone[::2])


def test_verif_derivatives_against_differences(session: carpus.Session) -> None:
    p = session.parameters
    trials = session.trial_names[2:5]
    moment, by = session.jacobian(p, trials=trials)
    assert by.shape == (len(moment), 5, 4)
    for muscle, parameter in [(0, 0), (1, 1), (3, 2), (4, 3)]:
        h = 1e-5 * max(p[muscle, parameter], 0.05)
        sides = np.repeat(p[None], 2, axis=0)
        sides[0, muscle, parameter] += h
        sides[1, muscle, parameter] -= h
        up, down = session.simulate(sides, trials=trials).moment
        scale = np.abs(by[:, muscle, parameter]).max()
        np.testing.assert_allclose((up - down) / (2 * h), by[:, muscle, parameter], atol=2e-5 * scale)


def test_verif_gradient_is_that_of_the_loss(session: carpus.Session) -> None:
    p = session.parameters
    value, gradient = session.loss(p)
    moment, by = session.jacobian(p, use="train")
    measured = session.simulate(p, use="train").measured
    assert value == pytest.approx(np.mean((moment - measured) ** 2), rel=1e-12)
    np.testing.assert_allclose(gradient, 2 * np.mean((moment - measured)[:, None, None] * by, axis=0), rtol=1e-9)
    values, gradients = session.loss(np.stack([p, 1.01 * p]))
    assert values[0] == value and gradients.shape == (2, 5, 4)


def test_verif_scipy_minimizes_with_the_gradient(session: carpus.Session) -> None:
    optimize = pytest.importorskip("scipy.optimize")
    p = session.parameters

    def error(x: np.ndarray) -> tuple[float, np.ndarray]:
        scaled = p.copy()
        scaled[:, :3] *= np.exp(x.reshape(5, 3))
        value, gradient = session.loss(scaled)
        return value, (gradient[:, :3] * scaled[:, :3]).ravel()

    bounds = [(-0.2, 0.2)] * 15
    found = optimize.minimize(error, np.zeros(15), jac=True, bounds=bounds, options={"maxiter": 30})
    assert found.fun < 0.35 * error(np.zeros(15))[0]


@pytest.mark.parametrize("shape", [(5, 3), (4, 4), (2, 5, 5)])
def test_verif_another_shape_is_refused(session: carpus.Session, shape: tuple[int, ...]) -> None:
    with pytest.raises(carpus.InputError, match="expected"):
        session.simulate(np.ones(shape))


def test_verif_a_parameter_that_is_not_allowed_is_an_error(session: carpus.Session) -> None:
    p = session.parameters
    p[2, 1] = -0.1
    with pytest.raises(carpus.InputError, match="ECU"):
        session.simulate(p)
