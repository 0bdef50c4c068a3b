"""What results that are arrays have in common."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

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

    def _repr_html_(self) -> str:
        return self.to_pandas()._repr_html_()


def over_time(time: Any, columns: dict[str, Any]) -> pd.DataFrame:
    """A data frame with the time [s] as index."""
    import pandas as pd

    return pd.DataFrame(columns, index=pd.Index(time, name="time_s"))
