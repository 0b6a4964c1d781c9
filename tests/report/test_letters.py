"""Letters of laws: every constant in the text of a law has its value, and springs that soften are said to."""

from __future__ import annotations

import re

import pytest

from bondgraph.build import build
from bondgraph.effects.benches import BENCHES
from bondgraph.effects.catalogue import added, every_effect
from bondgraph.report.collect import found_effect
from bondgraph.report.series import FoundEffect


def _found(name: str, domain: str, value: float = 0.01) -> FoundEffect:
    """The first place of a bench that takes an effect, with coefficients of a size."""
    place, effect, graph = next(iter(added(every_effect()[name], BENCHES[domain]())))
    known = dict.fromkeys(effect.coefficients, value)
    ends = dict.fromkeys(effect.parameters, (0.9999 * value, 1.0001 * value))
    values = {one.name: one.value for one in graph.flatten().parameters} | known
    return found_effect(effect, place, build(graph).model, values, ends)


@pytest.mark.parametrize(("name", "domain", "words"), [
    ("convection", "thermal", ("e = ", " K", "w = ")),
    ("orifice_leak", "hydraulic", ("e = ", " Pa")),
    ("ripple", "mechanical", ("a = sine_ripple_", "b = cosine_ripple_", "n = ")),
    ("directional_loss", "mechanical", ("a = drive_directional_loss_", "b = overrun_directional_loss_", "w = ")),
    ("coulomb_loss", "mechanical", ("w = ",)),
    ("headwind", "mechanical", ("drag at flow + w",)),
])  # fmt: skip
def test_every_letter_of_a_law_is_told(name: str, domain: str, words: tuple[str, ...]) -> None:
    """The law of a convection had a w of which nobody learned, the ripple of a motor no order."""
    told = _found(name, domain).law
    assert all(word in told for word in words), told
    assert len(re.findall(r"\bw = ", told)) == ("w = " in words)


def test_a_shape_that_rests_on_the_end_of_its_range_is_said_to() -> None:
    """Of a ceiling "n = 2.00 [2.00, 2.25]" was told, and not that no smaller n is looked for."""
    place, effect, graph = next(iter(added(every_effect()["actuator_ceiling"], BENCHES["mechanical"]())))
    model = build(graph).model
    shape = model.parameters[model.index("parameter", effect.shapes[0])]
    values = {one.name: one.value for one in graph.flatten().parameters}
    ends = {shape.name: (shape.lower or 0.0, 1.1 * shape.value)}
    for value, words in ((shape.lower, "the least that is tried"), (shape.upper, "the most that is tried")):
        told = found_effect(effect, place, model, values | {shape.name: value or 0.0}, ends).law
        assert words in told
    middle = values | {shape.name: 1.5 * (shape.lower or 0.0)}
    assert "that is tried" not in found_effect(effect, place, model, middle, ends).law


def test_a_stiffening_spring_with_a_negative_coefficient_is_said_to_soften() -> None:
    """An isolator that softens was called a progressive spring without a word."""
    assert _found("progressive_spring", "mechanical", -0.01).law.endswith("(c is negative: it softens as it deflects)")
    assert "softens" not in _found("progressive_spring", "mechanical").law
    assert "softens" not in _found("quadratic_loss", "mechanical", -0.01).law
