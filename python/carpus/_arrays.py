"""What results that are arrays have in common."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import Diagnostic, InputError

if TYPE_CHECKING:
    import pandas as pd


class Arrays:
    """A data class of arrays."""

    def to_dict(self) -> dict[str, Any]:
        """Its fields by name; the arrays are not copied."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}  # type: ignore[arg-type]

    def to_pandas(self) -> pd.DataFrame:
        """As a data frame; its ``to_csv`` and ``to_parquet`` write it."""
        raise NotImplementedError

    def write(self, folder: str | os.PathLike[str], *, name: str | None = None) -> Path:
        """Writes its data frame as a CSV file, with every digit; columns with two names as ``length/ECRL``.

        Args:
            folder: The folder; it is made where it is missing.
            name: Of the file; without one that of the class: ``recorded.csv``, ``batch.csv``.

        Returns:
            The file.

        Raises:
            InputError: There is such a file.
        """
        path = Path(folder) / (name or f"{type(self).__name__.lower()}.csv")
        path.parent.mkdir(parents=True, exist_ok=True)
        frame = self.to_pandas()
        if frame.columns.nlevels > 1:
            frame.columns = ["/".join(names) for names in frame.columns]
        try:
            with path.open("x", encoding="utf-8", newline="") as file:
                frame.to_csv(file)
        except FileExistsError:
            text, hint = "there is such a file", "name= gives another one"
            raise InputError([Diagnostic("error", str(path), None, text, hint)]) from None
        return path

    def _repr_html_(self) -> str:
        return self.to_pandas()._repr_html_()


def over_time(time: Any, columns: dict[str, Any]) -> pd.DataFrame:
    """A data frame with the time [s] as index."""
    import pandas as pd

    return pd.DataFrame(columns, index=pd.Index(time, name="time_s"))
