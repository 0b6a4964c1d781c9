"""What a person sees of the Ranger: its drawing, and the picture of a manoeuvre from the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bondgraph.cli import main
from bondgraph.data.read import read_log
from bondgraph.derive.causality import assign_causality
from bondgraph.errors import DeclarationError, ModelError, OptionError
from bondgraph.report.diagram.canvas import Text
from bondgraph.report.diagram.layout import Layout, lay_out
from bondgraph.report.drawing import Drawing, draw_svg, drawing_of, picture_of
from bondgraph.report.manoeuvre import manoeuvre_figure
from bondgraph.report.scenarios import declared_scenario
from bondgraph.report.simulation import SimulationOptions, simulate_graph
from bondgraph.simulate.model import Model
from bondgraph.simulate.scenario import Panel, Scenario
from vehicle_graphs.ranger import PANELS, SCENARIOS, coast_down, full

RANGER = "vehicle_graphs.ranger:full"


@pytest.fixture(scope="module")
def drawing() -> Drawing:
    return drawing_of(assign_causality(full()))


@pytest.fixture(scope="module")
def layout(drawing: Drawing) -> Layout:
    return lay_out(drawing)


def test_every_part_with_elements_has_a_frame(layout: Layout) -> None:
    parts = {part.name for part in full().subgraphs if part.graph.nodes}
    assert {frame.name for frame in layout.frames} == parts


def test_bonds_hardly_cross(layout: Layout) -> None:
    assert layout.crossings <= 2


def test_no_label_lies_on_another(layout: Layout) -> None:
    boxes = list(layout.boxes.items())
    for k, (name, box) in enumerate(boxes):
        for other_name, other in boxes[k + 1 :]:
            apart = box.right <= other.left or other.right <= box.left
            apart = apart or box.bottom <= other.top or other.bottom <= box.top
            assert apart, f"{name} lies on {other_name}"


def test_the_drawing_says_how_the_belt_radius_is_found(drawing: Drawing) -> None:
    definition = dict(drawing.definitions)["r_s"]
    assert definition.startswith("from  0 = ") and definition.endswith("- L_b")
    svg = draw_svg(drawing)
    assert "derivative causality" in svg and "min(F_p, F_s)" in svg


def test_small_print_of_a_wide_drawing_stands_in_two_columns(drawing: Drawing) -> None:
    print_at = [part.x for part in picture_of(drawing).primitives if isinstance(part, Text) and part.role == "law"]
    assert max(print_at) > 500 > min(print_at)


# ---------------------------------------------------------------------- manoeuvres


@pytest.mark.rendered
def test_launch_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture, table = tmp_path / "launch.png", tmp_path / "launch.csv"
    chosen = ["--scenario", "full_throttle_launch", "--until", "1.5", "--rtol", "1e-6"]
    assert main(["simulate", RANGER, *chosen, "--plot", str(picture), "--out", str(table)]) == 0
    assert picture.stat().st_size > 20_000
    log = read_log(table)
    assert log.time[-1] == pytest.approx(1.5)
    assert log.channels["forward_velocity"].values[-1] > 2.0


def test_a_reduced_model_says_what_it_leaves_out(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = str(tmp_path / "run.csv")
    command = ["simulate", "vehicle_graphs.ranger:coast_down", "--scenario", "half_brake", "--until", "1", "--out", out]
    assert main(command) == 0
    assert "left out, since ranger_coast_down does not have them: gear" in capsys.readouterr().err


def test_an_unknown_scenario_lists_those_that_exist() -> None:
    with pytest.raises(OptionError, match="did you mean 'hill'") as caught:
        declared_scenario(RANGER, "hil")
    assert all(name in caught.value.message for name in SCENARIOS)
    with pytest.raises(OptionError, match="declares no scenarios"):
        declared_scenario("vehicle_graphs.driveline:driveline", "launch")


def test_values_and_start_given_beside_a_scenario_come_first() -> None:
    options = SimulationOptions(
        0.2, 0.1, {"brake": 0.4}, {"forward_velocity": 3.0}, rtol=1e-5, scenario=SCENARIOS["half_brake"]
    )
    run = simulate_graph(coast_down(), None, options)
    assert run.time[-1] == pytest.approx(0.2)
    assert run.state("forward_velocity")[0] == 3.0 and np.all(run.input("brake") == 0.4)


def test_the_picture_has_a_panel_for_everything_that_the_model_has() -> None:
    options = SimulationOptions(0.2, 0.1, scenario=SCENARIOS["half_brake"], rtol=1e-5, signals=True)
    run = simulate_graph(coast_down(), None, options)
    labels = [axes.get_ylabel().split("\n")[0] for axes in manoeuvre_figure(run, PANELS).axes]
    assert labels == ["speeds", "slip", "pitch of the body"]
    with pytest.raises(OptionError, match="none of engine_speed"):
        manoeuvre_figure(run, PANELS[:1])
    with pytest.raises(DeclarationError, match="not kg"):
        manoeuvre_figure(run, [Panel("wrong", "kg", {"v": "forward_velocity"})])


def test_held_inputs_step_and_others_run_between_corners(ranger: Model) -> None:
    scenario = Scenario(
        "shift and brake", 4.0, {"gear": [(0.0, "H"), (2.0, "N")], "brake": [(1.0, 0.0), (3.0, 1.0), (3.0, 0.2)]}
    )
    signal = scenario.signal(ranger)
    gear, brake = (ranger.index("input", name) for name in ("gear", "brake"))
    times = [0.5, 1.999, 2.0, 2.5, 3.0, 3.5]
    assert list(signal.at(times)[gear]) == [10, 10, 0, 0, 0, 0]
    assert signal.at(times)[brake] == pytest.approx([0, 0.4995, 0.5, 0.75, 0.2, 0.2])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"duration": 0.0}, "it must be positive"), ({"inputs": {"brake": [(2.0, 1.0), (1.0, 0.0)]}}, "in order")],
)
def test_an_impossible_scenario_is_refused(wrong: dict[str, object], said: str) -> None:
    with pytest.raises(ModelError, match=said):
        Scenario(**({"meaning": "x", "duration": 1.0, "inputs": {}} | wrong))  # type: ignore[arg-type]
