"""A study in tasks, by Dask.

``python dask_study.py study/study.toml done 8 [--scheduler tcp://node:8786] [--steps STEP,…] [--starts R]``

Without a scheduler, processes of this machine do the tasks. The folder of the results lies where all workers see it.
"""

from __future__ import annotations

import argparse
from typing import Any

import carpus
from dask.distributed import Client


def task(study: str, out: str, which: str, options: dict[str, Any]) -> int:
    """Does the units of some participants; returns how many were computed."""
    return carpus.Study.open(study).study(out, task=which, **options).units_computed


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("study")
    parser.add_argument("out")
    parser.add_argument("tasks", type=int)
    parser.add_argument("--scheduler")
    parser.add_argument("--steps", default="")
    parser.add_argument("--starts", type=int)
    asked = parser.parse_args()
    options = {"steps": [step for step in asked.steps.split(",") if step], "starts": asked.starts}
    with Client(asked.scheduler) if asked.scheduler else Client(threads_per_worker=1) as client:
        # A task whose worker was lost is done again by another, and goes on where it was.
        parts = [
            client.submit(task, asked.study, asked.out, f"{i}/{asked.tasks}", options, pure=False, retries=2)
            for i in range(1, asked.tasks + 1)
        ]
        print("units computed by the tasks:", *client.gather(parts))
    report = carpus.Study.open(asked.study).study(asked.out, **options)
    print(f"{report.units_found_finished} units were finished before, {report.units_computed} were computed")
    print(report.report)


if __name__ == "__main__":
    main()
