"""What every command prints with ``--json``, and the schemas that the book publishes.

``python json_outputs.py --write [--missing]`` runs every command (or those without a schema) and writes the schemas
anew, as far as the outputs of these examples tell them;
``test_schemas.py`` holds the outputs against the published ones.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SCHEMAS = ROOT / "docs" / "src" / "reference" / "schemas"
DEMO = str(ROOT / "fixtures" / "demo_study")
WRIST = str(ROOT / "models" / "wrist.osim")

COGGING = str(ROOT / "docs" / "src" / "guide" / "cogging.toml")


def raw_study(folder: Path) -> None:
    """A study with raw EMG: bursts of noise."""
    import numpy as np

    rng = np.random.default_rng(1)
    folder.mkdir(parents=True)
    (folder / "wrist.osim").write_bytes(Path(WRIST).read_bytes())
    (folder / "study.toml").write_text(
        '[study]\nname = "raw"\nmodel = "wrist.osim"\n[dynamometer]\ncoordinate = "flexion"\n'
        '[muscles]\nactive = ["ECRL", "FCR"]\n[columns]\nemg = { ECRL = "ch1", FCR = "ch2" }\n[emg]\nkind = "raw"\n'
    )
    (folder / "participants.csv").write_text("participant\nP01\n")
    (folder / "trials.csv").write_text(
        "participant,file,contraction,effort_percent,direction,use\n"
        "P01,mvc_1.csv,mvc,100,flexion,mvc\nP01,mvc_2.csv,mvc,100,extension,mvc\nP01,swing.csv,isotonic,25,flexion,train\n"
    )
    t = np.arange(0, 4, 0.001)
    for name, size in [("mvc_1", 1.0), ("mvc_2", 1.0), ("swing", 0.3)]:
        burst = size * np.clip(np.sin(np.pi * (t - 1) / 2), 0, 1) + 0.01
        rows = np.column_stack([t, 20 * np.sin(3 * t), 2 * np.sin(3 * t), *(burst * rng.standard_normal((2, len(t))))])
        np.savetxt(
            folder / f"{name}.csv",
            rows,
            delimiter=",",
            header="time_s,angle_deg,moment_n_m,ch1,ch2",
            comments="",
            fmt="%.6f",
        )


def recorded_study(folder: Path) -> None:
    """The bundled study with a filter that `carpus dynamometer` applies."""
    import shutil

    shutil.copytree(DEMO, folder)
    text = (folder / "study.toml").read_text().replace("../../models/wrist.osim", "wrist.osim")
    (folder / "study.toml").write_text(text + "\n[processing]\nfilter_hz = 6\nremove_drag = true\n")
    (folder / "wrist.osim").write_bytes(Path(WRIST).read_bytes())


def visits(folder: Path) -> None:
    """Four persons before and after training, of whom a table knows the strength."""
    folder.mkdir(parents=True)
    (folder / "wrist.osim").write_bytes(Path(WRIST).read_bytes())
    text = (Path(DEMO) / "study.toml").read_text().replace("../../models/wrist.osim", "wrist.osim")
    (folder / "study.toml").write_text(text)
    trial = (Path(DEMO) / "data" / "P01" / "mvc_flexion.csv").read_bytes()
    participants, trials, values = (
        "participant,person,visit\n",
        "participant,file,contraction,effort_percent,direction,use\n",
        "",
    )
    for person, strengths in enumerate([(5.1, 5.6), (6.4, 6.9), (4.2, 4.1), (7.3, 8.4)]):
        for visit, strength in zip(("before", "after"), strengths, strict=True):
            name = f"P{person}_{visit}"
            (folder / f"{name}.csv").write_bytes(trial)
            participants += f"{name},P{person},{visit}\n"
            trials += f"{name},{name}.csv,mvc,100,flexion,mvc\n"
            values += f"{name},{strength},\n"
    (folder / "participants.csv").write_text(participants)
    (folder / "trials.csv").write_text(trials)
    (folder / "values.csv").write_text("participant,strength_n_m,unknown\n" + values)


def machine_alone(folder: Path) -> None:
    """Runs of a machine with a drag of 0.2 N·m·s/rad."""
    import numpy as np

    folder.mkdir(parents=True)
    t = np.arange(0, 6, 0.01)
    for i, hz in enumerate([0.2, 0.4, 0.6]):
        angle = 30 * np.sin(2 * np.pi * hz * t)
        speed = np.gradient(np.deg2rad(angle), t)
        rows = np.column_stack([t, angle, -0.2 * speed])
        np.savetxt(
            folder / f"run{i}.csv", rows, delimiter=",", header="time_s,angle_deg,moment_n_m", comments="", fmt="%.6f"
        )


def setup_file(folder: Path) -> None:
    """A setup of OpenSim's Analyze Tool."""
    folder.mkdir(parents=True)
    (folder / "wrist.osim").write_bytes(Path(WRIST).read_bytes())
    rows = "\n".join(f"{0.1 * i:.1f}\t{3 * i}" for i in range(11))
    (folder / "motion.mot").write_text(
        f"motion\nversion=1\nnRows=11\nnColumns=2\ninDegrees=yes\nendheader\ntime\tflexion\n{rows}\n"
    )
    (folder / "setup.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8" ?>\n<OpenSimDocument Version="40600">\n<AnalyzeTool name="swing">\n'
        "<model_file>wrist.osim</model_file>\n<results_directory>results</results_directory>\n"
        "<initial_time>0</initial_time>\n<final_time>1</final_time>\n<coordinates_file>motion.mot</coordinates_file>\n"
        '<AnalysisSet><objects><MuscleAnalysis name="MuscleAnalysis"><compute_moments>false</compute_moments>'
        "</MuscleAnalysis></objects></AnalysisSet>\n</AnalyzeTool>\n</OpenSimDocument>\n"
    )


Words = Callable[[Path], list[str]]


def out(command: str, name: str, *more: str) -> Words:
    return lambda f: [*command.split(), DEMO, *more, "--out", str(f / name)]


COMMANDS: dict[str, tuple[Callable[[Path], None] | None, Words]] = {
    "compare": (None, out("compare", "compared")),
    "personalize": (None, out("personalize", "personalized")),
    "simulate": (None, out("simulate", "simulated")),
    "identify": (None, out("identify", "identified", "--draws", "200")),
    "priors": (None, lambda f: ["priors", str(f / "identified"), "--out", str(f / "priors.csv")]),
    "diagnose": (None, out("diagnose", "diagnosed")),
    "diagnose --task": (
        None,
        out("diagnose", "shared_diagnosis", "--candidates", "joint_damping", "--task", "1/1"),
    ),
    "effect add": (None, out("effect add", "diagnosed", "joint_damping", "--i-choose")),
    "effect remove": (None, lambda f: ["effect", "remove", str(f / "diagnosed" / "P01"), "--to", "1"]),
    "effect auto": (None, out("effect auto", "diagnosed")),
    "plan": (None, out("plan", "diagnosed", "--candidates", "joint_damping,gravity")),
    "plan --effect": (None, out("plan", "separable", "--effect", "coulomb_friction")),
    "synth": (None, out("synth", "synthetic", "--effect", "gravity")),
    "study": (None, out("study", "studied", "--steps", "evaluate,ultrasound")),
    "study --task": (None, out("study", "shared", "--steps", "evaluate,ultrasound", "--task", "1/1")),
    "units": (None, lambda f: ["units", str(f / "shared")]),
    "merge": (None, lambda f: ["merge", str(f / "shared")]),
    "evaluate": (
        None,
        lambda f: ["evaluate", DEMO, "--models", str(f / "personalized"), "--out", str(f / "evaluated")],
    ),
    "sensitivity": (None, out("sensitivity", "screened", "--starts", "4", "--sobol", "8")),
    "strength-scale": (None, out("strength-scale", "strong")),
    "demo": (None, lambda f: ["demo", "--out", str(f / "demo")]),
    "info": (None, lambda f: ["info", WRIST]),
    "paths": (None, lambda f: ["paths", WRIST, "--sweep", "flexion=-60:60:20deg"]),
    "init": (None, lambda f: ["init", DEMO, "--model", WRIST, "--out", str(f / "initiated"), "--yes"]),
    "check": (None, lambda f: ["check", DEMO]),
    "audit": (None, lambda f: ["audit", WRIST]),
    "view": (None, lambda f: ["view", WRIST, "-o", str(f / "view.html")]),
    "equilibrium": (None, lambda f: ["equilibrium", WRIST, "--set", "flexion=10deg"]),
    "effects": (None, lambda f: ["effects"]),
    "effects check": (None, lambda f: ["effects", "check", COGGING, "--study", DEMO]),
    "scale": (None, lambda f: ["scale", WRIST, "--factor", "hand=1.05", "--out", str(f / "scaled")]),
    "upgrade": (
        None,
        lambda f: ["upgrade", str(next((ROOT / "fixtures" / "upgrade").rglob("*.osim"))), str(f / "new.osim")],
    ),
    "run-tool": (lambda f: setup_file(f / "tool"), lambda f: ["run-tool", str(f / "tool" / "setup.xml")]),
    "dynamometer": (
        lambda f: recorded_study(f / "recorded"),
        lambda f: ["dynamometer", str(f / "recorded"), "--out", str(f / "processed")],
    ),
    "dynamometer-drag": (
        lambda f: machine_alone(f / "machine"),
        lambda f: ["dynamometer-drag", *map(str, sorted((f / "machine").glob("*.csv")))],
    ),
    "emg": (lambda f: raw_study(f / "raw"), lambda f: ["emg", str(f / "raw"), "--out", str(f / "emg")]),
    "c3d": (
        None,
        lambda f: ["c3d", str(ROOT / "fixtures" / "motion_capture" / "float.c3d"), "--out", str(f / "c3d" / "float")],
    ),
    "ultrasound": (None, lambda f: ["ultrasound", str(ROOT / "fixtures" / "imaging"), "--out", str(f / "imaging")]),
    "groups": (
        lambda f: visits(f / "visits"),
        lambda f: [
            "groups",
            str(f / "visits"),
            "--values",
            str(f / "visits" / "values.csv"),
            "--out",
            str(f / "compared_visits"),
        ],
    ),
    "power": (None, lambda f: ["power", "paired-t", "--effect", "0.72", "--n", "10", "--tails", "2"]),
    "power --published": (None, lambda f: ["power", "--published"]),
}
"""By command: what has to be there first, and its words. In this order: some read what others wrote."""


def file_of(command: str) -> Path:
    """The published schema of a command's output."""
    return SCHEMAS / f"{command.replace(' --', '_').replace(' ', '_').replace('-', '_')}.schema.json"


def output(command: str, folder: Path) -> Any:
    """What a command prints with ``--json``."""
    before, words = COMMANDS[command]
    if before is not None:
        before(folder)
    done = subprocess.run(
        [sys.executable, "-m", "carpus", *words(folder), "--json", "--quiet"],
        capture_output=True,
        text=True,
        cwd=folder,
    )
    assert done.returncode == 0, f"carpus {' '.join(words(folder))}\n{done.stderr}"
    return json.loads(done.stdout)


# Objects whose keys are names: of muscles, parameters, classes, steps of processing.
BY_NAME = (
    "parameters",
    "units",
    "muscles",
    "understood",
    "processing",
    "detectable_size",
    "plausible",
    "size",
    "effects_z",
    "values",
)


def by_name(schema: Any) -> Any:
    """A schema in which objects of `BY_NAME` take any name as key."""
    if isinstance(schema, list):
        return [by_name(s) for s in schema]
    if not isinstance(schema, dict):
        return schema
    made = {k: by_name(v) for k, v in schema.items()}
    for key, of in made.get("properties", {}).items():
        if key in BY_NAME and isinstance(of, dict) and of.get("properties"):
            kinds = list({json.dumps(v, sort_keys=True): v for v in of["properties"].values()}.values())
            made["properties"][key] = {
                "type": of["type"],
                "additionalProperties": kinds[0] if len(kinds) == 1 else {"anyOf": kinds},
            }
    return made


def schema_of(values: list[Any]) -> dict[str, Any]:
    """A schema that these values satisfy."""
    kinds: dict[str, list[Any]] = {}
    for v in values:
        kind = {
            bool: "boolean",
            int: "number",
            float: "number",
            str: "string",
            type(None): "null",
            list: "array",
            dict: "object",
        }[type(v)]
        kinds.setdefault(kind, []).append(v)
    schema: dict[str, Any] = {"type": sorted(kinds) if len(kinds) > 1 else next(iter(kinds), None)}
    if schema["type"] is None:
        return {}
    if "array" in kinds:
        items = [x for v in kinds["array"] for x in v]
        schema["items"] = schema_of(items) if items else {}
    if "object" in kinds:
        keys = sorted({k for v in kinds["object"] for k in v})
        required = [k for k in keys if all(k in v for v in kinds["object"])]
        if len(kinds["object"]) > 1 and len(keys) > 1 and not required:
            schema["additionalProperties"] = schema_of([x for v in kinds["object"] for x in v.values()])
        else:
            schema["properties"] = {k: schema_of([v[k] for v in kinds["object"] if k in v]) for k in keys}
            schema["required"] = required
            schema["additionalProperties"] = False
            if "schema" in schema["properties"]:
                schema["properties"]["schema"] = {"enum": sorted({v["schema"] for v in kinds["object"]})}
    return schema


def main() -> None:
    import tempfile

    folder = Path(tempfile.mkdtemp())
    SCHEMAS.mkdir(parents=True, exist_ok=True)
    for command in [c for c in COMMANDS if "--missing" not in sys.argv or not file_of(c).exists()]:
        schema = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": f"carpus {command} --json",
            **by_name(schema_of([output(command, folder)])),
        }
        SCHEMAS.mkdir(parents=True, exist_ok=True)
        file_of(command).write_text(json.dumps(schema, indent=1, ensure_ascii=False) + "\n")
        print(command)


if __name__ == "__main__" and "--write" in sys.argv:
    main()
