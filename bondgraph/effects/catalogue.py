"""The table of all effects: names in each domain, laws, units of coefficients, references, manoeuvres that show them.

It is made by offering every effect function to the benches, so that it says what the functions do. An effect that is
called the same in several domains stands in the table once.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import pkgutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import ModuleType

import bondgraph.effects as dictionary
from bondgraph.declare.editing import copy
from bondgraph.declare.effect import Effect, EffectFunction, Place, effect_functions, is_for
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.benches import BENCHES, Bench
from bondgraph.effects.sensors import SENSOR_FAULTS
from bondgraph.errors import OptionError, suggest

#: Unit of a coefficient that has another one in each domain.
_BY_DOMAIN = "by domain"
#: Where an effect acts, by what is offered to its function.
_ANYWHERE = {"0": "0-junction", "1": "1-junction"}


@dataclass(frozen=True)
class Coefficient:
    """A parameter of a law without the names of effect and place; ``shape``: it means nothing without the law."""

    name: str
    unit: str
    meaning: str
    shape: bool


@dataclass(frozen=True)
class Entry:
    """One row of the table.

    ``name`` is that of the law in ``domains``, ``function`` the effect function in ``module``; ``default``: it is tried
    where nothing else is said. ``place`` is the kind of place at which it acts.
    """

    name: str
    function: str
    module: str
    domains: tuple[str, ...]
    place: str
    meaning: str
    law: str
    coefficients: tuple[Coefficient, ...]
    dissipative: bool
    reference: str
    manoeuvre: str
    default: bool

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coefficients, without shapes."""
        return tuple(one.unit for one in self.coefficients if not one.shape)


@functools.cache
def modules() -> tuple[ModuleType, ...]:
    """The modules of the package that define effects."""
    found = pkgutil.iter_modules(dictionary.__path__, f"{dictionary.__name__}.")
    loaded = (importlib.import_module(one.name) for one in found if one.name.rpartition(".")[2] not in _NO_EFFECTS)
    return tuple(module for module in loaded if effect_functions(module))


#: Modules of the package without effects of their own.
_NO_EFFECTS = ("benches", "catalogue", "places")


def every_effect() -> dict[str, EffectFunction]:
    """All effect functions of the package by name: those that are tried by default first, in their order.

    Examples
    --------
    >>> list(every_effect())[0], "shear_thinning_loss" in every_effect()
    ('coulomb_loss', True)
    """
    found = {function.__name__: function for function in (*effect_functions(dictionary), *SENSOR_FAULTS)}
    for module in modules():
        found |= {one.__name__: one for one in effect_functions(module) if one.__name__ not in found}
    return found


@functools.cache
def catalogue() -> tuple[Entry, ...]:
    """The rows of the table, those of one function together.

    Examples
    --------
    >>> [one.name for one in catalogue() if one.function == "quadratic_loss"]
    ['quadratic_loss', 'orifice_loss']
    """
    benches = {domain: make() for domain, make in BENCHES.items()}
    default = frozenset((*effect_functions(dictionary), *SENSOR_FAULTS))
    rows: list[Entry] = []
    for function in every_effect().values():
        own: dict[str, Entry] = {}
        for domain, bench in benches.items():
            for entry in _entries(function, domain, bench, function in default):
                known = own.get(entry.name)
                own[entry.name] = entry if known is None else _also_in(known, entry)
        rows += own.values()
    return tuple(rows)


def named(name: str) -> tuple[Entry, ...]:
    """The rows of an effect by the name of its function or its name in a domain.

    Raises
    ------
    OptionError
        If there is none.

    Examples
    --------
    >>> [one.function for one in named("relief_valve")]
    ['relief']
    """
    rows = catalogue()
    found = tuple(one for one in rows if name in (one.name, one.function))
    if not found:
        known = sorted({known for one in rows for known in (one.name, one.function)})
        raise OptionError(
            f"effects {name}: no effect of this name{suggest(name, known)} - bondgraph effects lists them",
            where=(name,),
        )
    return found


def added(function: EffectFunction, bench: Bench) -> Iterator[tuple[Place, Effect, BondGraph]]:
    """The places of a bench that take an effect, what it added there, and the graph with it."""
    for place in bench.places:
        graph = copy(bench.graph)
        effect = function(graph, place) if is_for(function, place) else None
        if effect is not None:
            yield place, effect, graph


def _entries(function: EffectFunction, domain: str, bench: Bench, default: bool) -> Iterator[Entry]:
    """One row for each name that an effect has at the places of a bench."""
    seen: set[str] = set()
    for place, effect, graph in added(function, bench):
        if effect.name in seen or (domain != "mechanical" and place.output):
            continue
        seen.add(effect.name)
        yield Entry(
            effect.name, function.__name__, function.__module__, (_domain(place, domain),), _where(place),
            inspect.getdoc(function) or "", effect.law, _coefficients(effect, place, graph), effect.dissipative,
            effect.reference, effect.manoeuvre, default,
        )  # fmt: skip


def _domain(place: Place, domain: str) -> str:
    """The word for a place's domain; sensors have none of their own."""
    if place.output:
        return "every"
    own = place.domain.name if place.domain else domain
    return domain if own in ("rotation", "translation") else own


def _where(place: Place) -> str:
    if place.output:
        return "sensor"
    if place.other is not None:
        return f"two {_ANYWHERE[place.junction.kind]}s"
    return "bond" if place.bond is not None else _ANYWHERE[place.junction.kind]


def _also_in(known: Entry, entry: Entry) -> Entry:
    coefficients = tuple(
        one if one.unit == other.unit else replace(one, unit=_BY_DOMAIN)
        for one, other in zip(known.coefficients, entry.coefficients, strict=True)
    )
    domains = tuple(dict.fromkeys((*known.domains, *entry.domains)))
    return replace(known, domains=domains, coefficients=coefficients)


def _stem(name: str, effect: Effect, place: Place) -> str:
    """What a parameter is called without its effect and place."""
    return name.removesuffix(f"_{place.name}").removesuffix(f"_{effect.name}")


def _coefficients(effect: Effect, place: Place, graph: BondGraph) -> tuple[Coefficient, ...]:
    declared: Mapping[str, tuple[str, str]] = {one.name: (one.unit, one.meaning) for one in graph.parameters}
    return tuple(
        Coefficient(_stem(name, effect, place), *declared[name], name in effect.shapes) for name in effect.parameters
    )
