"""From the values of the other rooms to those of the report: predictions, parameters, effects, versions."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.initial import directly_measured
from bondgraph.filter.abstract_run import AbstractRun
from bondgraph.filter.filter_run import FilterRun
from bondgraph.report.letters import constants, softening, with_levels
from bondgraph.report.series import (
    ChannelSeries,
    Coefficient,
    FloatArray,
    FoundEffect,
    ParameterChange,
    Prediction,
    StateBand,
)
from bondgraph.simulate.model import Model
from bondgraph.simulate.quantities import OutputInfo, ParameterInfo, StateInfo
from bondgraph.simulate.trajectory import Trajectory
from bondgraph.version import __version__

#: A start is forgotten once the error expected of a prediction is within this factor of its usual one.
_FORGOTTEN = 3.0
LIBRARIES = ("numpy", "scipy", "sympy", "numba")


@dataclass(frozen=True)
class Runs:
    """What one model makes of one log: the filter's record and the free simulation, at the samples of the log."""

    filtered: AbstractRun | None = None
    simulated: Trajectory | None = None

    def prediction(self, row: int, output: OutputInfo) -> Prediction:
        """The predictions of one output as it is shown, one step ahead from where the start is forgotten.

        The first sample was not predicted but given by the prior, and with more states than sensors some samples after
        it are too: errors that the filter itself expects there are many times those of its model.
        """
        one_step = None if self.filtered is None else self.filtered.output_mean[row].copy()
        if one_step is not None and self.filtered is not None:
            expected = np.sqrt(self.filtered.output_var[row])
            known = expected <= _FORGOTTEN * np.nanmedian(expected)
            one_step[: max(int(np.argmax(known)), 1)] = np.nan
        return Prediction(
            None if one_step is None else output.shown(one_step),
            None if self.simulated is None else output.shown(self.simulated.y[row]),
        )


def channel_series(
    model: Model,
    log: MatchedLog,
    before: Runs,
    after: Runs | None = None,
    noise_std: Mapping[str, float] | None = None,
    held_out: bool = False,
) -> tuple[ChannelSeries, ...]:
    """The measured channels of a log with the predictions before and after a correction.

    Parameters
    ----------
    model
        A model whose outputs are the rows of ``log.y``; those of the runs must be the same.
    noise_std
        Standard deviation of each sensor's noise, by output.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> from bondgraph.simulate.simulation import simulate
    >>> swing = simulate(pendulum(), np.arange(20) * 0.05)
    >>> log = MatchedLog("swing", swing.time, swing.u, swing.y + 0.01)
    >>> (one,) = channel_series(pendulum(), log, Runs(simulated=swing), noise_std={"deflection": 0.01})
    >>> one.channel, one.unit, one.noise_std
    ('deflection', 'm', 0.01)
    """
    known = noise_std or {}
    return tuple(
        ChannelSeries(
            log.name, output.name, output.display_unit, log.time, output.shown(log.y[row]),
            before.prediction(row, output), None if after is None else after.prediction(row, output),
            output.shown(known.get(output.name, float("nan"))), held_out,
        )
        for row, output in enumerate(model.outputs)
        if np.isfinite(log.y[row]).any()
    )  # fmt: skip


def state_bands(run: AbstractRun, smoothed: AbstractRun | None = None) -> tuple[StateBand, ...]:
    """Filtered states with their standard deviations, and the measurement where an output measures that state alone.

    An output of the same name may measure more (a pitch that contains the inclination of the road): it is not shown as
    the state.

    Parameters
    ----------
    run
        The record of the filter.
    smoothed
        A record whose filtered beliefs are smoothed ones, if there is one: its means and bands are shown instead.
    """
    model = run.filter_model.model
    direct = directly_measured(model, model.u0(), model.theta())
    measures = {state: (run.y[row] - offset) / slope for row, (state, slope, offset) in direct.items()}
    quantities: list[StateInfo | ParameterInfo] = [*model.states, *model.parameters]
    infos = {info.name: info for info in quantities}
    known = smoothed or run
    bands = []
    for index, name in enumerate(run.filter_model.state_names):
        measured = measures.get(index, np.full(run.time.size, np.nan))
        info = infos[name]
        values = (info.shown(part) for part in (known.mean(name), known.std(name), measured))
        bands.append(StateBand(name, info.display_unit, run.time, *values))
    return tuple(bands)


def output_bands(run: AbstractRun, smoothed: FilterRun, u: FloatArray) -> tuple[StateBand, ...]:
    """What the beliefs say about measured outputs that are more than one state, with the measurements.

    Parameters
    ----------
    run, smoothed
        As for :func:`state_bands`; beliefs about appended parameters are left out.
    u
        Inputs at the samples, shape (n_u, n).
    """
    beliefs = OutputBeliefs(run.filter_model.model, run.y, u)
    beliefs.add(slice(0, run.time.size), smoothed.filtered_mean, smoothed.filtered_cov)
    return beliefs.bands(run)


class OutputBeliefs:
    """Means and deviations of measured outputs that are more than one state, gathered part after part of a log.

    Parameters
    ----------
    model
        Whose outputs they are.
    y, u
        Measurements (n_y, n) and inputs (n_u, n).
    """

    def __init__(self, model: Model, y: FloatArray, u: FloatArray) -> None:
        direct = directly_measured(model, model.u0(), model.theta())
        self._model, self._u = model, u
        self._rows = [row for row in range(len(model.outputs)) if row not in direct and np.isfinite(y[row]).any()]
        self._mean, self._std = (np.full((len(self._rows), y.shape[1]), np.nan) for _ in range(2))

    def add(self, own: slice, mean: FloatArray, cov: FloatArray) -> None:
        """Take the beliefs of some samples: means (n_s, k) and covariances (n_s, n_s, k)."""
        if not self._rows:
            return
        size = len(self._model.states)
        values, vectors = np.linalg.eigh(np.moveaxis(cov[:size, :size], -1, 0))
        spread = np.moveaxis(vectors * np.sqrt(size * np.maximum(values, 0.0))[:, np.newaxis, :], 0, -1)
        middle = mean[:size, np.newaxis]
        points = np.concatenate([middle + spread, middle - spread], axis=1)  # (n_x, 2 n_x, k), with their moments
        y = self._model.output(0.0, points, self._u[:, np.newaxis, own], self._model.theta())
        self._mean[:, own] = y[self._rows].mean(axis=1)
        self._std[:, own] = y[self._rows].std(axis=1)

    def bands(self, run: AbstractRun) -> tuple[StateBand, ...]:
        """The bands, with what a run measured."""
        infos = [self._model.outputs[row] for row in self._rows]
        return tuple(
            StateBand(
                f"{info.name} (measured)", info.display_unit, run.time,
                *(info.shown(part) for part in (mean, std, run.y[row])),
            )
            for row, info, mean, std in zip(self._rows, infos, self._mean, self._std, strict=True)
        )  # fmt: skip


def innovation_bands(run: AbstractRun) -> tuple[StateBand, ...]:
    """Innovations of the measured channels, each in the band of zero that the filter expects of it.

    Examples
    --------
    >>> from bondgraph.filter import FilterModel, run
    >>> from bondgraph.simulate.example import pendulum
    >>> log = MatchedLog("swing", np.arange(3) * 0.1, np.zeros((1, 3)), np.array([[0.1, np.nan, 0.2]]))
    >>> noise = {"process_noise": {"rate": 0.1}, "measurement_noise": {"deflection": 0.1}}
    >>> record = run(FilterModel(pendulum(), **noise, initial_std={"angle": 0.1, "rate": 0.1}), log)
    >>> (band,) = innovation_bands(record)
    >>> band.name, band.mean.tolist(), np.isnan(band.measured).tolist()
    ('deflection', [0.0, 0.0, 0.0], [False, True, False])
    """
    bands = []
    for row, info in enumerate(run.filter_model.model.outputs):
        if np.isfinite(run.y[row]).any():
            # a difference: the zero of a scale of temperature is no part of it
            slope = info.shown(1.0) - info.shown(0.0)
            std = slope * np.sqrt(run.output_var[row])
            zero = np.zeros(run.time.size)
            bands.append(StateBand(info.name, info.display_unit, run.time, zero, std, slope * run.innovation[row]))
    return tuple(bands)


def parameter_changes(
    model: Model,
    before: Mapping[str, float],
    after: Mapping[str, float],
    ci95: Mapping[str, tuple[float, float]],
    at_bound: Sequence[str] = (),
) -> tuple[ParameterChange, ...]:
    """The estimated parameters of a model, in its order; what is not a parameter (noise levels, states) is left out.

    One that is not named ``before`` was not there: it has no value then.
    """
    return tuple(
        ParameterChange(
            info.name, info.display_unit, info.shown(before.get(info.name, float("nan"))), info.shown(after[info.name]),
            _shown_interval(info, ci95), info.name in at_bound, info.meaning,
        )
        for info in model.parameters
        if info.name in after
    )  # fmt: skip


def _shown_interval(info: ParameterInfo, ci95: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    lower, upper = ci95.get(info.name, (float("nan"), float("nan")))
    return info.shown(lower), info.shown(upper)


def found_effect(
    effect: Effect,
    place: Place,
    model: Model,
    values: Mapping[str, float],
    ci95: Mapping[str, tuple[float, float]],
    evidence: Sequence[tuple[str, str]] = (),
) -> FoundEffect:
    """An added effect with its coefficients as the corrected ``model`` and its estimate give them."""
    infos = [model.parameters[model.index("parameter", name)] for name in effect.coefficients]
    coefficients = tuple(
        Coefficient(info.name, info.shown(values[info.name]), info.display_unit, _shown_interval(info, ci95))
        for info in infos
    )
    law = ", ".join([with_levels(effect, model, values), *constants(effect, place, model, values, ci95)])
    turned = softening(effect.name, coefficients)
    law += f" ({turned})" if turned else ""
    return FoundEffect(effect.name, effect.element, place.label, law, coefficients, tuple(evidence))


def added_nodes(before: BondGraph, after: BondGraph) -> frozenset[str]:
    """Names of the nodes that a correction added, parts flattened: those to mark in the drawing."""
    return frozenset(after.flatten().nodes) - frozenset(before.flatten().nodes)


def versions() -> tuple[tuple[str, str], ...]:
    """Versions of the toolkit, of Python and of the libraries that results depend on."""
    installed = [name for name in LIBRARIES if importlib.util.find_spec(name) is not None]
    libraries = ((name, importlib.metadata.version(name)) for name in installed)
    return (("bondgraph", __version__), ("Python", platform.python_version()), *libraries)
