"""OpenSim's tools by their setup files, and any command of the program."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _carpus
from .errors import Diagnostic, InputError, InternalError

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ToolRun", "command", "run_tool"]


@dataclass(frozen=True)
class ToolRun:
    """What a tool did."""

    files: list[Path]
    """The files that it wrote."""
    summary: list[str] = field(default_factory=list)
    """What it did, in lines."""

    def table(self, name: str) -> pd.DataFrame:
        """A storage file that it wrote, as a data frame with the column ``time`` as index.

        Args:
            name: The end of the file's name.
        """
        found = [f for f in self.files if f.name.endswith(name)]
        if len(found) != 1:
            raise KeyError(f"expected one file that ends with {name}, found {[f.name for f in self.files]}")
        return read_storage(found[0])


def read_storage(path: str | os.PathLike[str]) -> pd.DataFrame:
    """A ``.sto`` or ``.mot`` file as a data frame with the column ``time`` as index."""
    import pandas as pd

    lines = Path(path).read_text().splitlines()
    header = next(i for i, line in enumerate(lines) if line.strip().lower() == "endheader")
    return pd.read_csv(path, sep="\t", skiprows=header + 1, skipinitialspace=True).set_index("time")


def run_tool(
    setup: str | os.PathLike[str],
    *,
    model: str | os.PathLike[str] | None = None,
    allow_unsupported: bool = False,
) -> ToolRun:
    """Runs one of OpenSim's tools by its setup file, as ``carpus run-tool`` does.

    Args:
        setup: The setup file; paths in it are relative to its folder, where results go too.
        model: A model in place of the one that the setup names.
        allow_unsupported: Go on without forces that are not computed.

    Raises:
        InputError: The setup or a file that it names.
    """
    files, summary = _carpus.run_tool(os.fspath(setup), None if model is None else os.fspath(model), allow_unsupported)
    return ToolRun([Path(f) for f in files], summary)


def command(*words: str | os.PathLike[str]) -> Any:
    """Runs any command of the program in a process of its own, with ``--json``, and returns what it prints.

    Example:
        >>> carpus.command("power", "paired-t", "--effect", "0.72", "--n", "10", "--tails", "2")  # doctest: +SKIP

    Raises:
        InputError: The command's input, with the program's messages.
        InternalError: The program failed.
    """
    words_of = [sys.executable, "-m", "carpus", *[os.fspath(w) for w in words], "--json"]
    done = subprocess.run(words_of, capture_output=True, text=True)
    if done.returncode == 1:
        raise InputError([Diagnostic("error", None, None, done.stderr.strip().removeprefix("error: "), None)])
    if done.returncode != 0:
        raise InternalError(done.stderr.strip())
    return json.loads(done.stdout) if done.stdout.strip() else None
