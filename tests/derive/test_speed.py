"""Work grows with the size of a graph and not faster, counted in calls; bench_derivation.py measures seconds."""

from __future__ import annotations

import sys
from types import FrameType

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.derive.equations import StateEquations
from bondgraph.generate.module import render


def chain(stages: int) -> BondGraph:
    """Masses in a row, joined by springs and dampers."""
    g = BondGraph("chain")
    before = g.one_junction("wall", TRANSLATION)
    g.flow_source("still", 0, at=before)
    for i in range(stages):
        joint, stretch = g.zero_junction(f"joint_{i}", TRANSLATION), g.one_junction(f"stretch_{i}", TRANSLATION)
        body = g.one_junction(f"body_{i}", TRANSLATION)
        g.bond(before, joint)
        g.bond(joint, stretch)
        g.bond(joint, body)
        g.inertance(f"mass_{i}", g.parameter(f"m_{i}", 1.0, "kg"), at=body)
        g.compliance(f"spring_{i}", g.parameter(f"k_{i}", 1.0, "N/m"), at=stretch)
        g.resistance(f"damper_{i}", g.parameter(f"d_{i}", 1.0, "N s/m"), at=stretch)
        before = body
    return g


def work(stages: int) -> tuple[int, StateEquations]:
    """Calls of functions between a declared graph and its text, and the equations."""
    graph, calls = chain(stages), 0

    def count(_frame: FrameType, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event == "call"

    sys.setprofile(count)
    try:
        equations = derive(assign_causality(graph))
        check_dimensions(equations)
        render(equations)
    finally:
        sys.setprofile(None)
    return calls, equations


def test_twice_the_stages_are_twice_the_work():
    work(2)
    (calls, small), (more_calls, large) = work(20), work(40)
    assert more_calls < 2.2 * calls
    assert len(large.assignments) <= 2 * len(small.assignments) + 2


def test_equations_of_a_stage_do_not_depend_on_the_number_of_stages():
    _, small = work(10)
    _, large = work(30)
    operations = [max(value.count_ops() for value in equations.derivatives) for equations in (small, large)]
    assert operations[0] == operations[1]
