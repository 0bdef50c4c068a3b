"""What goes wrong, with place, expectation and hint."""

from __future__ import annotations

import operator
import os
import warnings
from dataclasses import dataclass
from typing import Any

__all__ = ["CarpusError", "CarpusWarning", "Diagnostic", "InputError", "InternalError"]


@dataclass(frozen=True)
class Diagnostic:
    """One finding: where, what, and what to do about it."""

    severity: str
    """``error`` or ``warning``."""
    file: str | None
    """The file that it is about."""
    line: int | None
    """The line in the file, counted from 1."""
    text: str
    """What is wrong: what was expected, what was found."""
    hint: str | None
    """What to do."""

    def __post_init__(self) -> None:
        if self.file is not None:
            object.__setattr__(self, "file", os.fspath(self.file))

    @property
    def place(self) -> str | None:
        """``file:line``, as far as it is known."""
        if self.file is None:
            return None
        return self.file if self.line is None else f"{self.file}:{self.line}"

    def __str__(self) -> str:
        place = "" if self.place is None else f"{self.place}: "
        hint = "" if self.hint is None else f"\n  hint: {self.hint}"
        return f"{place}{self.text}{hint}"


class CarpusError(Exception):
    """Work could not be done."""


class InputError(CarpusError, ValueError):
    """The input is at fault: a file, an argument, an array.

    Attributes:
        diagnostics: All findings, warnings among them, each with place, text and hint.
    """

    def __init__(self, diagnostics: list[Diagnostic]) -> None:
        super().__init__("\n".join(f"{d.severity}: {d}" for d in diagnostics))
        self.diagnostics = diagnostics


class InternalError(CarpusError, RuntimeError):
    """Carpus is at fault. Please report it."""


class CarpusWarning(UserWarning):
    """Something that a person should know before trusting results."""


def whole(name: str, value: Any, least: int = 0) -> int:
    """A whole number that a caller gave.

    Raises:
        InputError: Another value, one below ``least``, or one of more than 64 bits.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = None
    if number is None or not least <= number < 2**64:
        text = f"{name}: expected a whole number from {least} on, found {value!r}"
        raise InputError([Diagnostic("error", None, None, text, None)])
    return number


def of_shape(name: str, expected: str, found: Any) -> InputError:
    """What is raised for an array of another shape."""
    text = f"{name}: expected shape {expected}, found {found.shape}"
    return InputError([Diagnostic("error", None, None, text, None)])


def warn(diagnostic: Diagnostic) -> None:
    """Warns the caller of the function that called into Carpus."""
    warnings.warn(str(diagnostic), CarpusWarning, stacklevel=3)
