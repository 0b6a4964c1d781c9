"""What an on-line filter remembers: its belief now and, for late measurements, over a bounded time before."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError
from bondgraph.filter.adaptive import NoiseBelief
from bondgraph.simulate.outcome import Outcome

#: What a saved state is, and its version.
FORMAT = "bondgraph-online-filter/1"


@dataclass(frozen=True)
class Remembered:
    """A sample, its inputs (n_u,) and measurements (n_y,), and the belief after it: mean (n_s,), factor (n_s, n_s).

    ``nll`` is the negative log-likelihood of all samples up to it, ``noise`` what is believed of the sensors where
    their levels are followed.
    """

    time: float
    u: FloatArray
    y: FloatArray
    mean: FloatArray
    lower: FloatArray
    nll: float
    noise: NoiseBelief | None = None


@dataclass(frozen=True)
class OnlineState:
    """All that an on-line filter has learnt: what it remembers, the latest sample last.

    ``digest`` tells for which filter model and parameters it holds; ``interval`` is the sampling interval, s, NaN where
    only one sample has come.
    """

    digest: str
    interval: float
    remembered: tuple[Remembered, ...]

    def save(self, path: str | Path) -> None:
        """Write the state as JSON, numbers to their last digit."""
        found = {
            "format": FORMAT, "digest": self.digest, "interval": _plain(self.interval),
            "remembered": [_written(one) for one in self.remembered],
        }  # fmt: skip
        Path(path).write_text(json.dumps(found, allow_nan=False), encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path) -> OnlineState:
        """Read a saved state.

        Raises
        ------
        FilterError
            If the file is none.
        """
        try:
            found = json.loads(Path(path).read_text(encoding="utf-8"))
            if found["format"] != FORMAT:
                raise KeyError("format")
            remembered = tuple(_read(one) for one in found["remembered"])
            return cls(found["digest"], float(_array(found["interval"])), remembered)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise FilterError(
                f"{path}: no state of an on-line filter ({type(error).__name__}: {error}) - give a file that"
                " OnlineState.save wrote",
                where=(str(path),),
            ) from None


@dataclass(frozen=True, repr=False)
class FilterStep:
    """What one sample gave.

    Shapes: mean (n_s,) and cov (n_s, n_s) of the filter's state, ``predicted`` before and without prefix after the
    measurement; ``output_mean`` (n_y,) and ``output_cov`` (n_y, n_y) expected of all channels, noise included;
    ``innovation`` (n_y,), NaN where nothing was measured; ``whitened`` and ``log_scales`` (n_y,) as in
    :class:`bondgraph.filter.belief.Update`. ``noise_std`` (n_y,) are the standard deviations of the sensors that were
    used. Where the sample was not ``accepted``, ``reason`` says why, and the belief is the one before it. ``replayed``
    samples were filtered again since the measurement came late; all else is then told of the latest one.
    """

    time: float
    predicted_mean: FloatArray
    predicted_cov: FloatArray
    mean: FloatArray
    cov: FloatArray
    output_mean: FloatArray
    output_cov: FloatArray
    innovation: FloatArray
    whitened: FloatArray
    log_scales: FloatArray
    noise_std: FloatArray
    outcome: Outcome = Outcome.OK
    accepted: bool = True
    reason: str = ""
    replayed: int = 0

    def __repr__(self) -> str:
        said = f"NIS {self.nis:.4g}" if self.accepted else f"not accepted: {self.reason}"
        return f"<FilterStep at {self.time:.6g} s: {said}>"

    @property
    def nis(self) -> float:
        """Normalised innovation squared; NaN where nothing was measured."""
        return float(self.whitened @ self.whitened) if self.measured else np.nan

    @property
    def measured(self) -> int:
        """Number of channels that were measured."""
        return int(np.count_nonzero(~np.isnan(self.innovation)))

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the density of the measurement given all before it."""
        constant = 0.5 * np.log(2.0 * np.pi) * self.measured
        return float(-0.5 * self.whitened @ self.whitened - self.log_scales.sum() - constant)


def _plain(values: FloatArray | float) -> Any:
    """Numbers as lists, None in the place of NaN."""
    listed = np.asarray(values, dtype=np.float64).tolist()
    return _without_nan(listed)


def _without_nan(listed: Any) -> Any:
    if isinstance(listed, list):
        return [_without_nan(one) for one in listed]
    return None if listed != listed else listed


def _array(values: Any) -> FloatArray:
    return np.array(values, dtype=np.float64)


def _written(one: Remembered) -> dict[str, Any]:
    noise = None if one.noise is None else [_plain(part) for part in one.noise]
    arrays = {name: _plain(getattr(one, name)) for name in ("time", "u", "y", "mean", "lower", "nll")}
    return {**arrays, "noise": noise}


def _read(written: dict[str, Any]) -> Remembered:
    arrays = {name: _array(written[name]) for name in ("u", "y", "mean", "lower")}
    noise = None if written["noise"] is None else NoiseBelief(*map(_array, written["noise"]))
    return Remembered(time=float(written["time"]), nll=float(written["nll"]), noise=noise, **arrays)
