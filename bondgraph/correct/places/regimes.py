"""Regimes: a law that acts in part of the operating space only, as the value of a signal of the graph says.

It acts above or below a level, or between or outside of two. The coefficients of the law are multiplied by a smooth
step in the signal, or by two, so that the law with its regime is a law of the graph like any other. A level is a shape
of the law, estimated with it between the ends of what the signal covers in the logs. The width of the step is held at
first: over it a gate is neither open nor shut, and no finer than a share of the range of the signal can a filter see
where that is. Time is no signal: what happens at a time is an event.

Reference: Teräsvirta (1994), J. American Statistical Association 89(425), for smooth transitions between regimes;
Hansen (2000), Econometrica 68(3), for the estimate of a threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from sympy import Expr, Symbol

from bondgraph.correct.places.probes import Signal, argument, knots
from bondgraph.data.log import FloatArray
from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, THERMAL, TRANSLATION
from bondgraph.declare.effect import SMOOTHING, Effect, EffectFunction, Place
from bondgraph.declare.elements import STORAGES
from bondgraph.declare.functions import switch
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import replace_symbols
from bondgraph.estimate.fitted import Fit

Side = Literal["above", "below", "between", "outside"]

#: Levels of a signal that are tried: between so many knots, between which it is found about equally often.
_KNOTS = 41
#: Names of efforts and flows by their unit; where a unit says nothing they are called that.
_WORDS = {
    ("flow", TRANSLATION.flow_unit): "speed", ("flow", ROTATION.flow_unit): "speed",
    ("effort", TRANSLATION.effort_unit): "force", ("effort", ROTATION.effort_unit): "torque",
    ("flow", ELECTRICAL.flow_unit): "current", ("effort", ELECTRICAL.effort_unit): "voltage",
    ("effort", HYDRAULIC.effort_unit): "pressure", ("effort", THERMAL.effort_unit): "temperature",
    ("flow", THERMAL.flow_unit): "heat flow",
}  # fmt: skip


def in_words(signal: str, unit: str) -> str:
    """A signal in the words of its domain, as its unit tells them.

    Examples
    --------
    >>> in_words("effort of water", "K"), in_words("displacement of spring", "m"), in_words("pull", "N")
    ('temperature of water', 'displacement of spring', 'pull')
    """
    variable, separator, node = signal.partition(" of ")
    return f"{_WORDS.get((variable, unit), variable)} of {node}" if separator else signal


@dataclass(frozen=True)
class Regime:
    """Where a law acts: where a signal is above (below) a level, or between (outside) that and an upper one.

    ``level`` and ``upper`` are where their search begins, ``span`` the range of the signal in the logs; ``width`` the
    distance from a level at which its step has made 88 % of its way.
    """

    signal: str
    unit: str
    side: Side
    level: float
    span: tuple[float, float]
    width: float
    upper: float | None = None

    @property
    def words(self) -> str:
        """The regime as a person reads it, without its levels.

        Examples
        --------
        >>> Regime("flow of shaft", "rad/s", "above", 12.0, (0.0, 20.0), 0.4).words
        'speed of shaft is above a level'
        >>> Regime("flow of shaft", "rad/s", "outside", 5.0, (0.0, 20.0), 0.4, 12.0).words
        'speed of shaft is outside two levels'
        """
        return self.told("a level" if self.upper is None else "two levels")

    @property
    def quantity(self) -> str:
        """The signal in words."""
        return in_words(self.signal, self.unit)

    def told(self, *levels: str) -> str:
        """The regime as a person reads it, with the texts of its levels.

        Examples
        --------
        >>> Regime("flow of shaft", "rad/s", "between", 5.0, (0.0, 20.0), 0.4, 12.0).told("5", "12 rad/s")
        'speed of shaft is between 5 and 12 rad/s'
        """
        return f"{self.quantity} is {self.side} {' and '.join(levels)}"

    def shuts(self, levels: Sequence[float], width: float) -> bool:
        """True where the law is off somewhere in the logs, by 88 % at least; one that never is acts everywhere.

        Examples
        --------
        >>> slow = Regime("flow of shaft", "rad/s", "below", 12.0, (0.0, 20.0), 0.4)
        >>> slow.shuts((12.0,), 3.0), slow.shuts((12.0,), 10.0)
        (True, False)
        """
        low, high = levels[0], levels[-1]
        ends = low - width > self.span[0], high + width < self.span[1]
        if self.side == "outside":
            return low + width < high - width
        return all(ends) if self.side == "between" else ends[self.side == "below"]

    def gate(self, levels: Sequence[Expr], width: Expr) -> Expr:
        """The smooth step, or what two of them leave open, as an expression of the graph."""
        value = argument(self.signal)
        if self.side == "below":
            return switch(levels[0] - value, width)
        past = switch(value - levels[0], width)
        if self.side == "above":
            return past
        between = past * switch(levels[1] - value, width)
        return between if self.side == "between" else 1 - between


def regime_of(function: EffectFunction) -> Regime | None:
    """The regime of an effect function, None for a law that acts everywhere."""
    found = function.__dict__.get("regime")
    return found if isinstance(found, Regime) else None


def everywhere(function: EffectFunction) -> EffectFunction:
    """The effect function whose law acts everywhere, of one that :func:`in_regime` has made."""
    found: EffectFunction = function.__dict__.get("everywhere", function)
    return found


def in_regime(function: EffectFunction, regime: Regime) -> EffectFunction:
    """The effect function whose law acts in a regime only; None where the law has no coefficient that a gate closes.

    A storage keeps what it holds: its coefficient cannot change with a signal.

    Examples
    --------
    >>> from bondgraph.declare.domains import ROTATION
    >>> from bondgraph.declare.effect import Scale
    >>> def drag(g: BondGraph, at: Place) -> Effect | None:
    ...     c = g.parameter("c", 0.0, "N m s", "drag", (0.0, 1.0))
    ...     _ = g.resistance("drag", lambda flow: c * flow, at=at.junction)
    ...     return Effect("drag", "drag", "effort = c*flow", ("c",))
    >>> g = BondGraph("drive")
    >>> shaft = g.one_junction("shaft", ROTATION)
    >>> fast = in_regime(drag, Regime("flow of shaft", "rad/s", "above", 12.0, (0.0, 20.0), 0.4))
    >>> effect = fast(g, Place(shaft, Scale(2.0, 20.0)))
    >>> effect.law, effect.shapes
    ('effort = c*flow, where speed of shaft is above level_c', ('level_c',))
    >>> g.nodes["drag"].law("effort")
    c*flow*switch(flow(shaft) - level_c, width_c)
    """

    def extended(g: BondGraph, at: Place) -> Effect | None:
        declared = set(g.nodes)
        effect = function(g, at)
        if effect is None or not _can_be_gated(g, effect, declared):
            return None
        names, about = level_names(effect, regime), width_name(effect)
        starts = (regime.level,) if regime.upper is None else (regime.level, regime.upper)
        levels = [
            g.parameter(name, start, regime.unit, _meaning(regime, which, effect), regime.span)
            for name, start, which in zip(names, starts, ("lower", "upper"), strict=False)
        ]
        width = g.parameter(about, regime.width, regime.unit, "distance within which it comes and goes")
        on = regime.gate(levels, width)
        replace_symbols(g, {one: symbol(one) * on for one in effect.coefficients})
        return replace(
            effect, law=f"{effect.law}, where {regime.told(*names)}", regime=regime.words,
            shapes=(*effect.shapes, *names), widths=(*effect.widths, about),
            grids=(*effect.grids, *((name, (start,)) for name, start in zip(names, starts, strict=True))),
        )  # fmt: skip

    extended.__name__ = function.__name__
    extended.__dict__.update(function.__dict__)
    extended.__dict__.update(regime=regime, everywhere=function)
    return extended


def level_names(effect: Effect, regime: Regime) -> tuple[str, ...]:
    """The parameters that hold the level of a gated law, or its two."""
    own = effect.coefficients[0]
    return (f"level_{own}",) if regime.upper is None else (f"level_{own}", f"upper_{own}")


def _meaning(regime: Regime, which: str, effect: Effect) -> str:
    one = regime.quantity if regime.upper is None else f"{which} of two levels of {regime.quantity},"
    return f"{one} {regime.side} which {effect.element} acts"


def width_name(effect: Effect) -> str:
    """The parameter that holds the width within which a gated law comes and goes."""
    return f"width_{effect.coefficients[0]}"


def width_of(effect: Effect, fitted: Fit) -> float:
    """The width within which a gated law comes and goes in a fit, free or held."""
    return float(fitted.theta[fitted.problem.filter_model.model.index("parameter", width_name(effect))])


def _can_be_gated(g: BondGraph, effect: Effect, declared: set[str]) -> bool:
    """True for a law without a state or a shape, whose coefficients stand in laws of the graph and nowhere else."""
    if effect.adds_state or effect.channel or effect.shapes or effect.amplitudes or len(effect.coefficients) != 1:
        return False
    node = g.nodes.get(effect.element)
    if node is None or node.kind in STORAGES:
        return False
    own = {symbol(name) for name in effect.coefficients}
    defined = [one.of for one in g.integrals] + [one.expression for one in g.signals]
    return not any(own & given.free_symbols for given in defined) and _in_laws(g, own)


def _in_laws(g: BondGraph, wanted: set[Symbol]) -> bool:
    return any(wanted & law.free_symbols for node in g.nodes.values() for _, law in node.laws)


def tried(signal: Signal) -> tuple[Regime, FloatArray]:
    """The regime above the middle of a signal, and the levels (n,) that are tried in its place.

    A signal that takes both signs is also tried at zero, where its direction changes.
    """
    together = np.concatenate(signal.values)
    span = (float(together.min()), float(together.max()))
    at = knots(signal, _KNOTS, beyond=0.0)
    levels = 0.5 * (at[1:] + at[:-1])
    if span[0] < 0.0 < span[1]:
        levels = np.unique(np.append(levels, 0.0))
    width = SMOOTHING * (span[1] - span[0])
    return Regime(signal.name, signal.unit, "above", float(np.median(together)), span, width), levels
