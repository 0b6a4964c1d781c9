"""Tables and progress on the terminal."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from rich.console import Console

from bondgraph.estimate.objective import TraceRow
from bondgraph.report.numbers import change, shown, with_interval
from bondgraph.report.progress import WorkProgress, status
from bondgraph.report.series import ChannelError, ChannelSeries, ParameterChange, Prediction, Tried, channel_errors
from bondgraph.report.tables import alternatives_table, error_table, grouped_errors, parameter_table, pooled, text_of


def error(log: str, before: float, after: float, held_out: bool = False, samples: int = 100) -> ChannelError:
    return ChannelError(log, "speed", "rad/s", held_out, 0.4, 0.3, before, after, 0.1, samples)


def cells(text: str) -> list[list[str]]:
    """Rows of a printed table as lists of cells (at least two blanks apart)."""
    return [[cell.strip() for cell in line.split("  ") if cell.strip()] for line in text.splitlines() if line.strip()]


def test_errors_of_several_logs_are_pooled_by_their_measurements() -> None:
    rows = pooled([error("a", 3.0, 1.0, samples=100), error("b", 6.0, 1.0, samples=300), error("c", 9.0, 9.0, True)])
    assert [row.held_out for row in rows] == [False, True]
    assert rows[0].simulation_before == pytest.approx(math.sqrt((100 * 9 + 300 * 36) / 400))
    assert rows[0].samples == 400


def test_a_log_without_a_simulation_does_not_spoil_the_pool() -> None:
    (row,) = pooled([error("a", math.nan, 1.0), error("b", 6.0, 1.0)])
    assert row.simulation_before == 6.0


def test_pooled_errors_are_those_of_all_samples_together() -> None:
    draw = np.random.default_rng(3)
    series = [
        ChannelSeries(log, "v", "m/s", np.arange(float(n)), draw.normal(size=n), Prediction(simulated=np.zeros(n)))
        for log, n in (("a", 40), ("b", 160))
    ]
    (row,) = pooled(channel_errors(series))
    together = np.concatenate([one.measured for one in series])
    assert row.simulation_before == pytest.approx(float(np.sqrt(np.mean(together**2))))


def test_training_comes_before_held_out_and_the_sum_after_its_logs() -> None:
    groups = grouped_errors([error("h", 2.0, 1.0, True), error("a", 3.0, 1.0), error("b", 6.0, 1.0)])
    assert [(title, [row.log for row in rows]) for title, rows in groups] == [
        ("training", ["a", "b", "all logs"]),
        ("held out", ["h"]),
    ]


def test_the_error_table_shows_before_after_and_change() -> None:
    rows = cells(text_of(error_table([error("run_1", 76.0, 16.0), error("run_2", 12.5, 14.0, True)])))
    assert ["training", "speed [rad/s]", "run_1", "76.0", "16.0", "−79 %", "0.400", "0.300", "−25 %", "0.100"] in rows
    assert ["held out", "speed [rad/s]", "run_2", "12.5", "14.0", "+12 %", "0.400", "0.300", "−25 %", "0.100"] in rows


def test_logs_with_long_names_keep_the_ends_that_tell_them_apart() -> None:
    """Two training logs of one machine were both called "speaker_clean…"."""
    names = [f"loudspeaker_on_the_bench_in_free_air_{k}" for k in (1, 2)]
    table = text_of(error_table([error(name, 3.0, 1.0) for name in names]), width=80)
    assert "r_1" in table and "r_2" in table


def test_the_parameter_table_shows_intervals_and_bounds() -> None:
    text = text_of(
        parameter_table(
            [
                ParameterChange("mass", "kg", 260.0, 258.73, (255.9, 261.5), meaning="vehicle [weighed]"),
                ParameterChange("k", "N/m", 4200.0, 8000.0, (5200.0, 8000.0), at_bound=True),
            ]
        )
    )
    assert ["mass", "260.0", "258.7", "[255.9, 261.5]", "kg", "vehicle [weighed]"] in cells(text)
    assert ["k", "4200", "8000", "[5200, 8000]", "N/m", "at its bound"] in cells(text)


def test_the_alternatives_table_says_why() -> None:
    text = text_of(alternatives_table([Tried("viscous loss", "shaft", 12.345, "not significant")]))
    assert ["viscous loss", "shaft", "12.3", "not significant"] in cells(text)
    assert "gain [nats]" in text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (76.2314, "76.2"),
        (0.0, "0"),
        (-0.00456, "-0.00456"),
        (999.7, "1000"),
        (math.inf, "∞"),
        (math.nan, "–"),
        (1e-12, "1e-12"),
    ],
)
def test_numbers_have_three_digits(value: float, text: str) -> None:
    assert shown(value) == text


def test_values_have_the_digits_their_interval_allows() -> None:
    assert with_interval(1.23456, (1.1, 1.4)) == ("1.23", "[1.10, 1.40]")
    assert with_interval(1.23456, (1.2344, 1.2347)) == ("1.23456", "[1.23440, 1.23470]")
    assert with_interval(5.0, (math.nan, 6.0)) == ("5.00", "–")


def test_changes_are_signed_and_never_rounded_to_complete() -> None:
    assert change(100.0, 0.2) == "−99.8 %"
    assert change(1.0, 1.004) == "0 %"
    assert change(math.nan, 1.0) == "–"


def test_progress_writes_a_line_a_minute_where_there_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten minutes of a closed loop into a file left nothing to see but its end."""
    now = [100.0]
    monkeypatch.setattr("bondgraph.report.progress.time.monotonic", lambda: now[0])
    output = io.StringIO()
    with WorkProgress("closing the loop", None, "", Console(file=output, force_terminal=False)) as work:
        for second, done in ((30, 1), (70, 3), (100, 4), (131, 5)):
            now[0] = 100.0 + second
            work.stage("refit the best candidates", done, 12)
        now[0] += 100.0
        work.reach(9, 12.5)
    assert output.getvalue().splitlines() == [
        "0:01:10  refit the best candidates: 3/12", "0:02:11  refit the best candidates: 5/12",
        "0:03:51  refit the best candidates: 9/12, best 12.5000",
    ]  # fmt: skip


def test_short_work_writes_nothing_where_there_is_no_terminal() -> None:
    output = io.StringIO()
    console = Console(file=output, force_terminal=False)
    with WorkProgress("searching", 100, "evaluations", console) as work, status("thinking", console):
        work.advance(30, best=5.0)
        work.trace(TraceRow("gradient", 3, 70, 4.0, ()))
        work.advance(1, best=9.0)
    assert output.getvalue() == ""
    assert (work.done, work.best) == (71, 4.0)


def test_the_best_is_that_of_the_stage_for_other_stages_have_other_likelihoods() -> None:
    with WorkProgress("estimating", None, "evaluations", Console(file=io.StringIO())) as work:
        for stage, nll, best in (("wide", -90.0, -90.0), ("wide", -80.0, -90.0), ("declared", 7.0, 7.0)):
            work.trace(TraceRow(stage, 0, 10, nll, ()))
            assert work.best == best


def test_progress_on_a_terminal_tells_done_rate_and_best() -> None:
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=140)
    with WorkProgress("searching", 100, "evaluations", console) as work:
        work.advance(40, best=12.5)
        work._progress.refresh()
    text = output.getvalue()
    assert "searching" in text and "40/100" in text and "evaluations" in text and "best 12.5" in text


def test_progress_stops_on_an_interrupt() -> None:
    console = Console(file=io.StringIO(), force_terminal=True)
    with pytest.raises(KeyboardInterrupt), WorkProgress("searching", 10, console=console) as work:
        raise KeyboardInterrupt
    assert work._progress.live.is_started is False
