"""The table of what a filter knows of states: means and deviations, in full or to the digits that mean something."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.formats.table import extra
from bondgraph.data.log import Log, LogChannel
from bondgraph.data.write import write_log
from bondgraph.filter.abstract_run import AbstractRun
from bondgraph.simulate.quantities import ParameterInfo, StateInfo

#: Part of its deviation below which a state's digits are left out: an uncertainty means two digits (JCGM 100:2008,
#: section 7.2.6), and one more keeps differences of rows from rounding.
_PART = 1e-3
#: Largest power of ten that a double holds exactly: beyond it a quotient is not the double next to a short decimal.
_EXACT_POWER = 22
#: Bytes beyond which it is said how a table becomes smaller: from this size on GitHub warns of a file.
_LARGE = 50 * 2**20


@dataclass(frozen=True)
class StatesTable:
    """A choice of how states are written.

    Parameters
    ----------
    form
        Kind of file: ``csv``, ``csv.gz`` or ``parquet``.
    rounded
        Whether digits below a thousandth of a state's own deviation are left out.

    Raises
    ------
    DataError
        By :meth:`check`, if the package that writes such a file is not installed.
    """

    form: str = "csv"
    rounded: bool = False

    def check(self) -> None:
        """Refuse a kind of file whose package is not installed, before any work is done for it."""
        if self.form == "parquet":
            extra("pyarrow.parquet", Path(f"--states {self.form}"), "parquet")

    def write(self, folder: Path, record: AbstractRun) -> Path:
        """Write ``NAME_states`` of a run into a folder; the file written."""
        path = folder / f"{record.log_name}_states.{self.form}"
        return write_log(path, states_log(record, rounded=self.rounded))

    def advice(self, path: Path) -> list[str]:
        """A sentence on how a large table of states becomes smaller; none where it is small or as small as it gets."""
        size = path.stat().st_size
        if size < _LARGE or (self.rounded and self.form != "csv"):
            return []
        wanted = [*(["--states csv.gz"] if self.form == "csv" else []), *([] if self.rounded else ["--rounded"])]
        return [f"{path.name} has {size / 1e6:.0f} MB: {' '.join(wanted)} makes it smaller"]


#: The table as it is written where nothing is asked for.
EXACT_CSV = StatesTable()


def states_log(record: AbstractRun, rounded: bool = False) -> Log:
    """States and followed parameters of a run with their deviations, as a log in display units.

    Parameters
    ----------
    record
        A run of a filter, or of a smoother in its place.
    rounded
        Whether digits are left out, see :func:`rounded_to`.
    """
    model = record.filter_model.model
    quantities: list[StateInfo | ParameterInfo] = [*model.parameters, *model.states]
    infos = {info.name: info for info in quantities}
    channels: dict[str, LogChannel] = {}
    for name in record.filter_model.state_names:
        info = infos[name]
        mean, unit = info.shown(record.mean(name)), info.display_unit or "1"
        std = info.shown(record.std(name))
        if rounded:
            mean, std = rounded_to(mean, std), rounded_to(std, std)
        for label, values in ((name, mean), (f"{name}_std", std)):
            channels[label] = LogChannel(label, unit, values)
    return Log(record.log_name, record.time, channels)


def rounded_to(values: FloatArray, std: FloatArray) -> FloatArray:
    """Values (n,) without the digits below a thousandth of their deviations (n,), each the double next to a decimal.

    Where a deviation is zero or unknown a value stays as it is, and so it does where the last digit is beyond what
    doubles hold.

    Examples
    --------
    >>> rounded_to(np.array([12.3456789, -0.000123456, 7.0 / 3.0]), np.array([0.2, 3e-7, 0.0])).tolist()
    [12.3457, -0.000123456, 2.3333333333333335]
    """
    known = np.isfinite(std) & (std > 0.0)
    power = -np.floor(np.log10(_PART * np.where(known, std, 1.0)))
    scale = 10.0 ** np.abs(power)
    counted = np.rint(np.where(power < 0.0, values / scale, values * scale))
    decimal = np.where(power < 0.0, counted * scale, counted / scale)
    # beyond 2^53 of the last digit doubles are sparser than the decimals are
    fits = known & (np.abs(power) <= _EXACT_POWER) & (np.abs(counted) < 2.0**53)
    return np.where(fits, decimal, values)
