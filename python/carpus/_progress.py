"""Progress of long work: a bar of tqdm where it is installed, in a terminal and in notebooks."""

from __future__ import annotations

import sys
from typing import Any

_shown: bool | None = None


def show_progress(shown: bool | None) -> None:
    """Says whether long work shows a bar.

    Args:
        shown: ``None``, as at the beginning: in a terminal and in notebooks, where tqdm is installed.
    """
    global _shown
    _shown = shown


def _is_watched() -> bool:
    if _shown is not None:
        return _shown
    return "ipykernel" in sys.modules or sys.stderr.isatty()


class _Silent:
    def at(self, what: str, done: int, steps: int) -> None:
        pass

    def close(self) -> None:
        pass


class _Bar:
    def __init__(self, tqdm: Any) -> None:
        self._tqdm = tqdm
        self._bar: Any = None
        self._steps = 0

    def at(self, what: str, done: int, steps: int) -> None:
        if self._bar is None or self._steps != steps:
            self.close()
            self._bar = self._tqdm(total=steps or None, leave=False)
            self._steps = steps
        self._bar.set_description(what, refresh=False)
        self._bar.n = done
        self._bar.refresh()

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def bar() -> _Silent | _Bar:
    """What shows the next piece of work."""
    if not _is_watched():
        return _Silent()
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return _Silent()
    return _Bar(tqdm)
