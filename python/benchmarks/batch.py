"""How many simulations of trials a second ``Session.simulate(parameters)`` does, beside the same loop in Rust.

``cargo build --release --example batch_throughput``, then ``python python/benchmarks/batch.py [THE PROGRAM]`` in the
repository's folder: the two take turns, as other work on the machine slows either.
"""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np

import carpus

SETS, CALLS, TURNS = 400, 5, 3


def of_python(session: carpus.Session) -> float:
    """Simulations a second, of the fastest call."""
    sets = np.repeat(session.parameters[None], SETS, axis=0)
    sets[:, :, 1] *= (0.97 + 0.06 * np.arange(SETS) / SETS)[:, None]
    best = np.inf
    for _ in range(CALLS):
        begun = time.perf_counter()
        session.simulate(sets)
        best = min(best, time.perf_counter() - begun)
    return SETS * len(session.trial_names) / best


def main() -> None:
    session = carpus.demo().load()
    program = sys.argv[1] if len(sys.argv) > 1 else "target/release/examples/batch_throughput"
    python, rust = 0.0, 0.0
    for _ in range(TURNS):
        python = max(python, of_python(session))
        done = subprocess.run([program], capture_output=True, text=True, check=True)
        rust = max(rust, float(done.stdout.split()[0]))
    print(f"Python {python:.0f}, Rust {rust:.0f} simulations/s: {100 * python / rust:.0f} %")


if __name__ == "__main__":
    main()
