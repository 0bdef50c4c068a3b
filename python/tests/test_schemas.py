"""Every command's JSON is what its published schema says."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from json_outputs import COMMANDS, SCHEMAS, file_of, output

jsonschema = pytest.importorskip("jsonschema")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("json")


@pytest.mark.parametrize("command", COMMANDS)
def test_verif_output_is_as_published(command: str, folder: Path) -> None:
    schema = json.loads(file_of(command).read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(output(command, folder), schema)


def test_verif_every_command_has_a_schema() -> None:
    """All but those that print a text for a shell or a reader of manuals."""
    told = subprocess.run([sys.executable, "-m", "carpus", "--help"], capture_output=True, text=True, check=True).stdout
    commands = set(re.findall(r"^  ([a-z0-9-]+) {2,}\S", told, re.MULTILINE)) - {"help", "completions", "man"}
    assert commands == {c.split()[0] for c in COMMANDS}
    assert {p.name for p in SCHEMAS.glob("*.json")} == {file_of(c).name for c in COMMANDS}
