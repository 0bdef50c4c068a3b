"""Writes the book's reference of the Python package from its docstrings: ``python make_reference.py [--check]``."""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
from pathlib import Path
from typing import Any

import carpus

PAGE = Path(__file__).resolve().parents[2] / "docs" / "src" / "python" / "reference.md"

GROUPS: dict[str, list[Any]] = {
    "Studies": [carpus.demo, carpus.Study, carpus.Trial, carpus.Participant],
    "Participants": [carpus.Session, carpus.Recorded, carpus.Batch],
    "Results": [
        carpus.Result,
        carpus.Simulation,
        carpus.SimulatedTrial,
        carpus.Comparison,
        carpus.Personalization,
        carpus.Identification,
        carpus.Diagnosis,
        carpus.CohortDiagnosis,
        carpus.ModelWithEffects,
        carpus.Plan,
        carpus.Evaluation,
        carpus.Groups,
        carpus.Sensitivity,
        carpus.StudyReport,
    ],
    "Models": [
        carpus.Model,
        carpus.Components,
        carpus.Component,
        carpus.Body,
        carpus.Coordinate,
        carpus.Muscle,
        carpus.Paths,
        carpus.ForwardMotion,
    ],
    "Effects": [carpus.effects, carpus.define_effect, carpus.forget_effect, carpus.Amplitude, carpus.Shape],
    "Tools and commands": [carpus.run_tool, carpus.ToolRun, carpus.read_storage, carpus.command],
    "Errors and progress": [
        carpus.InputError,
        carpus.InternalError,
        carpus.CarpusWarning,
        carpus.Diagnostic,
        carpus.show_progress,
    ],
}
SECTIONS = ("Args", "Returns", "Raises", "Attributes", "Example")


def prose(doc: str) -> str:
    """A docstring as Markdown."""
    text = inspect.cleandoc(doc).replace("``", "`")
    out: list[str] = []
    section, in_table = "", False
    for line in text.splitlines():
        if line.rstrip(":") in SECTIONS and line.endswith(":"):
            section = line.rstrip(":")
            title = {"Args": "Arguments", "Raises": "Errors"}.get(section, section)
            out += ["", f"*{title}:*", ""]
            if section == "Example":
                out.append("```python")
            continue
        if section == "Example" and line and not line.startswith(" "):
            out += ["```", ""]
            section = ""
        stripped = line.strip()
        if set(stripped) <= {"=", " "} and stripped:
            if not in_table:
                out += ["", "  | argument | shape | |", "  |---|---|---|"]
            in_table = not in_table or out[-1].startswith("  |---")
            continue
        if in_table and stripped.startswith("`"):
            out.append("  | " + " | ".join(re.split(r"\s{2,}", stripped)) + " |")
            continue
        in_table = in_table and bool(stripped)
        if section == "Example":
            out.append(re.sub(r"^(>>> |\.\.\. ?)", "", stripped).replace("  # doctest: +SKIP", ""))
        elif section and line.startswith("    ") and not line.startswith("     "):
            if section in ("Returns",):
                out.append(stripped)
            else:
                name, _, rest = stripped.partition(": ")
                out.append(f"- `{name}`: {rest}" if rest else stripped)
        elif section and stripped:
            out.append(("  " if section != "Returns" else "") + stripped)
        else:
            out.append(stripped)
    if section == "Example":
        out += ["```"]
    return "\n".join(out).strip()


def signature(name: str, of: Any) -> str:
    """A signature on one line."""
    text = re.sub(r"(: |-> )'([^']*)'", r"\1\2", str(inspect.signature(of)))
    text = re.sub(r"\(self(, )?", "(", text)
    text = re.sub(r"(typing|collections\.abc|os|carpus\.\w+)\.", "", text)
    return f"{name}{text}"


def members(cls: type) -> list[str]:
    """Public methods and properties of a class itself, and the fields of a data class."""
    lines: list[str] = []
    if dataclasses.is_dataclass(cls):
        source = inspect.getsource(cls)
        for field in dataclasses.fields(cls):
            said = re.search(rf"^    {field.name}: .*\n    \"\"\"(.*?)\"\"\"", source, re.MULTILINE | re.DOTALL)
            if said:
                lines.append(f"- `{field.name}`: {' '.join(said.group(1).split())}")
        if lines:
            lines.append("")
    for name, member in vars(cls).items():
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            lines += [f"#### `{cls.__name__}.{name}`", "", prose(member.__doc__ or ""), ""]
        elif isinstance(member, (classmethod, staticmethod)) or inspect.isfunction(member):
            of = getattr(cls, name)
            doc = inspect.getdoc(of)
            lines += [
                f"#### `{cls.__name__}.{name}`",
                "",
                f"```python\n{signature(name, of)}\n```",
                "",
                prose(doc or ""),
                "",
            ]
    return lines


def page() -> str:
    """The page."""
    lines = [
        "# Reference of the Python package",
        "",
        "From the docstrings (`python/scripts/make_reference.py`). Angles are radians, everything else SI units,",
        "unless a name says otherwise.",
        "",
    ]
    for title, things in GROUPS.items():
        lines += [f"## {title}", ""]
        for thing in things:
            name = thing.__name__
            lines += [f"### `{name}`", ""]
            if not inspect.isclass(thing):
                lines += [f"```python\n{signature(name, thing)}\n```", ""]
            lines += [prose(thing.__doc__ or ""), ""]
            if inspect.isclass(thing):
                lines += members(thing)
    text = "\n".join(lines)
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def main() -> int:
    missing = set(carpus.__all__) - {t.__name__ for things in GROUPS.values() for t in things}
    missing -= {"PARAMETERS", "CarpusError"}
    if missing:
        print(f"not in the reference: {', '.join(sorted(missing))}")
        return 1
    if "--check" in sys.argv:
        if PAGE.read_text() != page():
            print(f"{PAGE} is not what docstrings say; renew it with: python python/scripts/make_reference.py")
            return 1
        return 0
    PAGE.write_text(page())
    return 0


if __name__ == "__main__":
    sys.exit(main())
