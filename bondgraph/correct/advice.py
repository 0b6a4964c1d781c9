"""What would tell two effects apart that these data do not: another sensor, or another manoeuvre.

The correlation of two candidates' responses, free parameters taken out, says how well data can tell them apart; it can
be computed for data that nobody has measured, see :mod:`bondgraph.estimate.design.likeness`. Tried are a sensor on
every effort and flow that both models have, and manoeuvres that step one input while the others rest. The model is then
left alone (no gains), with sensors as good as those there are. Reference: Fedorov (1972), Theory of Optimal
Experiments, for designs that discriminate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.build import BuiltModel
from bondgraph.correct.models.bonds import bond_model
from bondgraph.correct.models.candidates import Candidate, Variant
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.derive.causality import assign_causality
from bondgraph.errors import BondGraphError
from bondgraph.estimate.design.likeness import likeness
from bondgraph.estimate.design.manoeuvres import step_manoeuvres
from bondgraph.estimate.fitted import Fit
from bondgraph.filter.linear.intervals import integrator, simulation_steps
from bondgraph.filter.linear.recursion import respond
from bondgraph.filter.linear.response import Path, model_change, open_loop, output_slopes, together
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate

#: A proposal must bring the correlation below this share of what is left of it.
_WORTH = 0.98
#: Noise of a sensor that is proposed, as a share of the size of what it would show.
_SENSOR = 0.01


@dataclass(frozen=True)
class Separation:
    """How alike two candidates are in these data, and what would separate them best (empty: nothing that was tried)."""

    correlation: float
    sensor: str = ""
    with_sensor: float = 1.0
    manoeuvre: str = ""
    with_manoeuvre: float = 1.0

    def __str__(self) -> str:
        parts = []
        if self.sensor:
            parts.append(f"a sensor of the {self.sensor} (correlation {abs(self.with_sensor):.3f})")
        if self.manoeuvre:
            parts.append(f"{self.manoeuvre} (correlation {abs(self.with_manoeuvre):.3f})")
        return " or ".join(parts) if parts else "none of the sensors and manoeuvres that were tried would separate them"


def separation(
    built: BuiltModel, fitted: Fit, a: tuple[Candidate, Variant], b: tuple[Candidate, Variant], known: float
) -> Separation:
    """What would tell two candidates apart.

    Parameters
    ----------
    built, fitted
        The model without either, and its fit.
    a, b
        The candidates, in the variant that fits best.
    known
        Correlation of their responses in the data that there are.
    """
    best = Separation(known)
    log = fitted.problem.logs[0]
    wide = _wide(built, (a[0], b[0]))
    here = _simulated(fitted, log, log.u, log.time)
    if here is not None and wide is not None:
        rows, extra = _responses(fitted, here, (a, b), wide)
        for name, row in extra.items():
            value = likeness(np.concatenate([rows, row]))
            if abs(value) < _WORTH * abs(best.with_sensor if best.sensor else known):
                best = replace(best, sensor=_said(name), with_sensor=value)
    for planned in step_manoeuvres(fitted.problem.filter_model.model, fitted.problem.logs):
        path = _simulated(fitted, log, planned.u, planned.time)
        if path is None:
            continue
        value = likeness(_responses(fitted, path, (a, b), None)[0])
        if abs(value) < _WORTH * abs(best.with_manoeuvre if best.manoeuvre else known):
            best = replace(best, manoeuvre=planned.name, with_manoeuvre=value)
    return best


def _said(name: str) -> str:
    """``effort(a->b)`` as a person says it."""
    variable, _, bond = name.partition("(")
    return f"{variable} on the bond {bond.removesuffix(')').replace('->', ' -> ')}"


def _simulated(fitted: Fit, log: MatchedLog, u: FloatArray, time: FloatArray) -> Path | None:
    """Where the fitted model goes with some inputs."""
    model = fitted.problem.filter_model.model
    theta = fitted.theta.copy()
    for name, value in log.theta_overrides.items():
        theta[model.index("parameter", name)] = value
    steps = simulation_steps(fitted.problem.filter_model, time)
    x0 = fitted.problem.batch(fitted.point[:, np.newaxis]).x0[0][:, 0]
    method = integrator(fitted.problem.filter_model)
    run = simulate(model, time, u, theta, x0, method=method, substeps=steps, compiled=True)
    if not np.isfinite(run.x).all():
        return None
    made = MatchedLog("simulated", time, u, run.y, dict(log.theta_overrides))
    own = inputs_of(model, made)
    return Path(model, made, time, run.x[:, :-1], run.x[:, 1:], own[:, :-1], own[:, 1:], run.x, own, theta)


Pair = tuple[tuple[Candidate, Variant], tuple[Candidate, Variant]]


@dataclass(frozen=True)
class _Wide:
    """Models whose outputs are followed by the effort and flow of every bond: the declared one and both candidates'."""

    declared: Model
    candidates: tuple[Model, Model]


def _wide(built: BuiltModel, pair: tuple[Candidate, Candidate]) -> _Wide | None:
    try:
        first, second = (bond_model(assign_causality(one.apply(built.graph))) for one in pair)
    except BondGraphError:
        return None
    return _Wide(bond_model(built.causal), (first, second))


def _responses(fitted: Fit, path: Path, pair: Pair, wide: _Wide | None) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Responses (rows, free + 2) of the model left alone, and (n, free + 2) of each quantity that might be measured."""
    model = fitted.problem.filter_model.model
    noise = fitted.problem.batch(fitted.point[:, np.newaxis]).noise_std[:, 0]
    known = dict(zip(model.names("parameter"), map(float, path.theta), strict=True))
    changed: list[tuple[Model, Model | None, FloatArray, float]] = []
    for parameter in fitted.problem.free:
        if parameter.target.kind == "parameter":
            size = 1e-4 * (parameter.upper - parameter.lower)
            theta = model.theta(**known | {parameter.name: known[parameter.name] + size})
            changed.append((model, None if wide is None else wide.declared, theta, size))
    for k, (candidate, variant) in enumerate(pair):
        name, size = candidate.effect.coefficients[0], variant.sizes[0]
        theta = candidate.model.theta(**path.parameters(candidate.model) | dict(variant.shapes) | {name: size})
        changed.append((candidate.model, None if wide is None else wide.candidates[k], theta, size))
    linear = open_loop(path, fitted.problem.filter_model, noise)
    changes = together([model_change(path, other, theta, size) for other, _, theta, size in changed])
    with np.errstate(all="ignore"):  # what runs away is no number in the end
        rows, states = respond(linear, changes, range(path.time.size))
    return rows, {} if wide is None else _measurable(path, wide.declared, model, changed, states)


def _measurable(
    path: Path,
    declared: Model,
    model: Model,
    changed: Sequence[tuple[Model, Model | None, FloatArray, float]],
    states: FloatArray,
) -> dict[str, FloatArray]:
    """What a sensor on each effort and flow would show of each change, over its noise."""
    slopes = output_slopes(replace(path, theta=declared.theta(**path.parameters(declared))), declared)
    theta = declared.theta(**path.parameters(declared))
    shown = declared.output(path.time, path.before, path.inputs_for(declared)[2], theta)
    own = len(model.outputs)
    found = {}
    after = [
        None if wide is None or len(wide.states) != len(declared.states)
        else (
            wide.output(path.time, path.before, path.inputs_for(wide)[2], theta),
            {n: k for k, n in enumerate(wide.names("output"))},
        )
        for _, wide, theta, _ in changed
    ]  # fmt: skip
    for row in range(own, len(declared.outputs)):
        name = declared.outputs[row].name
        if any(one is None or name not in one[1] for one in after):
            continue
        size = float(np.abs(shown[row]).max())
        if not size > 0.0:
            continue
        direct = np.array([
            (one[0][one[1][name]] - shown[row]) / width
            for one, (_, _, _, width) in zip(after, changed, strict=True) if one is not None
        ])  # fmt: skip
        with np.errstate(all="ignore"):
            found[name] = (np.einsum("kx,kxl->kl", slopes[:, row], states) + direct.T) / (_SENSOR * size)
    return found
