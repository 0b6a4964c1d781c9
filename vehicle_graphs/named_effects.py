"""Effects that a machine knows by name, and its graph with those that are named.

A machine that is corrected step by step keeps its start graph and a table of what may be added to it: by name, a
function that extends the graph at the place where the effect acts. A graph with some of them is made here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from bondgraph.declare.editing import handle
from bondgraph.declare.effect import EffectFunction, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import OptionError, suggest

#: Adds one effect to a graph, at the place that it knows.
Extension = Callable[[BondGraph], None]


def acting_at(function: EffectFunction, junction: str, scale: Scale) -> Extension:
    """An effect function bound to the place where a machine may have it.

    Parameters
    ----------
    function
        The effect function.
    junction
        Name of the junction at which it acts.
    scale
        Effort and flow there, which scale the bounds of its parameters.

    Raises
    ------
    OptionError
        When it is added to a graph where it makes no sense at that junction.

    Examples
    --------
    >>> from bondgraph.declare.domains import TRANSLATION
    >>> from bondgraph.effects import quadratic_loss
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body", TRANSLATION)
    >>> acting_at(quadratic_loss, "body", Scale(100.0, 10.0))(g)
    >>> [parameter.name for parameter in g.parameters]
    ['c_quadratic_loss_body']
    """

    def extend(graph: BondGraph) -> None:
        if function(graph, Place(handle(graph, junction), scale)) is None:
            raise OptionError(
                f"{graph.name}: {function.__name__} makes no sense at {junction} - take another place",
                where=(function.__name__, junction),
            )

    return extend


def with_effects(graph: BondGraph, effects: Mapping[str, Extension], names: Sequence[str]) -> BondGraph:
    """The graph, extended by the named effects in the order in which they are named.

    Raises
    ------
    OptionError
        If an effect is not known; nothing is added then.

    Examples
    --------
    >>> from vehicle_graphs.driveline import driveline
    >>> from bondgraph.effects import constant_effort, viscous_loss
    >>> crank = Scale(100.0, 300.0)
    >>> effects = {name: acting_at(function, "primary", crank)
    ...            for name, function in (("load", constant_effort), ("drag", viscous_loss))}
    >>> [parameter.name for parameter in with_effects(driveline(), effects, ["drag"]).parameters][-1]
    'c_viscous_loss_primary'
    """
    refuse_unknown(graph.name, effects, names)
    for name in names:
        effects[name](graph)
    return graph


def refuse_unknown(machine: str, effects: Iterable[str], names: Sequence[str]) -> None:
    """Refuse names that are no effect of a machine.

    Raises
    ------
    OptionError
        If one is not among the effects; the nearest that is, is suggested.

    Examples
    --------
    >>> refuse_unknown("sled", ["drag", "load"], ["drga"])
    Traceback (most recent call last):
        ...
    bondgraph.errors.OptionError: sled: no effect 'drga'; did you mean 'drag'?
    """
    known = tuple(effects)
    for name in names:
        if name not in known:
            raise OptionError(f"{machine}: no effect {name!r}{suggest(name, known)}", where=(name,))
