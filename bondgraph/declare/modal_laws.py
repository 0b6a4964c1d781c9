"""What a resistance with modes (dry friction, impact) declares in place of its effort, and in which units."""

from __future__ import annotations

from collections.abc import Collection

from bondgraph.errors import DeclarationError
from bondgraph.units import Dimension

#: Laws of a resistance with modes, and which of its own variables each may use.
MODAL_LAWS: dict[str, tuple[str, ...]] = {
    "capacity": ("flow",), "static": (), "gap": (), "restitution": (), "stiffness": (), "damping": (), "width": (),
}  # fmt: skip
_COMPLETE = (
    ({"capacity", "width"}, {"static"}),
    ({"gap", "restitution", "stiffness", "width"}, {"damping"}),
)


def is_modal(given: Collection[str]) -> bool:
    """Whether a node gives laws of an element with modes.

    Examples
    --------
    >>> is_modal(["capacity", "width"]), is_modal(["effort"])
    (True, False)
    """
    return not MODAL_LAWS.keys().isdisjoint(given)


def check_modal(name: str, given: Collection[str], where: str) -> None:
    """Raise DeclarationError unless what a node with modes gives are all laws of a friction, or all of an impact."""
    given = set(given)
    if not is_modal(given) or any(needed <= given <= needed | extra for needed, extra in _COMPLETE):
        return
    raise DeclarationError(
        f"{where}: an R with modes gives capacity and width (and static) of dry friction, or gap, restitution, "
        f"stiffness and width (and damping) of an impact, but this one gives {', '.join(sorted(given))}",
        where=(name,),
    )


def modal_dimension(
    given: str, is_impact: bool, effort: Dimension | None, flow: Dimension | None, displacement: Dimension | None
) -> Dimension | None:
    """The dimension that a law of an element with modes must have, None where it is not known.

    Examples
    --------
    >>> from bondgraph.units import dimension
    >>> stiffness = modal_dimension("stiffness", True, dimension("N"), dimension("m/s"), dimension("m"))
    >>> stiffness == dimension("N/m")
    True
    """
    if effort is None or flow is None or displacement is None:
        return None
    parts = {
        "capacity": (effort,), "static": (effort,), "restitution": (), "gap": (displacement,),
        "stiffness": (effort, _inverse(displacement)),
        "damping": (effort, _inverse(displacement), _inverse(flow)),
        "width": (displacement if is_impact else flow,),
    }[given]  # fmt: skip
    return tuple(sum(exponents) for exponents in zip(_inverse(effort), effort, *parts, strict=True))


def _inverse(value: Dimension) -> Dimension:
    return tuple(-exponent for exponent in value)
