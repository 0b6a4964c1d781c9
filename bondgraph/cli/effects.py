"""Which effects a loop tries, as options of a command line say it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import ModuleType

from bondgraph.cli.values import names
from bondgraph.declare.effect import EffectFunction, effect_functions
from bondgraph.declare.loading import load_module, split_reference
from bondgraph.effects.catalogue import catalogue, every_effect
from bondgraph.effects.sensors import SENSOR_FAULTS
from bondgraph.errors import DeclarationError, OptionError, suggest
from bondgraph.text import few, inflected

#: The effects that are tried where nothing else is said, and whose names may be given alone.
SHIPPED = "bondgraph.effects"


def chosen_effects(given: Sequence[str], without: Sequence[str] = ()) -> tuple[EffectFunction, ...]:
    """The functions of ``--effects``, less those of ``--without``.

    Parameters
    ----------
    given
        Modules or files of effect functions, single functions of them (``module:name``, ``FILE.py:name``), or names of
        shipped ones, of the function or in the words of a domain.
    without
        Names of what is left out; those of sensor faults are known too.

    Raises
    ------
    OptionError
        If a module, file or name does not exist, or nothing is left.

    Examples
    --------
    >>> [one.__name__ for one in chosen_effects(["backlash", "bondgraph.effects:creep"])]
    ['backlash', 'creep']
    >>> [one.__name__ for one in chosen_effects(["heat_bridge"])]  # as `bondgraph effects` lists it
    ['leak_between']
    """
    found = {function: None for one in names(given) for function in _functions(one)}
    known = {one.__name__ for one in (*found, *SENSOR_FAULTS)}
    left_out = {own for name in names(without) for own in ([name] if name in known else _called(name) or [name])}
    for name in sorted(left_out - known):
        raise OptionError(
            f"--without {name}: no effect of this name is tried{suggest(name, known)} - those tried are "
            f"{', '.join(sorted(known))}",
            where=("--without", name),
        )
    kept = tuple(one for one in found if one.__name__ not in left_out)
    if not kept:
        raise OptionError("--without leaves no effect to try - leave out fewer", where=("--without",))
    return kept


def without_place(given: Sequence[str], known: Collection[str]) -> str:
    """A sentence on effects that ``--effects`` names one by one and that have no place in a machine; empty without any.

    ``known`` are the names of those that were tried or refused there.

    Examples
    --------
    >>> without_place(["bondgraph.effects", "creep", "backlash"], {"creep"})
    'backlash finds no place in this machine - bondgraph effects backlash says where to look'
    """
    named = [own[0].__name__ for one in names(given) if len(own := _functions(one)) == 1]
    silent = list(dict.fromkeys(name for name in named if name not in known))
    if not silent:
        return ""
    verb = inflected(silent, "finds", "find")
    return f"{few(silent)} {verb} no place in this machine - bondgraph effects {' '.join(silent)} says where to look"


def _functions(reference: str) -> tuple[EffectFunction, ...]:
    place, name = split_reference(reference)
    shipped = _by_name(_module(SHIPPED)) if reference.isidentifier() else {}
    if not name and reference in shipped:
        return (shipped[reference],)
    try:
        functions = _by_name(_module(reference, shipped))
    except OptionError:
        alike = _called(reference)
        if not alike:
            raise
        return tuple(every_effect()[one] for one in alike)
    if not functions:
        raise OptionError(
            f"--effects {reference}: {place} has no effect functions - they take a graph and a Place and are declared "
            "to return Effect | None",
            where=("--effects", reference),
        )
    if not name:
        return tuple(functions.values())
    if name not in functions:
        raise OptionError(
            f"--effects {reference}: {place} has no effect function {name!r}{suggest(name, functions)} - it has "
            f"{', '.join(functions)}",
            where=("--effects", reference),
        )
    return (functions[name],)


def _called(name: str) -> list[str]:
    """Functions of the shipped effects that have a name in the words of a domain; none where no domain has it."""
    return list(dict.fromkeys(one.function for one in catalogue() if one.name == name))


def _by_name(module: ModuleType) -> dict[str, EffectFunction]:
    return {one.__name__: one for one in effect_functions(module)}


def _module(reference: str, shipped: Mapping[str, EffectFunction] | None = None) -> ModuleType:
    try:
        return load_module(reference)
    except DeclarationError as error:
        hint = suggest(reference, [*shipped, *(one.name for one in catalogue())]) if shipped else ""
        message = f"--effects {error.message}{hint and f'{hint}, a shipped effect'}"
        raise OptionError(message, where=("--effects", reference)) from None
