"""Letters of a law: the value and unit of each constant in its text, and what a negative coefficient means."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from bondgraph.declare.effect import Effect, Place
from bondgraph.report.numbers import shown, with_ends
from bondgraph.report.series import Coefficient
from bondgraph.simulate.model import Model
from bondgraph.simulate.quantities import ParameterInfo

#: Letters that stand in laws for parameters whose names begin with other ones.
_LETTERS = {
    "sine": "a", "cosine": "b", "order": "n", "drive": "a", "overrun": "b", "share": "c", "inertia": "c", "length": "s",
    "magnitude": "s", "delay": "T", "sharpness": "n",
}  # fmt: skip
#: The same of single laws, by their names: half of a play is b in one and g in others.
_OF_EFFECT = {
    ("backlash", "gap"): "b", ("clearance", "gap"): "b", ("dead zone", "dead"): "b", ("stepped_tank", "level"): "g",
}  # fmt: skip
#: Springs that get stiffer with their deflection, which a negative coefficient turns round.
_STIFFENING = (
    "progressive_spring", "hardening_spring", "stiffening_volume", "tapered_tank", "voltage_dependent_capacitance",
    "charge_dependent_capacitance",
)  # fmt: skip
#: Share of its range within which an estimate rests on an end: of three digits that are told it changes none.
_AT_END = 1e-4


def constants(
    effect: Effect, place: Place, model: Model, values: Mapping[str, float], ci95: Mapping[str, tuple[float, float]]
) -> list[str]:
    """The other numbers in a law, as "T = 4.2 s [4.1, 4.3]": shapes as estimated, constants as declared.

    A coefficient that its law calls by another letter than its name begins with is told with it, without its value,
    which stands beside its name.
    """
    letters = set(re.findall(r"(?<![0-9.])[A-Za-z]+[0-9]*", effect.law))
    own = {name.partition("_")[2] for name in effect.coefficients}
    found, known = [], set()
    for info in model.parameters:
        name, _, of = info.name.partition("_")
        letter = _letter(effect, name, letters)
        if of not in own or letter not in letters:
            continue
        known.add(letter)
        if info.name not in effect.coefficients:
            found.append(f"{letter} = {_valued(info, values, ci95)}")
        elif not info.name.startswith(letter):
            found.append(f"{letter} = {info.name}")
    if "w" in letters - known and not effect.formula and not place.output:
        found.append(f"w = {shown(place.smoothing)}")  # the share over which laws are smoothed is a number of the place
    return found


def with_levels(effect: Effect, model: Model, values: Mapping[str, float]) -> str:
    """The text of a law, with values for the shapes that it calls by their full names: levels between which it acts."""
    infos = {name: model.parameters[model.index("parameter", name)] for name in effect.shapes}

    def told(found: re.Match[str]) -> str:
        info = infos.get(found.group())
        return found.group() if info is None else f"{shown(_value(info, values))}{_unit(info.display_unit)}"

    return re.sub(r"\w+", told, effect.law)


def _letter(effect: Effect, name: str, letters: set[str]) -> str:
    """The letter of a parameter in a law, by the first word of its name."""
    if name in letters:
        return name
    fixed = _OF_EFFECT.get((effect.kind or effect.name, name)) or _LETTERS.get(name, "")
    return fixed if fixed in letters else name[:1]


def _valued(info: ParameterInfo, values: Mapping[str, float], ci95: Mapping[str, tuple[float, float]]) -> str:
    value = _value(info, values)
    if info.name not in ci95:
        return f"{shown(value)}{_unit(info.display_unit)}"
    low, high = ci95[info.name]
    told = with_ends(value, (info.shown(low), info.shown(high)), info.display_unit)
    return f"{told}, the {_end(info, values)} that is tried" if _end(info, values) else told


def _value(info: ParameterInfo, values: Mapping[str, float]) -> float:
    """The value of a parameter as it is declared or estimated, in its declared unit."""
    return float(info.shown(values.get(info.name, info.value)))


def _end(info: ParameterInfo, values: Mapping[str, float]) -> str:
    """The end of its range on which a shape rests: "least", "most" or none."""
    value = values.get(info.name, info.value)
    if info.lower is None or info.upper is None:
        return ""
    near = _AT_END * (info.upper - info.lower)
    return "least" if value <= info.lower + near else "most" if value >= info.upper - near else ""


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


def softens(name: str, value: float) -> bool:
    """True for a law that is called stiffening and is not, by the sign of its coefficient."""
    return name in _STIFFENING and value < 0.0


def softening(name: str, coefficients: Sequence[Coefficient]) -> str:
    """Words on a law that is called stiffening and softens, by its first coefficient; empty of all others.

    Examples
    --------
    >>> softening("hardening_spring", [Coefficient("c", -3.0, "N/m^3", (-4.0, -2.0))])
    'c is negative: it softens as it deflects'
    >>> softening("hardening_spring", [Coefficient("c", 3.0, "N/m^3", (2.0, 4.0))])
    ''
    """
    turned = bool(coefficients) and softens(name, coefficients[0].value)
    return "c is negative: it softens as it deflects" if turned else ""
