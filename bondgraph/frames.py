"""Results as data frames of pandas, which is an optional package."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from bondgraph.errors import DataError

if TYPE_CHECKING:
    import pandas


def frame(columns: Mapping[str, Any], index: Any = None, name: str | None = None) -> pandas.DataFrame:
    """A data frame of columns, with an index (a sequence or an array) called ``name``.

    Raises
    ------
    DataError
        If pandas is not installed.

    Examples
    --------
    >>> frame({"speed [m/s]": [0.0, 1.5]}, [0.0, 0.1], "time [s]").loc[0.1, "speed [m/s]"].item()
    1.5
    """
    library = _pandas()
    return library.DataFrame(dict(columns), index=library.Index(index, name=name) if index is not None else None)


def _pandas() -> Any:
    try:
        return importlib.import_module("pandas")
    except ImportError:
        raise DataError(
            "to_dataframe: pandas is not installed - run: pip install 'bondloop[frames]'", where=("pandas",)
        ) from None
