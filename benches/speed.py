#!/usr/bin/env python3
"""OpenSim and Carpus on the same five seconds of prescribed wrist flexion, timed in one run on one machine.

    python benches/speed.py [--model MODEL.osim] [--posture elbow_flexion=90 …] [--repeat 3] [--json FILE] [--opensim-only]

The model defaults to the lab model in CARPUS_SHARED (or ../shared) and, without it, to models/wrist.osim. Wrist flexion is
0.6 sin(pi t) rad, five muscles with bursts of excitation, everything else locked (fixtures/scripts/prescribed_motion.py).

OpenSim: processor seconds of one uninterrupted integration per accuracy (1e-3, 1e-5, 1e-7), fresh Model each time, best of --repeat for the two
coarse ones; building the model is timed apart. The tendon forces at 1e-7 every 10 ms are the reference.

Carpus is asked through one command:

    cargo bench --bench speed -- --json --model MODEL --motion TABLE.csv --posture NAME=DEGREES …

TABLE.csv has columns time [s], flexion [rad], and per muscle M: M_excitation (linear between rows; the other columns are
OpenSim's answers and are not to be read). It prints, as its last line, one JSON object, seconds on one core (best of several runs, so that a busy machine does not count):
  load_s             reading and compiling the model
  first_trial_s      path lengths and arms of the trial and one simulation of it, from the compiled model
  further_set_s      one more parameter set on the same trial (mean over many, optimal fibre length within 1 % of the model's)
  distant_set_s      (optional) the same within 10 %
  derivatives_s      (optional) one simulation with its derivatives by the fitted parameters
  integration_steps  (optional) number of steps
  tendon_force       muscle → list [N], at the rows of TABLE.csv
The script prints the ratios and the largest |force difference| / maximum isometric force.
"""
import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time as clock
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "fixtures" / "scripts"))

from opensim_simulation import Run, millard, opensim_version, simulate  # noqa: E402
from prescribed_motion import ACCURACY, MUSCLES, parse_posture, wrist_motion, write_table  # noqa: E402

SECONDS = 5.0
STEP = 0.01
ACCURACIES = (1e-3, 1e-5, 1e-7)
TARGET_RATIO = 1000.0
TARGET_RATIO_FURTHER = 5000.0
TARGET_FORCE_ERROR = 1e-4
TARGET_LOAD_S = 0.05


def default_model():
    folders = [os.environ.get("CARPUS_SHARED"), ROOT / "../shared", ROOT / "../../shared"]
    for folder in filter(None, folders):
        path = Path(folder) / "models" / "Hand_Wrist_Model_for_development.osim"
        if path.exists():
            return path.resolve(), []
    return ROOT / "models" / "wrist.osim", ["elbow_flexion=90", "pro_sup=0"]


def time_opensim(model, times, posture, repeat):
    """Seconds by accuracy, and seconds to build the model."""
    seconds, build = {}, []
    for accuracy in ACCURACIES:
        best = np.inf
        for _ in range(1 if accuracy <= 1e-7 else repeat):
            started = clock.process_time()
            run = Run(model, MUSCLES, wrist_motion(times, posture))
            run.start()
            build.append(clock.process_time() - started)
            best = min(best, run.integrate(times[-1], accuracy))
        seconds[accuracy] = best
    return seconds, min(build)


def reference(model, times, posture, table):
    rows, _, run = simulate(model, MUSCLES, wrist_motion(times, posture), times, ACCURACY)
    write_table(table, times, rows)
    forces = {m: np.array([row[m]["tendon_force"] for row in rows]) for m in MUSCLES}
    limits = {m: millard(run.model, m).get_max_isometric_force() for m in MUSCLES}
    return forces, limits


def ask_carpus(model, table, posture_items):
    # Many short runs, of which the fastest counts: other work on the machine does not last through all of them.
    command = ["cargo", "bench", "--quiet", "--bench", "speed", "--", "--json", "--repeat", "201"]
    command += ["--model", str(model), "--motion", str(table)]
    for item in posture_items:
        command += ["--posture", item]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}\nfailed with {done.returncode}:\n{done.stderr}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def force_error(ours, theirs, limits):
    """Largest |difference| / maximum isometric force over all muscles and samples, and the muscle it occurs in."""
    worst = {}
    for muscle in MUSCLES:
        mine = np.asarray(ours[muscle])
        if mine.shape != theirs[muscle].shape or not np.all(np.isfinite(mine)):
            sys.exit(f"carpus returned {mine.shape} finite forces for {muscle}, expected {theirs[muscle].shape}")
        worst[muscle] = float(np.max(np.abs(mine - theirs[muscle])) / limits[muscle])
    muscle = max(worst, key=worst.get)
    return worst[muscle], muscle


def verdict(value, target, larger_is_better):
    met = value >= target if larger_is_better else value <= target
    return "met" if met else "MISSED"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--posture", nargs="*", metavar="COORDINATE=DEGREES")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--json", type=Path, help="write the numbers here, too")
    parser.add_argument("--opensim-only", action="store_true")
    arguments = parser.parse_args()
    model, posture_items = default_model()
    if arguments.model:
        model, posture_items = arguments.model.resolve(), []
    if arguments.posture is not None:
        posture_items = arguments.posture
    posture = parse_posture(posture_items)
    times = np.round(np.arange(0.0, SECONDS + STEP / 2, STEP), 9)

    seconds, build = time_opensim(model, times, posture, arguments.repeat)
    result = {
        "model": model.name, "opensim": opensim_version(), "machine": platform.machine(), "logical_cpus": os.cpu_count(),
        "load_average_1min": os.getloadavg()[0], "opensim_build_s": build, "opensim_s": {f"{a:g}": s for a, s in seconds.items()},
    }
    print(f"{model.name}: 5 s of wrist flexion, {len(MUSCLES)} muscles; OpenSim {opensim_version()}")
    print(f"  OpenSim  build {build:.2f} s; " + ", ".join(f"accuracy {a:g}: {s:.2f} s" for a, s in seconds.items()))
    if not arguments.opensim_only:
        with tempfile.TemporaryDirectory() as folder:
            table = Path(folder) / "motion.csv"
            forces, limits = reference(model, times, posture, table)
            ours = ask_carpus(model, table, posture_items)
        error, muscle = force_error(ours.pop("tendon_force"), forces, limits)
        ratio, ratio_further = seconds[1e-5] / ours["first_trial_s"], seconds[1e-5] / ours["further_set_s"]
        result |= {"carpus": ours, "ratio_first_trial": ratio, "ratio_further_set": ratio_further, "force_error_per_fmax": error}
        print(f"  Carpus   load {1e3 * ours['load_s']:.1f} ms ({verdict(ours['load_s'], TARGET_LOAD_S, False)}: under 50 ms)")
        print(f"           trial with paths {1e3 * ours['first_trial_s']:.3f} ms: {ratio:.0f} times faster than OpenSim at 1e-5"
              f" ({verdict(ratio, TARGET_RATIO, True)}: {TARGET_RATIO:.0f})")
        print(f"           further parameter set {1e3 * ours['further_set_s']:.3f} ms: {ratio_further:.0f} times"
              f" ({verdict(ratio_further, TARGET_RATIO_FURTHER, True)}: {TARGET_RATIO_FURTHER:.0f})")
        if "distant_set_s" in ours:
            print(f"           one up to 10 % away {1e3 * ours['distant_set_s']:.3f} ms: {seconds[1e-5] / ours['distant_set_s']:.0f} times")
        print(f"           largest force difference to OpenSim at 1e-7: {error:.1e} Fmax, in {muscle}"
              f" ({verdict(error, TARGET_FORCE_ERROR, False)}: {TARGET_FORCE_ERROR:g})")
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
