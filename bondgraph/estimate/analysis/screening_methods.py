"""Methods of global sensitivity: how each samples a box, what it makes of the responses, and how that reads and looks.

References: Morris (1991), Factorial sampling plans for preliminary computational experiments, Technometrics 33(2);
Saltelli et al. (2010), Variance based sensitivity analysis of model output, Computer Physics Communications 181(2).
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from bondgraph.arrays import BoolArray, FloatArray
from bondgraph.errors import OptionError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Method = Literal["morris", "sobol"]
#: Levels of the grid, as Morris (1991), Technometrics 33(2), has them in his examples.
_LEVELS = 4
#: Share of the variance, or of the largest effect, below which a parameter hardly matters: a convention.
LITTLE = 0.05


@dataclass(frozen=True)
class Indices:
    """Indices by column, each (n,), and of some the half widths of their 95 % intervals."""

    values: Mapping[str, FloatArray]
    widths: Mapping[str, FloatArray]


class ScreeningMethod(Protocol):
    """A design of samples over a box, and the indices that responses there give."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the indices."""

    @property
    def key(self) -> str:
        """The index that tells how much a parameter matters."""

    @property
    def of(self) -> str:
        """The quantity that this index is a share of, in words."""

    @property
    def sample(self) -> str:
        """One sample in words, in the plural."""

    @property
    def usual(self) -> int:
        """Samples where none are asked for."""

    @property
    def need(self) -> str:
        """The rule for a number of samples, in words."""

    def accepts(self, size: int) -> bool:
        """True for a number of samples that the design can have."""

    def size(self, evaluations: int, parameters: int) -> int:
        """Samples that some evaluations make."""

    def sampled(self, space: dict[str, Any], size: int, seed: int) -> FloatArray:
        """Points (members, n) of the design."""

    def analysed(self, space: dict[str, Any], points: FloatArray, values: FloatArray, seed: int) -> Indices:
        """Indices of responses (members,) at the points."""

    def whole(self, found: Indices) -> float:
        """The quantity of which shares of the key index are taken."""

    def together(self, found: Indices) -> BoolArray:
        """True where a parameter brings clearly more with others than alone, shape (n,)."""

    def draw(self, axes: Axes, names: Sequence[str], order: Sequence[int], found: Indices) -> None:
        """Indices of parameters as a picture; ``order`` has the most important one first."""


class Morris:
    """Elementary effects over the whole width of a bound: few evaluations tell what does not matter."""

    columns = ("mu_star", "mu", "sigma")
    key, of, sample, usual, need = "mu_star", "largest effect", "trajectories", 40, "at least two trajectories"

    def accepts(self, size: int) -> bool:
        """True from two trajectories on."""
        return size >= 2

    def size(self, evaluations: int, parameters: int) -> int:
        """Trajectories, each of a point and a step of every parameter."""
        return evaluations // (parameters + 1)

    def sampled(self, space: dict[str, Any], size: int, seed: int) -> FloatArray:
        """Points (members, n) of trajectories on a grid."""
        found: FloatArray = _salib("sample.morris").sample(space, size, num_levels=_LEVELS, seed=seed)
        return found

    def analysed(self, space: dict[str, Any], points: FloatArray, values: FloatArray, seed: int) -> Indices:
        """Means, absolute means and spreads of elementary effects."""
        found = _salib("analyze.morris").analyze(space, points, values, num_levels=_LEVELS, seed=seed)
        return Indices(
            _columns(found, {name: name for name in self.columns}), _columns(found, {"mu_star": "mu_star_conf"})
        )

    def whole(self, found: Indices) -> float:
        """The largest effect."""
        return float(np.max(found.values[self.key])) or 1.0

    def together(self, found: Indices) -> BoolArray:
        """Nowhere: elementary effects do not tell parts of a variance apart."""
        return np.zeros(found.values[self.key].size, dtype=np.bool_)

    def draw(self, axes: Axes, names: Sequence[str], order: Sequence[int], found: Indices) -> None:
        """The plane of mean and spread."""
        mean, spread = found.values["mu_star"], found.values["sigma"]
        axes.plot(mean, spread, "o")
        for name, x, y in zip(names, mean, spread, strict=True):
            axes.annotate(name, (float(x), float(y)), xytext=(4, 3), textcoords="offset points", fontsize="small")
        axes.set_xlabel("mean of absolute elementary effects")
        axes.set_ylabel("their standard deviation")


class Sobol:
    """Shares of the variance that a parameter brings alone (first order) and with all others (total)."""

    columns = ("first", "total")
    key, of, sample, usual, need = "total", "variance", "samples", 1024, "a power of two, such as 256 or 1024"

    def accepts(self, size: int) -> bool:
        """True for powers of two from two on, which keep the sequence balanced."""
        return size >= 2 and not size & (size - 1)

    def size(self, evaluations: int, parameters: int) -> int:
        """Base samples, each evaluated in two designs and once for every parameter."""
        return evaluations // (parameters + 2)

    def sampled(self, space: dict[str, Any], size: int, seed: int) -> FloatArray:
        """Points (members, n) of Saltelli's design."""
        found: FloatArray = _salib("sample.sobol").sample(space, size, calc_second_order=False, seed=seed)
        return found

    def analysed(self, space: dict[str, Any], points: FloatArray, values: FloatArray, seed: int) -> Indices:
        """First-order and total indices."""
        # SALib takes a seed of zero for none
        found = _salib("analyze.sobol").analyze(space, values, calc_second_order=False, seed=seed + 1)
        own = _columns(found, {"first": "S1", "total": "ST"})
        return Indices(own, _columns(found, {"first": "S1_conf", "total": "ST_conf"}))

    def whole(self, found: Indices) -> float:
        """One: the indices are shares already."""
        return 1.0

    def together(self, found: Indices) -> BoolArray:
        """True where the total share is above the first-order one by more than both intervals."""
        width = np.hypot(found.widths["first"], found.widths["total"])
        return np.asarray(found.values["total"] - found.values["first"] - width > LITTLE)

    def draw(self, axes: Axes, names: Sequence[str], order: Sequence[int], found: Indices) -> None:
        """Bars with their intervals."""
        for shift, column, label in ((0.2, "first", "first order"), (-0.2, "total", "total")):
            places = [len(names) - 1 - rank + shift for rank in range(len(names))]
            values, widths = (group[column][list(order)] for group in (found.values, found.widths))
            axes.barh(places, values, 0.36, xerr=widths, label=label)
        axes.set_yticks(range(len(names)), [names[k] for k in reversed(order)])
        axes.set_xlabel("share of the variance")
        axes.legend(loc="best", fontsize="small")


#: Methods by name.
SCREENING_METHODS: Mapping[Method, ScreeningMethod] = {"morris": Morris(), "sobol": Sobol()}


def _columns(found: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, FloatArray]:
    """Columns of the library under our names."""
    return {own: np.asarray(found[theirs], dtype=np.float64) for own, theirs in names.items()}


def _salib(module: str) -> Any:
    try:
        return importlib.import_module(f"SALib.{module}")
    except ImportError:
        raise OptionError(
            "global sensitivity: SALib is not installed - run: pip install 'bondloop[sensitivity]'", where=("SALib",)
        ) from None
