"""A closed loop as a user holds it: from logs as read to graph, tables and report."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import bondgraph as bg
from bondgraph import effects
from bondgraph.build import build
from bondgraph.data.log import Log, LogChannel
from bondgraph.errors import OptionError
from tests.correct.sled import FUNCTIONS, added, pull, sled


def as_read(log: bg.MatchedLog) -> Log:
    """A log in the order of a model as it would be read from a file, in other units."""
    model, units = build(sled()).model, {"torque": ("kN m", 1e-3), "speed": ("km/h", 3.6), "force": ("kN", 1e-3)}
    rows = zip((*model.names("input"), *model.names("output")), (*log.u, *log.y), strict=True)
    channels = {name: LogChannel(name, units[name][0], units[name][1] * row) for name, row in rows}
    return Log(log.name, log.time, channels)


def test_a_log_that_is_trained_on_and_held_out_is_refused() -> None:
    """Before, only the command refused it; from Python the log confirmed what was found in it."""
    log = as_read(pull(sled(), 1))
    with pytest.raises(OptionError, match=r"to train and to holdout - a log that was trained on confirms nothing"):
        bg.close_loop(sled(), log, [log], FUNCTIONS)


@pytest.mark.slow
def test_parts_between_jumps_in_time_are_logs_of_their_own() -> None:
    """A radiator's law lost 222 nats by half an hour that was not logged, and was refused."""
    whole = as_read(pull(added(effects.quadratic_loss, "runner", 1.2), 1, samples=900))
    torn = whole.rows(np.r_[0:400, 600:900])
    closed = bg.close_loop(sled(), torn, effects=FUNCTIONS)
    assert [log.name for log in closed.nominal.problem.logs] == [f"{whole.name}.1", f"{whole.name}.2"]
    assert [one.trial.candidate.label for one in closed.added] == ["quadratic_loss at runner"]
    first, second = closed.nominal.problem.logs
    assert any(note.startswith("time jumps from") and note.endswith("across_gaps=True") for note in first.notes)
    assert not any("time jumps" in note for note in second.notes)
    across = bg.close_loop(sled(), torn, effects=FUNCTIONS, across_gaps=True)
    (log,) = across.nominal.problem.logs
    assert any("--split-gaps" in note for note in log.notes)


@pytest.mark.slow
def test_a_loop_is_closed_on_logs_as_they_are_read(tmp_path: Path) -> None:
    true = added(effects.quadratic_loss, "runner", 1.2)
    train, held_out = as_read(pull(true, 1)), as_read(pull(true, 2, name="later"))
    bg.write_log(tmp_path / "later.csv", held_out)
    loop = bg.close_loop(sled(), train, tmp_path / "later.csv", FUNCTIONS)
    assert loop.verdict == "effect found"
    assert len(repr(loop)) < 300 and "\n" not in repr(loop)  # it had 1.8 million characters
    assert repr(loop) == f"<Correction sled: effect found; added quadratic_loss at runner; {len(loop.rounds)} rounds>"
    for part in (loop.nominal, loop.rounds[0], loop.rounds[0].trials[0], loop.rounds[0].scored, loop.rounds[0].linear):
        assert len(repr(part)) < 300 and repr(part).startswith(f"<{type(part).__name__}")
    assert loop.graph == loop.corrected_graph and bg.build(loop.graph).text == loop.corrected_text
    assert "quadratic_loss at runner" in loop.summary() and len(loop.summary()) < 3000
    header, rows = loop.table()
    assert rows[0][0] == "training" and rows[-1][0] == "held out" and {len(row) for row in rows} == {len(header)}
    assert "<table>" in loop._repr_html_() and len(loop._repr_html_()) < 3000
    axes = loop.plot()
    assert axes.get_title() == "later" and [line.get_label() for line in axes.lines] == ["measured", "before", "after"]
    measured, *simulated = (np.asarray(line.get_ydata()) for line in axes.lines)
    before, after = (float(np.sqrt(np.nanmean((one - measured) ** 2))) for one in simulated)
    assert after < 0.5 * before
    table = loop.to_dataframe()
    (name,) = loop.added[0].coefficients
    assert np.isnan(table.loc[name, "before"]) and 1.0 < table.loc[name, "after"] < 1.4
    assert table.loc[name, "lower95"] < table.loc[name, "after"] < table.loc[name, "upper95"]
    assert table.loc["c_guide", "unit"] == "N s/m"
    assert loop.report(tmp_path / "loop") == tmp_path / "loop" / "report.html"
    written = json.loads((tmp_path / "loop" / "result.json").read_text())
    assert written["verdict"] == loop.verdict
    assert bg.read_graph(tmp_path / "loop" / "corrected_graph.json") == loop.graph
    assert bg.load(tmp_path / "loop" / "sled.py") == bg.build(loop.graph)
