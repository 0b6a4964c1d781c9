"""Effects: physics that a graph lacks, as functions that extend it.

An effect function takes a graph and a place, adds the elements of its law with their parameters, and says what it
added; where it makes no physical sense it returns None and leaves the graph alone. There is no registry: any public
function of a module with the signature ``(BondGraph, Place) -> Effect | None`` is a candidate.

The coefficients of an effect are parameters whose value is zero when it is added: with all of them zero the graph
behaves as before, so that a candidate can be tested before it is believed. An effect that brings a storage of its own
(``adds_state``) cannot vanish in this way; it is tried by refitting.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import get_type_hints

from bondgraph.declare.domains import Domain
from bondgraph.declare.elements import Bond
from bondgraph.declare.graph import BondGraph, Handle


@dataclass(frozen=True)
class Scale:
    """How large effort and flow are at a place, in SI units; coefficients take their bounds from it."""

    effort: float
    flow: float


@dataclass(frozen=True)
class Place:
    """Where an effect may be added: a junction, or a bond between two nodes (then ``junction`` is its tail)."""

    junction: Handle
    scale: Scale
    bond: Bond | None = None

    @property
    def name(self) -> str:
        """Name of the junction, or ``a_b`` for the bond a -> b; dots of parts become underscores."""
        name = self.junction.name if self.bond is None else f"{self.bond.source}_{self.bond.target}"
        return name.replace(".", "_")

    @property
    def label(self) -> str:
        """The place as a person reads it."""
        return self.junction.name if self.bond is None else str(self.bond)

    @property
    def domain(self) -> Domain | None:
        """The energy domain there, None where it is not declared."""
        return self.junction.domain


@dataclass(frozen=True)
class Effect:
    """What an effect function added.

    ``name`` is the kind of effect, ``element`` the added element, ``law`` its law as text, ``coefficients`` the
    parameters that are zero when the effect is absent. ``adds_state``: the effect brings a storage of its own.
    """

    name: str
    element: str
    law: str
    coefficients: tuple[str, ...]
    adds_state: bool = False


EffectFunction = Callable[[BondGraph, Place], Effect | None]


def effect_functions(module: ModuleType) -> tuple[EffectFunction, ...]:
    """The effect functions of a module, in order of definition.

    Examples
    --------
    >>> import types
    >>> module = types.ModuleType("effects")
    >>> def no_effect(graph: BondGraph, place: Place) -> Effect | None: ...
    >>> no_effect.__module__ = "effects"
    >>> module.no_effect = no_effect
    >>> [function.__name__ for function in effect_functions(module)]
    ['no_effect']
    """
    found = []
    for name, function in vars(module).items():
        if name.startswith("_") or not inspect.isfunction(function) or function.__module__ != module.__name__:
            continue
        hints = get_type_hints(function, vars(module) | globals())
        if hints.get("return") == Effect | None and len(inspect.signature(function).parameters) == 2:
            found.append(function)
    return tuple(found)
