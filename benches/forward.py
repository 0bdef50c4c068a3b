#!/usr/bin/env python3
"""OpenSim and Carpus on the same fall under gravity of a whole model, timed in one run on one machine.

    python benches/forward.py [--model MODEL.osim] [--seconds 0.2] [--rest 0.02] [--accuracy 1e-3] [--referee 1e-7] [--json FILE]

The model defaults to the McFarland hand in CARPUS_SHARED (or ../shared): 43 muscles, 23 free degrees of freedom. From the
default pose, muscles in equilibrium at --rest, it moves for --seconds (fixtures/scripts/forward.py). OpenSim's Manager runs
at --accuracy, and at --referee; the latter is what both are compared with. Carpus runs at several accuracies
(cargo bench --bench forward). Processor seconds of one thread: OpenSim's of one integration without building the model,
Carpus's least of five. The script prints the ratios and the largest difference of a coordinate from the referee.
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "fixtures" / "scripts"))

from forward import HAND, simulate  # noqa: E402

ROWS = 21
ACCURACIES = ("1e-5", "1e-6", "7e-7", "5e-7", "1e-7")
TARGET_RATIO = 350.0
TARGET_DIFFERENCE = 1e-4


def largest_difference(found, referee):
    pairs = zip(found["rows"], referee["rows"])
    return max(abs(a["q"][name] - b["q"][name]) for a, b in pairs for name in a["q"])


def ask_carpus(model, reference):
    command = ["cargo", "bench", "--quiet", "--bench", "forward", "--", "--json", "--repeat", "5", "--model", str(model), "--reference", str(reference)]
    for accuracy in ACCURACIES:
        command += ["--accuracy", accuracy]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}\nfailed with {done.returncode}:\n{done.stderr}")
    return json.loads(done.stdout.strip().splitlines()[-1])["runs"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--seconds", type=float, default=0.2)
    parser.add_argument("--rest", type=float, default=0.02)
    parser.add_argument("--accuracy", type=float, default=1e-3)
    parser.add_argument("--referee", type=float, default=1e-7)
    parser.add_argument("--json", type=Path, help="write the numbers here, too")
    arguments = parser.parse_args()
    model = arguments.model or Path(os.environ.get("CARPUS_SHARED", ROOT.parent / "shared")) / HAND
    if not model.exists():
        sys.exit(f"{model} is not here: give --model or set CARPUS_SHARED")
    model = model.resolve()
    theirs = simulate(model, arguments.seconds, ROWS, arguments.accuracy, {}, arguments.rest)
    referee = simulate(model, arguments.seconds, ROWS, arguments.referee, {}, arguments.rest)
    with tempfile.TemporaryDirectory() as folder:
        reference = Path(folder) / "reference.json"
        reference.write_text(json.dumps(referee))
        ours = ask_carpus(model, reference)
    error = largest_difference(theirs, referee)
    print(f"{model.name}: {arguments.seconds} s, muscles at {arguments.rest}; differences from OpenSim at {arguments.referee:g}")
    for run in (theirs, referee):
        print(f"  OpenSim at {run['accuracy']:g}: {run['cpu_seconds']:.1f} s, difference {largest_difference(run, referee):.1e}")
    for run in ours:
        ratio = theirs["cpu_seconds"] / run["cpu_s"]
        verdict = "met" if ratio >= TARGET_RATIO and run["difference"] <= TARGET_DIFFERENCE else "MISSED"
        print(
            f"  Carpus at {run['accuracy']:g}: {run['cpu_s']:.3f} s ({run['cpu_s'] / arguments.seconds:.2f} of simulated time),"
            f" difference {run['difference']:.1e}, {ratio:.0f} times faster ({verdict}: {TARGET_RATIO:.0f} within {TARGET_DIFFERENCE:g})"
        )
    if arguments.json:
        seconds = {f"{run['accuracy']:g}": run["cpu_seconds"] for run in (theirs, referee)}
        result = {"model": model.name, "opensim_s": seconds, "opensim_difference": error, "carpus": ours}
        arguments.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
