"""Files spoiled at random and random laws: each ends in equations that load or in a message, soon and in little memory.

A longer search: ``python -m tests.derive.test_fuzz lawful 600 2000`` (kind, seconds, first seed).
"""

from __future__ import annotations

import json
import sys

import pytest

from bondgraph.errors import BondGraphError
from tests.derive import fuzzed_graphs
from tests.derive.fuzzed_graphs import worked_through
from tests.limited import Findings, mutants, survey

#: Seeds that the suite repeats; the command goes on from there.
MOST = {"spoiled": 20_000, "lawful": 2_000}


def _search(kind: str, seconds: float, first: int = 0, most: int | None = None) -> Findings:
    made = mutants(getattr(fuzzed_graphs, kind), kind, seconds, first, most)
    return survey("tests.derive.fuzzed_graphs:worked_through", made)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["spoiled", "lawful"])
def test_nothing_but_equations_and_messages(kind: str) -> None:
    found = _search(kind, 80.0, most=MOST[kind])
    print(found)
    assert found.counts["clean"] and found.counts["refused"]
    assert not found.bad, "\n\n".join(f"{problem}\n{given}" for given, problem in found.bad[:3])


@pytest.mark.parametrize("label", fuzzed_graphs.FOUND)
def test_what_was_found_stays_mended(label: str) -> None:
    try:
        worked_through(json.dumps(fuzzed_graphs.FOUND[label]))
    except BondGraphError as error:
        assert len(error.message) < 3000


def test_the_survey_tells_how_each_input_ended() -> None:
    found = survey(
        "tests.derive.test_fuzz:_misbehaving", ["fine", "own", "foreign", "sleep", "memory", "die"], 2.0, 4 << 30
    )
    kinds = [problem.partition(":")[0] for _, problem in found.bad]
    assert found.counts == {"clean": 1, "refused": 1, "foreign": 1, "hang": 1, "memory": 1, "crash": 1}
    assert kinds == ["foreign", "hang", "memory", "crash"]


def _misbehaving(how: str) -> None:
    import os
    import time

    actions = {
        "fine": lambda: None, "sleep": lambda: time.sleep(60), "memory": lambda: bytearray(8 << 30),
        "die": lambda: os._exit(3), "foreign": lambda: [][1],
    }  # fmt: skip
    if how == "own":
        raise BondGraphError("no")
    actions[how]()


if __name__ == "__main__":
    result = _search(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]))
    print(result, *(f"{problem}\n{given}" for given, problem in result.bad), sep="\n\n")
