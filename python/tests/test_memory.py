"""Studies of arrays and data frames."""

from __future__ import annotations

import numpy as np
import pytest

import carpus

MUSCLES = ["ECRL", "ECRB", "ECU", "FCR", "FCU"]


def trials_of(session: carpus.Session) -> list[carpus.Trial]:
    about = session.trials()
    made = []
    for name in session.trial_names:
        r, a = session.recorded(name), about.loc[name]
        made.append(
            carpus.Trial(
                name,
                r.time,
                r.angle,
                r.moment,
                r.excitation,
                a.contraction,
                a.direction,
                a.use,
                effort_percent=a.effort_percent,
            )
        )
    return made


def test_verif_arrays_give_what_files_give(session: carpus.Session, fit: carpus.Personalization) -> None:
    study = carpus.Study.from_memory(
        carpus.Model.bundled(),
        trials_of(session),
        coordinate="flexion",
        muscles=MUSCLES,
        posture={"elbow_flexion": 90.0, "pro_sup": 0.0},
        damping=0.005 * 180 / np.pi,
        bounds={
            "optimal_fiber_length": (0.822, 1.178),
            "tendon_slack_length": (0.868, 1.132),
            "max_isometric_force": (0.42, 2.514),
        },
    )
    from_arrays = study.load()
    a, b = from_arrays.compare(), session.compare()
    for name in session.trial_names:
        np.testing.assert_allclose(a[name].moment, b[name].moment, rtol=1e-9, atol=1e-9)
    refit = from_arrays.personalize(intervals=False)
    np.testing.assert_allclose(refit.parameters["after"], fit.parameters["after"], rtol=1e-4)


def test_verif_a_data_frame_is_a_trial() -> None:
    pd = pytest.importorskip("pandas")
    t = np.arange(0, 2, 0.01)
    frame = pd.DataFrame({"time_s": t, "angle_deg": 30 * np.sin(t), "moment_n_m": 3 * np.sin(t)})
    for muscle in MUSCLES:
        frame[f"emg_{muscle}"] = 0.2
    trial = carpus.Trial.from_frame("swing", frame, {m: f"emg_{m}" for m in MUSCLES}, contraction="isotonic")
    study = carpus.Study.from_memory(carpus.Model.bundled(), [trial], coordinate="flexion", muscles=MUSCLES)
    simulated = study.load().simulate()
    assert simulated["swing"].moment.shape == t.shape
    np.testing.assert_allclose(trial.angle, np.deg2rad(30 * np.sin(t)))


def test_verif_a_trial_has_a_posture_of_its_own() -> None:
    t = np.arange(0, 2, 0.01)
    arrays = [t, 0.5 * np.sin(t), np.sin(t), np.full((5, t.size), 0.2)]

    def moments(of_trial: dict | None, **of_study: float) -> tuple[np.ndarray, carpus.Session]:
        trial = carpus.Trial("swing", *arrays, "isotonic", held=of_trial)
        about = {"coordinate": "flexion", "muscles": MUSCLES, "posture": of_study}
        session = carpus.Study.from_memory(carpus.Model.bundled(), [trial], **about).load()
        return session.simulate()["swing"].moment, session

    bent, session = moments({"elbow_flexion": 30.0}, elbow_flexion=90.0)
    assert session.trials().loc["swing", "held"] == {"elbow_flexion": 30.0}
    np.testing.assert_allclose(bent, moments(None, elbow_flexion=30.0)[0], rtol=1e-12, atol=1e-12)
    assert np.abs(bent - moments(None, elbow_flexion=90.0)[0]).max() > 1e-6
    with pytest.raises(carpus.InputError, match="held"):
        moments({"elbow_flexion": np.nan})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"moment": np.ones(49)}, "50 values"),
        ({"contraction": "isometrc"}, "contraction"),
        ({"time": np.r_[np.arange(25), np.arange(25)] * 0.01}, "time"),
        ({"excitation": np.full((5, 50), 7.0)}, "7"),
    ],
)
def test_verif_arrays_get_the_checks_of_files(change: dict, said: str) -> None:
    arrays = {
        "time": np.arange(50) * 0.01,
        "angle": np.zeros(50),
        "moment": np.ones(50),
        "excitation": np.full((5, 50), 0.1),
    }
    with pytest.raises(carpus.InputError, match=said):
        carpus.Study.from_memory(
            carpus.Model.bundled(), [carpus.Trial("a", **{**arrays, **change})], coordinate="flexion", muscles=MUSCLES
        )


def test_verif_a_study_without_trials_is_told() -> None:
    with pytest.raises(carpus.InputError, match="trials: expected at least one"):
        carpus.Study.from_memory(carpus.Model.bundled(), [], coordinate="flexion", muscles=MUSCLES)
