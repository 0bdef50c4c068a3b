"""What several participants share: the same bytes as the command's, tables, errors."""

from __future__ import annotations

import filecmp
import subprocess
import sys
from pathlib import Path

import json_outputs
import pytest
from conftest import DEMO, ROOT

import carpus

WANTED = ["coulomb_friction", "gravity"]
FRICTION = {"P01": 0.7, "P02": 0.9, "P03": 1.1}
"""Friction that is added to the participants' moments [N·m]."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three participants: the isotonic trials and some others of the bundled one, with more friction."""
    import numpy as np
    import pandas as pd

    study = tmp_path_factory.mktemp("cohort") / "study"
    study.mkdir()
    text = (DEMO / "study.toml").read_text()
    (study / "study.toml").write_text(text.replace("../../models/wrist.osim", str(ROOT / "models" / "wrist.osim")))
    people, trials = pd.read_csv(DEMO / "participants.csv"), pd.read_csv(DEMO / "trials.csv")
    trials = trials[trials["contraction"].isin(["isotonic", "mvc"])]
    pd.concat([people.assign(participant=p) for p in FRICTION]).to_csv(study / "participants.csv", index=False)
    tables = []
    for place, (name, friction) in enumerate(FRICTION.items()):
        rng = np.random.default_rng(place)
        for file in trials["file"]:
            frame = pd.read_csv(DEMO / file)
            speed = np.gradient(np.deg2rad(frame["angle_deg"]), frame["time_s"])
            frame["moment_n_m"] += 0.02 * rng.standard_normal(len(frame)) - friction * np.tanh(speed / 0.05)
            (study / name).mkdir(exist_ok=True)
            frame.to_csv(study / name / Path(file).name, index=False)
        tables.append(trials.assign(participant=name, file=[f"{name}/{Path(f).name}" for f in trials["file"]]))
    pd.concat(tables).to_csv(study / "trials.csv", index=False)
    return study


@pytest.fixture(scope="module")
def said(folder: Path) -> str:
    return f"carpus diagnose {folder} --candidates {','.join(WANTED)} --out command"


@pytest.fixture(scope="module")
def found(folder: Path, said: str) -> carpus.CohortDiagnosis:
    return carpus.Study.open(folder, command=said).diagnose(WANTED)


def test_verif_a_cohort_shares_what_was_put_in(found: carpus.CohortDiagnosis) -> None:
    assert found.effects == ["coulomb_friction"] and list(found) == list(FRICTION)
    shared = found.to_pandas().loc["coulomb_friction", "friction"]
    # The catalogue's friction sets in at another width: its size is somewhat smaller.
    assert shared["unit"] == "N·m" and shared["mean"] == pytest.approx(0.9, rel=0.25)
    assert shared["mean_lower"] < shared["mean"] < shared["mean_upper"]
    of_each = found.participants.loc["coulomb_friction", "friction"]
    assert (of_each["probability"] > 0.5).all() and of_each["pooled"].is_monotonic_increasing
    assert "gravity" in found.others and found["P02"].effects == ["coulomb_friction"]
    assert "coulomb_friction" in repr(found) and "P03" in found._repr_html_() and "P03" in found.report()
    assert found.to_dict()["schema"] == "carpus.cohort_diagnosis/1"


def test_verif_a_cohort_is_that_of_the_command(found: carpus.CohortDiagnosis, said: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "carpus", *said.split()[1:]], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    found.write(tmp_path / "python")
    names = sorted(p.relative_to(tmp_path / "command").as_posix() for p in (tmp_path / "command").rglob("*.*"))
    results = [n for n in names if n.startswith(("P0", "cohort"))]
    assert {"cohort.json", "cohort.html", "P03/evidence.json"} <= set(results)
    _, mismatch, errors = filecmp.cmpfiles(tmp_path / "command", tmp_path / "python", results, shallow=False)
    assert not mismatch and not errors


def test_verif_tasks_of_a_study_give_the_bytes_of_one_run(folder: Path, tmp_path: Path) -> None:
    def study(out: str, task: str | None = None) -> carpus.StudyReport:
        return carpus.Study.open(folder).study(tmp_path / out, steps=["evaluate"], task=task)

    whole = study("whole")
    parts = [study("shared", f"{i}/2") for i in (2, 1)]
    assert [p.report for p in parts] == ["", ""] and not (tmp_path / "shared" / "report.html").exists()
    assert sum(p.units_computed for p in parts) == whole.units_computed == len(FRICTION)
    merged = study("shared")
    assert (merged.units_found_finished, merged.units_computed) == (len(FRICTION), 0)
    names = [p.relative_to(tmp_path / "whole").as_posix() for p in (tmp_path / "whole").rglob("*.*")]
    results = [n for n in names if not n.startswith("timings")]
    _, mismatch, errors = filecmp.cmpfiles(tmp_path / "whole", tmp_path / "shared", results, shallow=False)
    assert "report.html" in results and not mismatch and not errors
    with pytest.raises(carpus.InputError, match="expected I/N"):
        study("shared", "3/2")


def test_verif_one_participant_is_no_cohort() -> None:
    with pytest.raises(carpus.InputError, match="at least two participants") as caught:
        carpus.demo().diagnose(["gravity", "coulomb_friction"])
    assert caught.value.diagnostics[0].hint


def test_verif_groups_are_those_of_the_command(tmp_path: Path) -> None:
    json_outputs.visits(tmp_path / "visits")
    values = tmp_path / "visits" / "values.csv"
    words = ["groups", str(tmp_path / "visits"), "--values", str(values), "--out", str(tmp_path / "command")]
    subprocess.run([sys.executable, "-m", "carpus", *words], check=True, capture_output=True)
    study = carpus.Study.open(tmp_path / "visits", command=f"carpus {' '.join(words)}")
    found = study.groups(values=[values])
    found.write(tmp_path / "package")
    for name in ("groups.json", "groups.csv", "groups.html"):
        assert filecmp.cmp(tmp_path / "command" / name, tmp_path / "package" / name, shallow=False), name
    row = found.to_dict()["differences"][0]
    assert row["difference"] == "after − before" and row["persons"] == 4
    with pytest.raises(carpus.InputError, match=r"no identifiability.json of a participant of the study"):
        study.groups([tmp_path])
    pd = pytest.importorskip("pandas")
    table = found.to_pandas()
    assert isinstance(table, pd.DataFrame) and len(table) == 1 and table.interval_95_lower[0] < table.estimate[0]
