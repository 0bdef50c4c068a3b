"""Studies and their use cases: the same bytes as the command's, errors that say where, Ctrl-C."""

from __future__ import annotations

import filecmp
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import DEMO

import carpus


def run(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "carpus", *words], cwd=cwd, capture_output=True, text=True)


def files_of(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("use_case", ["compare", "personalize", "simulate"])
def test_verif_files_are_the_bytes_of_the_command(use_case: str, tmp_path: Path) -> None:
    said = f"carpus {use_case} {DEMO} --out command"
    done = run(*said.split()[1:], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    session = carpus.Study.open(DEMO, command=said).load("P01")
    getattr(session, use_case)().write(tmp_path / "python")
    names = files_of(tmp_path / "command")
    assert names == files_of(tmp_path / "python") and len(names) > 30
    # The folder's manifest says when nothing was left of earlier runs; all else are results.
    results = sorted(n for n in names if n.startswith("P01/"))
    _, mismatch, errors = filecmp.cmpfiles(tmp_path / "command", tmp_path / "python", results, shallow=False)
    assert not mismatch and not errors


def test_verif_diagnosis_is_that_of_the_command(tmp_path: Path) -> None:
    said = f"carpus diagnose {DEMO} --candidates coulomb_friction,gravity --out command"
    done = run(*said.split()[1:], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    session = carpus.Study.open(DEMO, command=said).load("P01")
    session.diagnose(["coulomb_friction", "gravity"]).write(tmp_path / "python")
    for name in ["diagnosis.json", "results.json", "report.html"]:
        assert (tmp_path / "command/P01" / name).read_bytes() == (tmp_path / "python/P01" / name).read_bytes()


def test_verif_fit_lowers_the_error_of_held_out_trials(fit: carpus.Personalization) -> None:
    nrmse = fit.errors["nrmse"]
    assert nrmse["held out", "Personalized"] < 0.06 < 0.12 < nrmse["held out", "Before"]
    assert len(fit.parameters) == 15
    row = fit.parameters.loc[("FCR", "max_isometric_force")]
    assert row.interval_lower < row.after < row.interval_upper and row.unit == "N"
    assert fit.model.muscles["FCR"].max_isometric_force == pytest.approx(row.after, rel=1e-12)


def test_verif_results_show_themselves(fit: carpus.Personalization, diagnosis: carpus.Diagnosis) -> None:
    html = fit._repr_html_()
    assert "<svg" in html and "Personalized" in html and "nan" not in html.lower()
    assert fit.report().startswith("<!") and "Personalized" in repr(fit)
    assert fit.to_dict()["schema"] == "carpus.results/1"
    frame = fit.moments(fit.trial_errors.index[0][0])
    assert list(frame.columns) == ["measured", "before", "personalized"]
    assert diagnosis.verdict == "nothing_detectable" and diagnosis.verdict in diagnosis._repr_html_()
    assert len(diagnosis.candidates) == 36 and diagnosis.effects == []


def test_verif_a_simulation_shows_itself(session: carpus.Session) -> None:
    simulation = session.simulate()
    frame = simulation.to_pandas()
    assert list(frame.columns) == ["measured", "model"] and frame.index.names == ["trial", "time_s"]
    assert frame.index.get_level_values("trial").nunique() == 28 and frame.notna().all(axis=None)
    assert "<svg" in simulation._repr_html_() and "28 trials" in repr(simulation)
    assert simulation.errors.empty and simulation.trial_errors.empty


def test_verif_frames_go_to_parquet_and_back(fit: carpus.Personalization, tmp_path: Path) -> None:
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    fit.parameters.to_parquet(tmp_path / "parameters.parquet")
    back = pd.read_parquet(tmp_path / "parameters.parquet")
    pd.testing.assert_frame_equal(back, fit.parameters)


def test_verif_trials_over_time(session: carpus.Session, fit: carpus.Personalization) -> None:
    name = session.trial_names[3]
    trial, recorded = fit[name], session.recorded(name)
    n = len(recorded.time)
    assert trial.fiber_length.shape == (5, n) == recorded.moment_arm.shape
    np.testing.assert_allclose(trial.muscle_moment, trial.tendon_force * recorded.moment_arm, rtol=1e-12, atol=1e-12)
    series = fit.moments(name)
    np.testing.assert_allclose(series["personalized"], trial.moment, atol=5e-7 + 1e-5 * np.abs(trial.moment).max())


def test_verif_errors_have_place_and_hint(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text('[study]\nname = "x"\nmodle = "a.osim"\n')
    with pytest.raises(carpus.InputError) as caught:
        carpus.Study.open(tmp_path)
    found = caught.value.diagnostics
    assert any(d.place == f"{tmp_path}/study.toml:3" or (d.line == 3 and d.hint) for d in found), str(caught.value)
    with pytest.raises(carpus.InputError, match=r"did you mean `coulomb_friction`\?"):
        carpus.demo().load().diagnose(["columb_friction"])
    with pytest.raises(carpus.InputError, match="no participant `P02`"):
        carpus.demo().load("P02")


def test_verif_other_threads_go_on_meanwhile(session: carpus.Session) -> None:
    counted, done = [0], threading.Event()

    def count() -> None:
        while not done.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    before = counted[0]
    session.simulate(np.repeat(session.parameters[None], 300, axis=0))
    after = counted[0]
    done.set()
    thread.join()
    assert after - before > 5


@pytest.mark.parametrize("use_case", ["personalize", "diagnose"])
def test_verif_ctrl_c_stops_long_work(use_case: str, session: carpus.Session) -> None:
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    begun = time.monotonic()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        getattr(session, use_case)()
    assert time.monotonic() - begun < 5
    # What was stopped does not stop what comes after.
    assert session.compare().errors.loc[("held out", "Simulated"), "nrmse"] > 0.1


def arrays_of(session: carpus.Session) -> dict[str, Callable[[int], object]]:
    """Works on arrays by what their bars say; each lasts the longer the larger its number is."""
    model = carpus.Model.bundled()
    sets = session.parameters[None]
    return {
        "simulating sets of parameters": lambda n: session.simulate(np.repeat(sets, 500 * n, axis=0)),
        "errors of sets of parameters": lambda n: session.loss(np.repeat(sets, 500 * n, axis=0)),
        "forward dynamics": lambda n: model.forward(np.linspace(0, 10 * n, 1000 * n + 1)),
        "muscle paths": lambda n: model.paths(np.tile(model.posture(), (50_000 * n, 1)), about="flexion"),
    }


def is_interrupted(work: Callable[[], object], after: float) -> bool:
    """Whether Ctrl-C so many seconds after its begin found the work at it."""
    timer = threading.Timer(after, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        work()
    except KeyboardInterrupt:
        return True
    timer.cancel()
    timer.join()
    return False


# The machine decides how large is long enough: the sizes double until the work lasts.
SIZES = [2**k for k in range(8)]


def test_verif_ctrl_c_stops_work_on_arrays(session: carpus.Session) -> None:
    for said, work in arrays_of(session).items():
        for size in SIZES:
            begun = time.monotonic()
            if is_interrupted(lambda: work(size), after=0.2):  # noqa: B023
                assert time.monotonic() - begun < 3
                break
        else:
            pytest.fail(f"{said}: the work ended before it could be stopped")
    assert np.isfinite(session.loss(session.parameters)[0])


def test_verif_threads_share_a_model() -> None:
    model = carpus.Model.bundled()
    q = np.tile(model.posture(), (100_000, 1))
    found: list[object] = []
    threads = [threading.Thread(target=lambda: found.append(model.paths(q).length[-1])) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 3 and all(np.array_equal(f, found[0]) for f in found)


@pytest.mark.parametrize("shape", [(4,), (3, 4), (2, 3, 4), (2, 2, 5, 4)])
def test_verif_parameters_of_another_shape_are_told(shape: tuple[int, ...], session: carpus.Session) -> None:
    for work in (session.simulate, session.loss, session.jacobian):
        with pytest.raises(carpus.InputError, match=r"parameters: expected shape \(5, 4\)"):
            work(np.ones(shape))


def test_verif_arrays_show_and_write_themselves(session: carpus.Session, tmp_path: Path) -> None:
    pd = pytest.importorskip("pandas")
    name = session.trial_names[2]
    model = carpus.Model.bundled()
    for of, columns in [
        (session.recorded(name), 2 + 4 * 5),
        (session.simulate()[name], 1 + 4 * 5),
        (session.simulate(session.parameters), 28),
        (model.paths(model.posture(), about="flexion"), 2 * 5),
        (model.forward([0, 0.01]), 2 * 4 + 2 * 5),
    ]:
        assert of.to_pandas().shape[1] == columns and "<table" in of._repr_html_()
        assert next(iter(of.to_dict().values())) is next(iter(vars(of).values()))
        file = of.write(tmp_path / "arrays")
        read = pd.read_csv(file, index_col=0)
        assert np.array_equal(read.to_numpy(), of.to_pandas().to_numpy()) and read.shape[1] == columns
        with pytest.raises(carpus.InputError, match="there is such a file"):
            of.write(tmp_path / "arrays")
    with pytest.raises(carpus.InputError, match="expected parameters"):
        session.simulate(use="train")  # type: ignore[call-overload]


def test_verif_progress_is_shown_where_it_is_wanted(
    session: carpus.Session, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("tqdm")
    study = session.study
    carpus.show_progress(True)
    try:
        for said, work in {
            "fitting P01": lambda: session.personalize(intervals=False),
            "identifying P01": lambda: session.identify(draws=10),
            "screening P01, isometric": lambda: study.sensitivity(starts=10, resamples=10),
        }.items():
            work()
            assert said in capsys.readouterr().err
        for said, sized in arrays_of(session).items():
            shown = ""
            for size in SIZES:
                sized(size)
                shown = capsys.readouterr().err
                if shown:
                    break
            assert said in shown
    finally:
        carpus.show_progress(None)


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, "1"])
def test_verif_a_seed_is_a_whole_number(seed: object, session: carpus.Session) -> None:
    for work in (session.compare, session.personalize, session.identify, session.study.sensitivity):
        with pytest.raises(carpus.InputError, match="seed: expected a whole number from 0 on, found"):
            work(seed=seed)  # type: ignore[operator]


def test_verif_effects_by_name(session: carpus.Session, diagnosis: carpus.Diagnosis, tmp_path: Path) -> None:
    with pytest.warns(carpus.CarpusWarning, match="call for no effect"):
        added = session.add_effects(["joint_damping"], diagnosis=diagnosis)
    assert [s["label"] for s in added.ledger["steps"]][-1] == "+ Viscous damping of the joint" and len(
        added.to_pandas()
    ) == 3
    added.write(tmp_path / "effects")
    assert (tmp_path / "effects/P01/model.osim").read_bytes() == added.model.to_bytes()
    assert (tmp_path / "effects/P01/ledger.json").is_file()


def test_verif_identify_and_evaluate(session: carpus.Session, tmp_path: Path) -> None:
    found = session.identify(draws=400)
    assert found.draws.shape == (400, 15) and {"muscle", "property", "interval_lower"} <= set(found.parameters)
    np.testing.assert_allclose(found.draws.mean().abs() < 1, True)
    found.write(tmp_path / "identified")
    assert (tmp_path / "identified/P01/draws.csv").is_file()
    errors = carpus.demo().evaluate().to_pandas()
    assert len(errors) > 3


def test_verif_priors_of_a_frame_are_those_of_a_table(session: carpus.Session, tmp_path: Path) -> None:
    pd = pytest.importorskip("pandas")
    rows = [("FCR", "optimal_fiber_length", 1.02, 0.02, "model"), ("ECU", "optimal_fiber_length", 0.062, 0.001, "file")]
    asked = {"properties": ["optimal_fiber_length"], "draws": 50}
    frame = pd.DataFrame(rows, columns=["muscle", "property", "mean", "sd", "unit"])
    frame.to_csv(tmp_path / "priors.csv", index=False)
    a = session.identify(priors=frame, **asked).parameters.set_index(["muscle", "property"])
    b = session.identify(priors=tmp_path / "priors.csv", **asked).parameters.set_index(["muscle", "property"])
    numbers = a.select_dtypes("number").columns
    pd.testing.assert_frame_equal(a[numbers], b[numbers])
    row = a.loc[("ECU", "optimal_fiber_length")]
    assert row["interval_upper"] - row["interval_lower"] < 4 * 0.001
    with pytest.raises(carpus.InputError, match="sd above 0"):
        session.identify(priors=frame.assign(sd=0.0))
    with pytest.raises(carpus.InputError, match="missing: sd"):
        session.identify(priors=frame.drop(columns="sd"))


def test_verif_one_command_in_a_process_of_its_own(tmp_path: Path) -> None:
    told = carpus.command("info", DEMO.parent.parent / "models" / "wrist.osim")
    assert told["schema"] == "carpus.info/1"
    with pytest.raises(carpus.InputError, match=r"no_such\.osim"):
        carpus.command("info", "no_such.osim")
