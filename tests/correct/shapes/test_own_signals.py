"""Formulas in a signal of their own place: refitted beside others that promise a little more."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bondgraph.correct.shapes import offered
from bondgraph.correct.shapes.library import Kind, Term
from bondgraph.correct.shapes.subsets import Sum
from bondgraph.declare.quantities import symbol

_RAMP = Kind("ramp_above", (symbol("x"),), 1, "threshold")


def ramp(signal: str, gain: float) -> Sum:
    return Sum((Term(_RAMP, (signal,), ("K",), 300.0),), np.ones(1), gain, gain - 10.0)


@pytest.mark.parametrize(
    ("promised", "found"), [(72.7, ["effort of absorber"]), (40.0, []), (12.0, [])], ids=["about", "half", "little"]
)
def test_the_best_term_of_the_place_is_offered_where_it_promises_about_as_much(
    promised: float, found: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A collector lost heat above its own temperature; a ramp of its store's was offered alone, 2 nats ahead of 75."""
    sums = [ramp("effort of store", 74.5), ramp("effort of absorber", promised), ramp("flow of absorber", 74.0)]
    monkeypatch.setattr(offered, "best_sums", lambda *_: sums)
    junction = SimpleNamespace(name="absorber", kind="0")
    terms: Any = SimpleNamespace(
        terms=(), probe=SimpleNamespace(place=SimpleNamespace(label="absorber", junction=junction))
    )
    left: Any = SimpleNamespace(built=SimpleNamespace(causal=SimpleNamespace(graph=SimpleNamespace(bonds=()))))
    free: Any = SimpleNamespace(gain=20.0, knots=np.zeros(3))
    own = offered._own(terms, sums[:1], left, free, 1000)
    assert [one.terms[0].signals[0] for one in own] == found
    assert offered._own(terms, sums, left, free, 1000) == []  # it is among those already
