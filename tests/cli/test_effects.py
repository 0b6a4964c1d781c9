"""Which effects a command line chooses: modules, names, what is left out."""

from __future__ import annotations

from pathlib import Path

import pytest

from bondgraph.cli import main
from bondgraph.cli.effects import chosen_effects
from bondgraph.correct.models.faults import SENSOR_FAULTS
from bondgraph.declare.effect import effect_functions
from bondgraph.errors import OptionError
from vehicle_graphs import effects

OWN = """
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.graph import BondGraph
from vehicle_graphs.effects import backlash


def spring_hardens(g: BondGraph, at: Place) -> Effect | None: ...
def spring_softens(g: BondGraph, at: Place) -> Effect | None: ...
"""
ONLY_IMPORTS = "from vehicle_graphs.effects import backlash, creep\nfrom math import sin\n"


def names(given: list[str], without: list[str] | None = None) -> list[str]:
    return [one.__name__ for one in chosen_effects(given, without or [])]


@pytest.fixture
def own(tmp_path: Path) -> str:
    path = tmp_path / "own_laws.py"
    path.write_text(OWN, encoding="utf-8")
    return str(path)


def test_modules_files_and_single_effects_are_chosen_once_and_in_order(own: str) -> None:
    everything = [one.__name__ for one in effect_functions(effects)]
    assert names(["vehicle_graphs.effects"]) == everything
    assert names([own, "creep"]) == ["spring_hardens", "spring_softens", "creep"]
    assert names([f"{own}:spring_softens", "vehicle_graphs.effects:backlash,backlash"]) == [
        "spring_softens",
        "backlash",
    ]


def test_shipped_effects_and_faults_can_be_left_out(own: str) -> None:
    left = names(["vehicle_graphs.effects", own], ["backlash", "spring_softens,sensor_delay"])
    assert "backlash" not in left and "creep" in left and left[-1] == "spring_hardens"
    assert {one.__name__ for one in SENSOR_FAULTS} >= {"sensor_delay"}


def test_a_module_that_only_imports_effects_offers_them(tmp_path: Path) -> None:
    """It had none, unless it was a package: "no effect to try"."""
    path = tmp_path / "my_choice.py"
    path.write_text(ONLY_IMPORTS, encoding="utf-8")
    assert names([str(path)]) == ["backlash", "creep"]


@pytest.mark.parametrize(
    ("given", "without", "message"),
    [
        (
            ["backlsh"],
            [],
            r"--effects backlsh: there is no module 'backlsh'.*did you mean 'backlash'.*a shipped effect",
        ),
        (["vehicle_graphs.effects:crep"], [], r"has no effect function 'crep'.*did you mean 'creep'"),
        (["math"], [], r"--effects math: math has no effect functions - they take a graph and a Place"),
        (["creep"], ["crep"], r"--without crep: no effect of this name is tried.*'creep'"),
        (["creep"], ["creep"], r"--without leaves no effect to try"),
    ],
)
def test_what_is_no_effect_is_refused(given: list[str], without: list[str], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        chosen_effects(given, without)


def test_a_wrong_name_ends_with_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "run.csv"
    log.write_text("time [s],engine_torque [N m],engine_speed [rad/s]\n0,1,100\n0.1,1,100\n", encoding="utf-8")
    command = ["close-loop", "vehicle_graphs.driveline:driveline", "--data", str(log), "--out", str(tmp_path / "out")]
    assert main([*command, "--effects", "backlsh"]) == 2
    assert "backlsh" in capsys.readouterr().err
