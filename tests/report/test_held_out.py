"""Held-out logs: what a log that a model cannot follow says in a file."""

from __future__ import annotations

import json
import math

from bondgraph.report.held_out import HeldOutLog


def test_numbers_that_do_not_exist_are_null() -> None:
    """An estimate that had failed ended in a traceback where a log was held out: bands were no JSON."""
    nothing = math.nan
    told = HeldOutLog("run", nothing, math.inf, nothing, (nothing, nothing)).to_dict()
    assert json.loads(json.dumps(told, allow_nan=False)) == {
        "log": "run", "declared_nll": None, "nll": None, "nis_mean": None, "nis_band": [None, None], "channels": {},
    }  # fmt: skip
