"""Noises that are known of a machine and its sensors, declared beside its graphs.

A module of graphs may have a mapping ``NOISE`` of graph names to :class:`Noise`; the command line finds it there and
filters with it instead of with noises guessed from the logs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.model import Model


@dataclass(frozen=True)
class Noise:
    """What is known about the uncertainties of a model and its measurements.

    Parameters
    ----------
    measurement
        Standard deviation of each output, in coherent SI.
    process
        Standard deviation per sqrt(s) of what drives each state; states not named run undisturbed.
    initial
        Standard deviation of each state at the first sample; states not named are known exactly.
    substeps, method
        How the model is integrated between two samples, see :class:`bondgraph.filter.filter_model.FilterModel`.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = Noise({"deflection": 0.02, "torque": 0.1}, {"rate": 0.1}, {"angle": 0.1}, substeps=2)
    >>> swing.filter_model(pendulum()).measurement_noise
    {'deflection': 0.02}
    """

    measurement: Mapping[str, float]
    process: Mapping[str, float]
    initial: Mapping[str, float]
    substeps: int = 1
    method: str = "rk4"

    def filter_model(self, model: Model, **changes: Any) -> FilterModel:
        """The filter of a model; what the (reduced) model does not have is left out. ``changes`` are further fields.

        Raises
        ------
        FilterError
            If no output of the model is measured.
        """
        states, outputs = model.names("state"), model.names("output")
        fields: dict[str, Any] = {"substeps": self.substeps, "method": self.method, "alpha": 1.0}
        return FilterModel(
            model, _of(self.process, states), _of(self.measurement, outputs), _of(self.initial, states),
            **(fields | changes),
        )  # fmt: skip


def _of(values: Mapping[str, float], names: tuple[str, ...]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items() if name in names}
