"""Where the states of an effect start: where the model without it has what they store.

An elastic part sets free an inertia that was tied to another one, and carries what went through the tie; a lag holds a
command. Their declared start, mostly zero, is no knowledge of a log that begins in motion. So they start where every
bond that both models have is as near as it can be to what it is without the effect, as if that had just begun to act.
What a late sensor holds is no bond's: its states start at rest, as if the machine had stood where it begins.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from bondgraph.build import BuiltModel
from bondgraph.correct.models.bonds import bond_model
from bondgraph.data.log import FloatArray
from bondgraph.filter.follows import Follow
from bondgraph.simulate.model import Model

#: Differences are taken over this share of a value, at least of one.
_STEP = 1e-4
#: A bond whose variable changes by less than this share of the largest response to a state tells nothing of it.
_TELLING = 1e-6
#: Most turns until the states settle, and the share of a state that is settled. A law that is flat where the search
#: begins sends it far off, from where half of the way is made in a turn: fifty are those of all digits of a number.
_TURNS, _SETTLED = 50, 1e-9


def followers(
    before: BuiltModel, after: BuiltModel, x: FloatArray, u: FloatArray, values: Mapping[str, float]
) -> dict[str, Follow]:
    """Starts of the states that only ``after`` has, linearised at states x (n_x,) of ``before`` and inputs u (n_u,).

    ``values`` are parameters by name. States that no shared bond shows keep their declared start.
    """
    names, inputs = before.model.names("state"), before.model.names("input")
    own = [name for name in after.model.names("state") if name not in names]
    if not own or after.model.names("input") != inputs:
        return {}
    first, second = bond_model(before.causal), bond_model(after.causal)
    shared = [name for name in first.names("output") if name in second.names("output")]
    wanted = _bonds(first, shared, values)
    shown = _bonds(second, shared, values)

    def start(point: FloatArray) -> FloatArray:
        known, given = point[: x.size], point[x.size :]
        return _start(second, own, dict(zip(names, known, strict=True)), given, wanted(known, given), shown)

    point = np.concatenate([x, u])
    middle = start(point)
    steps = _STEP * np.maximum(np.abs(point), 1.0)
    slopes = np.array([(start(point + one) - middle) / step for one, step in zip(np.diag(steps), steps, strict=True)])
    if not (np.isfinite(middle).all() and np.isfinite(slopes).all()):
        return {}
    constants = middle - slopes.T @ point
    return {
        name: Follow(float(constants[k]), tuple(zip((*names, *inputs), map(float, slopes[:, k]), strict=True)))
        for k, name in enumerate(own)
    }


def at_rest(
    before: BuiltModel, after: BuiltModel, x: FloatArray, u: FloatArray, values: Mapping[str, float]
) -> dict[str, Follow]:
    """Starts of the states that only ``after`` has where their rates vanish; arguments as for :func:`followers`.

    None where they come to rest nowhere, or anywhere.
    """
    names, model = before.model.names("state"), after.model
    own = [k for k, name in enumerate(model.names("state")) if name not in names]
    if not own or model.names("input") != before.model.names("input"):
        return {}
    rest = [k for k in range(len(model.states)) if k not in own]
    point = model.x0(**dict(zip(names, map(float, x), strict=True)))
    theta = model.theta(**{name: value for name, value in values.items() if name in model.names("parameter")})
    with np.errstate(all="ignore"):
        rates = model.rhs(0.0, point, u, theta)[own]
        by_x = model.jacobian_x(0.0, point, u, theta)[own]
        by_u = model.jacobian_u(0.0, point, u, theta)[own]
    if not np.isfinite(by_x).all() or np.linalg.matrix_rank(by_x[:, own]) < len(own):
        return {}
    slopes = -np.linalg.solve(by_x[:, own], np.hstack([by_x[:, rest], by_u]))
    middle = point[own] - np.linalg.solve(by_x[:, own], rates)
    constants = middle - slopes @ np.concatenate([point[rest], u])
    signals = (*(model.names("state")[k] for k in rest), *model.names("input"))
    lines = [tuple(zip(signals, map(float, row), strict=True)) for row in slopes]
    return {model.names("state")[row]: Follow(float(constants[k]), lines[k], rests=True) for k, row in enumerate(own)}


_Bonds = Callable[[FloatArray, FloatArray], FloatArray]


def _bonds(model: Model, rows: list[str], values: Mapping[str, float]) -> _Bonds:
    """Shared outputs and bond variables of a model at states and inputs."""
    index = [model.index("output", name) for name in rows]
    theta = model.theta(**{name: value for name, value in values.items() if name in model.names("parameter")})

    def shown(x: FloatArray, u: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            return model.output(0.0, x, u, theta)[index]

    return shown


def _start(
    model: Model, own: list[str], known: Mapping[str, float], u: FloatArray, wanted: FloatArray, shown: _Bonds
) -> FloatArray:
    """Own states (own,) at which the shared bonds are nearest to what is wanted; NaN where the search does not end."""
    x = model.x0(**known)
    rows = [model.index("state", name) for name in own]
    for _ in range(_TURNS):
        moves = _moves(x, rows, u, wanted, shown)
        x[rows] += moves
        if np.all(np.abs(moves) <= _SETTLED * np.maximum(np.abs(x[rows]), 1.0)):
            return x[rows]
    return np.full(len(rows), np.nan)


def _moves(x: FloatArray, rows: list[int], u: FloatArray, wanted: FloatArray, shown: _Bonds) -> FloatArray:
    """One step (own,) of Gauss and Newton, each bond over its largest response."""
    level = shown(x, u)
    with np.errstate(all="ignore"):  # a bond may have no value there, or none that is finite
        columns = []
        for row in rows:
            moved = x.copy()
            moved[row] += _STEP
            columns.append((shown(moved, u) - level) / _STEP)
        response = np.array(columns).T
        largest = np.abs(response).max(axis=0, initial=0.0)
        size = np.abs(response / np.where(largest > 0.0, largest, 1.0)).max(axis=1, initial=0.0)
        told = np.isfinite(response).all(axis=1) & np.isfinite(wanted - level) & (size > _TELLING)
    if not told.any():
        return np.zeros(len(rows))
    weight = 1.0 / np.abs(response[told]).max(axis=1)
    found: FloatArray = np.linalg.lstsq(
        weight[:, np.newaxis] * response[told], weight * (wanted - level)[told], rcond=1e-9
    )[0]
    return found
