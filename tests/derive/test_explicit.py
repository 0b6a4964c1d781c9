"""Explicit equations as other programs read them: closed where they can be, in pieces where they would not end."""

from __future__ import annotations

from typing import Any

import pytest
import sympy

from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation
from bondgraph.derive.explicit import equations_json, equations_text
from bondgraph.report.evaluate import evaluate
from tests.derive.textbook.case import graph_file


def ladder(stages: int) -> BondGraph:
    """A ladder of resistances without storages between them: one linear loop through all of them."""
    numbers = range(stages)
    nodes = "u Se effort: u\nend 1\nC C effort: displacement/C\n" + "\n".join(
        f"j{i} 1\nA{i} R effort: A{i}*flow\nz{i} 0\nB{i} R effort: B{i}*flow" for i in numbers
    )
    chain = (f"{f'z{i - 1}' if i else 'u'}>j{i} j{i}>A{i} j{i}>z{i} z{i}>B{i}" for i in numbers)
    bonds = " ".join([*chain, f"z{stages - 1}>end end>C"])
    values = " ".join(f"A{i}={1 + i / 10} B{i}={2 + i / 7}" for i in numbers)
    return graph_from_json(graph_file("ladder", nodes, bonds, f"C=1 {values}", "u"))


def printed(graph: BondGraph) -> dict[str, Any]:
    derivation = Derivation(assign_causality(graph))
    return equations_json(derivation, derivation.equations())


@pytest.mark.parametrize(("stages", "pieces"), [(4, False), (25, True)])
def test_linear_loops_of_any_size_are_printed_in_a_length_that_can_be_read(stages: int, pieces: bool):
    graph = ladder(stages)
    found = printed(graph)
    assert bool(found["implicit"]) is pieces
    assert sum(map(len, found["derivatives"].values())) < 20_000
    values = dict(found["parameters"]) | {"u": 2.0, "q_C": 0.3}
    for piece in found["implicit"]:
        (name,), (residual,) = piece["unknowns"], piece["residuals"]
        at_zero = sympy.sympify(residual, locals={used: sympy.Float(v) for used, v in values.items()} | {name: 0})
        values[name] = -float(at_zero)
    rate = sympy.sympify(found["derivatives"]["q_C"], locals={used: sympy.Float(v) for used, v in values.items()})
    exact = evaluate(graph, [{"states": {"displacement(C)": 0.3}, "inputs": {"u": 2.0}}])[0]["derivatives"]
    assert float(rate) == pytest.approx(exact["displacement(C)"], rel=1e-9)


def test_the_text_of_a_large_loop_ends_too():
    derivation = Derivation(assign_causality(ladder(25)))
    assert len(equations_text(derivation, derivation.equations())) < 500_000
