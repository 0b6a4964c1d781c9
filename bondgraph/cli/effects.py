"""Which effects a loop tries, as options of a command line say it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import ModuleType

from bondgraph.cli.values import names
from bondgraph.declare.effect import EffectFunction, effect_functions
from bondgraph.declare.loading import load_module, split_reference
from bondgraph.effects.sensors import SENSOR_FAULTS
from bondgraph.errors import DeclarationError, OptionError, suggest

#: The effects that are tried where nothing else is said, and whose names may be given alone.
SHIPPED = "bondgraph.effects"


def chosen_effects(given: Sequence[str], without: Sequence[str] = ()) -> tuple[EffectFunction, ...]:
    """The functions of ``--effects``, less those of ``--without``.

    Parameters
    ----------
    given
        Modules or files of effect functions, single functions of them (``module:name``, ``FILE.py:name``), or names of
        shipped ones.
    without
        Names of functions that are left out; those of sensor faults are known too.

    Raises
    ------
    OptionError
        If a module, file or name does not exist, or nothing is left.

    Examples
    --------
    >>> [one.__name__ for one in chosen_effects(["backlash", "bondgraph.effects:creep"])]
    ['backlash', 'creep']
    """
    found = {function: None for one in names(given) for function in _functions(one)}
    left_out = set(names(without))
    known = {one.__name__ for one in (*found, *SENSOR_FAULTS)}
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


def _functions(reference: str) -> tuple[EffectFunction, ...]:
    place, name = split_reference(reference)
    shipped = _by_name(_module(SHIPPED)) if reference.isidentifier() else {}
    if not name and reference in shipped:
        return (shipped[reference],)
    functions = _by_name(_module(reference, shipped))
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


def _by_name(module: ModuleType) -> dict[str, EffectFunction]:
    return {one.__name__: one for one in effect_functions(module)}


def _module(reference: str, shipped: Mapping[str, EffectFunction] | None = None) -> ModuleType:
    try:
        return load_module(reference)
    except DeclarationError as error:
        hint = suggest(reference, shipped or {})
        message = f"--effects {error.message}{hint and f'{hint}, a shipped effect'}"
        raise OptionError(message, where=("--effects", reference)) from None
