"""Results as data frames of pandas and data sets of xarray, which are optional packages."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from bondgraph.errors import DataError

if TYPE_CHECKING:
    import pandas
    import xarray


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
    library = _library("pandas", "to_dataframe")
    return library.DataFrame(dict(columns), index=library.Index(index, name=name) if index is not None else None)


def dataset(columns: Mapping[str, Any], time: Any) -> xarray.Dataset:
    """A data set over ``time`` in s, with a variable for each column ``name [unit]``.

    Raises
    ------
    DataError
        If xarray is not installed.

    Examples
    --------
    >>> run = dataset({"speed [m/s]": [0.0, 1.5]}, [0.0, 0.1])
    >>> run["speed"].attrs["units"], run["speed"].sel(time=0.1).item()
    ('m/s', 1.5)
    """
    library = _library("xarray", "to_xarray")
    split = ((*label.removesuffix("]").partition(" ["), values) for label, values in columns.items())
    variables = {name: ("time", values, {"units": unit}) for name, _, unit, values in split}
    found: xarray.Dataset = library.Dataset(variables, coords={"time": ("time", time, {"units": "s"})})
    return found


def _library(name: str, user: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise DataError(
            f"{user}: {name} is not installed - run: pip install 'bondloop[frames]'", where=(name,)
        ) from None
