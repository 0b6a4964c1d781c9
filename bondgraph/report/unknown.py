"""Sentences on what no law explains: its shape over the signal it depends on, and what its sign means."""

from __future__ import annotations

from bondgraph.correct.places.unexplained import Unexplained
from bondgraph.report.numbers import shown

#: Meaning of a positive value of the unknown, by its variable: a source of minus that value stands at the junction.
_SIGNS = {
    "effort": "Positive values take power from a positive flow there, as a brake does; negative ones drive it.",
    "flow": "Positive values flow out of the junction, as through a leak; negative ones flow into it.",
    "sensor": "Positive values are what the sensor shows too much.",
}


def shape_sentence(one: Unexplained) -> str:
    """The shape of what stays unexplained with the meaning of its sign, in words that a terminal can show."""
    points = "; ".join(
        f"{shown(float(value))} ± {shown(float(std))} at {shown(float(knot))}"
        for knot, value, std in zip(one.knots, one.values, one.std, strict=True)
    )
    unit, over = (f" [{text}]" if text else "" for text in (one.unit, one.signal_unit))
    return (
        f"The unknown {one.variable} at {one.place.label}{unit} over {one.signal}{over}, less what "
        f"{' and '.join(one.taken) or 'free parameters'} can take of it: {points}. {_SIGNS[one.variable]}"
    )
