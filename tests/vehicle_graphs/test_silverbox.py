"""Silverbox: its importer, and the law that a closed loop finds without having it in a dictionary."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.data.log import Log
from bondgraph.data.matching import match
from bondgraph.data.read import read_log
from bondgraph.errors import DataError
from vehicle_graphs import effects, silverbox, silverbox_logs


def record(folder: Path, samples: int) -> Path:
    rows = np.column_stack([0.1 + np.arange(samples) % 7, 0.2 + np.arange(samples) % 5])
    with gzip.open(folder / "snls80mv.csv.gz", "wt") as file:
        file.write("V1,V2\n" + "\n".join(f"{a},{b}" for a, b in rows) + "\n")
    return folder


def test_the_importer_splits_the_record_as_published(tmp_path: Path) -> None:
    needed = silverbox_logs.FIRST + silverbox_logs.COUNT * silverbox_logs.EACH
    assert silverbox_logs.main([str(record(tmp_path, needed)), "--out", str(tmp_path / "logs")]) == 0
    names = sorted(path.name for path in (tmp_path / "logs").iterdir())
    assert len(names) == 12 and {"arrow.csv.gz", "training.csv.gz", "multisine_10.csv.gz"} <= set(names)
    training = read_log(tmp_path / "logs" / "training.csv.gz")
    first = read_log(tmp_path / "logs" / "multisine_1.csv.gz")
    assert len(training) == silverbox_logs.SHORT and len(first) == silverbox_logs.EACH
    quiet = 0.1 + np.mean(np.arange(silverbox_logs.QUIET) % 7)
    expected = 0.1 + np.arange(silverbox_logs.FIRST, silverbox_logs.FIRST + 9) % 7 - quiet
    np.testing.assert_allclose(first.channel("force").numbers[:9], expected, atol=1e-9)
    match(training, bg.build(silverbox.start()).model)  # columns and units fit


def test_a_record_that_ends_early_is_told(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"snls80mv.csv.gz: 500 samples, the published record has 127600 and more"):
        silverbox_logs.read_records(record(tmp_path, 500))


def arrow_error(model: bg.Model, values: dict[str, float], log: Log) -> float:
    """Root mean square error of the free simulation over the arrow head, mV."""
    known = {name: value for name, value in values.items() if name in model.names("parameter")}
    run = bg.simulate(model, inputs=log, theta=known, method="rk4", substeps=2, compiled=True)
    return 1e3 * float(np.sqrt(np.mean((run.output("displacement") - log.channel("displacement").numbers) ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("between", "as_declared", "cube", "error"),
    [("linear", True, 3.78, 1.0), ("linear", False, 3.90, 0.5), ("band limited", False, 3.90, 0.5)],
)
def test_the_cubic_spring_is_found_by_a_formula(
    shared_data: Path, between: str, as_declared: bool, cube: float, error: float
) -> None:
    """No law that is offered hardens; "backlash at body" was the answer.

    Without process noise the fit is that of the free simulation, in which the wrong course of a force between its
    samples is an error of 3 % in the coefficient; process noise takes it for noise of the drive. Where nobody insists
    on straight lines, the loop finds that the force is band limited.
    """
    logs = silverbox_logs.read_records(shared_data / "measured" / "silverbox")
    graph = silverbox.start() if between == "band limited" else silverbox.linear_between()
    model = bg.build(graph).model
    settings = LoopSettings(max_effects=1, process_noise="none", inputs_as_declared=as_declared)
    train = [match(logs["training.csv.gz"], model)]
    closed = close_loop(graph, train, [], (effects.backlash, effects.quadratic_loss), settings)
    (added,) = closed.added
    assert closed.limited == (() if as_declared or between == "band limited" else ("force",))
    assert added.trial.candidate.effect.name == "formula_cube_of_displacement_of_spring"
    assert closed.corrected.values[added.coefficients[0]] == pytest.approx(cube, rel=0.02)
    assert arrow_error(closed.corrected_built.model, closed.corrected.values, logs["arrow.csv.gz"]) < error
