"""Effects that are functions of Python."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import carpus


@pytest.fixture
def name() -> Iterator[str]:
    yield "python_effect"
    carpus.forget_effect("python_effect")


def friction(speed: np.ndarray, size: float, width: float) -> np.ndarray:
    return -size * np.tanh(speed / width)


PARAMETERS = {
    "size": carpus.Amplitude("N·m", 0.3, (0.0, 2.0)),
    "width": carpus.Shape("rad/s", 0.1, 0.05, (0.02, 0.5)),
}


def with_friction(session: carpus.Session, size: float) -> carpus.Session:
    """The trials with that much more friction."""
    trials = []
    about = session.trials()
    for name in session.trial_names:
        r, a = session.recorded(name), about.loc[name]
        moment = r.moment + friction(np.gradient(r.angle, r.time), size, 0.1)
        trials.append(carpus.Trial(name, r.time, r.angle, moment, r.excitation, a.contraction, a.direction, a.use))
    study = carpus.Study.from_memory(
        carpus.Model.bundled(),
        trials,
        coordinate="flexion",
        muscles=session.muscles,
        posture={"elbow_flexion": 90.0},
        damping=0.005 * 180 / np.pi,
    )
    return study.load()


def test_verif_a_function_that_is_missing_is_found(session: carpus.Session, name: str) -> None:
    carpus.define_effect(name, friction, name="Friction in Python", parameters=PARAMETERS)
    assert name in [e["id"] for e in carpus.effects()]
    faulty = with_friction(session, 0.6)
    found = faulty.diagnose([name, "gravity"])
    assert found.effects == [name], (found.verdict, found.effects)
    sizes = found.parameters["value"]
    assert sizes[name, "size"] == pytest.approx(0.6, abs=0.15)


def test_verif_derivatives_may_be_supplied(session: carpus.Session, name: str) -> None:
    called = []

    def derivatives(speed: np.ndarray, size: float, width: float) -> np.ndarray:
        called.append(1)
        th = np.tanh(speed / width)
        return np.stack([-th, size * (1 - th**2) * speed / width**2])

    carpus.define_effect(name, friction, parameters=PARAMETERS, derivatives=derivatives)
    session.diagnose([name])
    assert called


def test_verif_what_a_function_raises_is_raised(session: carpus.Session, name: str) -> None:

    def broken(angle: np.ndarray, size: float) -> np.ndarray:
        raise ZeroDivisionError("in the lab's function")

    carpus.define_effect(name, broken, parameters={"size": carpus.Amplitude("N·m", 1.0, (0.0, 5.0))})
    with pytest.raises(ZeroDivisionError, match="in the lab's function"):
        session.diagnose([name])


def test_verif_a_series_of_another_length_is_told(session: carpus.Session, name: str) -> None:
    def short(angle: np.ndarray, size: float) -> np.ndarray:
        return size * angle[1:]

    carpus.define_effect(name, short, parameters={"size": carpus.Amplitude("N·m", 1.0, (0.0, 5.0))})
    with pytest.raises(ValueError, match="finite values"):
        session.diagnose([name])


@pytest.mark.parametrize(
    ("id", "function", "said"),
    [
        ("gravity", lambda speed, size: speed, "catalogue"),
        ("with_unknown", lambda sped, size: sped, "sped"),
    ],
)
def test_verif_definitions_are_checked(id: str, function, said: str) -> None:
    with pytest.raises(carpus.InputError, match=said):
        carpus.define_effect(id, function, parameters={"size": carpus.Amplitude("N·m", 1.0, (0.0, 5.0))})
