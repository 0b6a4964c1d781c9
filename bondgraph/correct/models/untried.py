"""Effects that were tried nowhere, and why: a law that a graph refuses, or a kind of place that no effect is for."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from bondgraph.correct.models.candidates import Refused
from bondgraph.declare.effect import EffectFunction, Place, is_for


def refused_everywhere(refused: Sequence[Refused], tried: Collection[str]) -> list[str]:
    """A sentence on every effect that was refused wherever it was offered; ``tried`` names those that were not.

    Examples
    --------
    >>> no = Refused("overflow", "tank", "compares Pa and 1")
    >>> refused_everywhere([no, Refused("creep", "belt", "closes a loop")], {"creep"})
    ['overflow could be tried nowhere: at tank: compares Pa and 1']
    """
    first: dict[str, Refused] = {}
    for one in refused:
        if one.effect not in tried:
            first.setdefault(one.effect, one)
    places = {name: sum(one.effect == name for one in refused) - 1 for name in first}
    return [
        f"{name} could be tried nowhere: at {one.place}: {one.why}{f' ({places[name]} more)' if places[name] else ''}"
        for name, one in first.items()
    ]


def nothing_to_try(where: Sequence[Place], functions: Sequence[EffectFunction], refused: Sequence[Refused]) -> str:
    """Why no effect could be tried at any place: what the places are, and what the effect functions said to them."""
    own = [place for place in where if not place.output]
    asked = [one.__name__ for one in functions if any(is_for(one, place) for place in own)]
    known = {one.effect for one in refused}
    silent = [name for name in asked if name not in known]
    kinds = sorted({place.domain.name if place.domain else "undeclared" for place in own})
    said = [f"{', '.join(silent)} found nothing to act on at {_listed(own)} ({', '.join(kinds)})"] if silent else []
    said += refused_everywhere(refused, ())
    return (
        f"no effect could be tried at any of {len(own)} places, so that only what stays unexplained was looked for: "
        f"{'; '.join(said) or 'none was offered'} - give effect functions for these places with --effects"
    )


def _listed(where: Sequence[Place], most: int = 4) -> str:
    names = [place.label for place in where]
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
