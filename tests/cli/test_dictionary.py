"""The command that shows the dictionary of effects: table, one effect, JSON, picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bondgraph.cli import main
from bondgraph.effects.catalogue import catalogue, every_effect
from bondgraph.effects.curves import curve_of


def test_the_table_lists_every_effect(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects"]) == 0
    said = capsys.readouterr().out
    assert {row.function for row in catalogue()} == set(every_effect())
    for row in catalogue():
        assert f"  {row.name} " in said and row.law in said
    assert max(map(len, said.splitlines())) < 200


def test_one_domain_and_its_words(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "--domain", "hydraulic"]) == 0
    said = capsys.readouterr().out
    assert "relief_valve" in said and "leakage" in said and "actuator_lag" in said
    assert "coulomb" not in said and "creep" not in said


@pytest.mark.rendered
def test_one_effect_with_formula_reference_and_manoeuvre(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["effects", "radiation", "--picture", str(tmp_path / "radiation.svg")]) == 0
    said = capsys.readouterr().out
    for part in ("flow = c*((effort + z)^4 - (around + z)^4)", "W/K^4", "Incropera", "shown by", "it takes energy"):
        assert part in said
    assert "<svg" in (tmp_path / "radiation.svg").read_text(encoding="utf-8")


def test_the_table_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "creep", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["schema"] == "bondgraph-effects/1"
    assert {row["name"] for row in table["effects"]} == {"creep", "shunt_leakage", "leakage", "side_reaction"}
    assert all(row["coefficients"][0]["unit"] for row in table["effects"])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["radation"], "no effect of this name; did you mean 'radiation'"),
        (["actuator_lag", "--picture", "lag.svg"], "acts in time"),
        (["--picture", "all.svg"], "name the effect"),
    ],
)
def test_what_cannot_be_shown_is_said(given: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", *given]) == 2
    assert message in capsys.readouterr().err


def test_curves_are_those_of_the_laws() -> None:
    rows = {row.name: row for row in catalogue()}
    stiff = curve_of(rows["hardening_spring"])
    assert stiff is not None and stiff.declared is not None and stiff.variable == "displacement"
    extra = stiff.law - stiff.declared
    assert extra[-1] > 0.0 and extra[-1] == pytest.approx(8.0 * extra[150], rel=1e-9)  # half of the way
    drop = curve_of(rows["contact_drop"])
    assert drop is not None and drop.declared is None and drop.law[-1] == -drop.law[0] > 0.0


def test_a_slip_is_drawn_although_what_it_frees_has_states() -> None:
    rows = {row.name: row for row in catalogue()}
    slip = curve_of(rows["coupling_slip"])
    assert slip is not None and slip.declared is None and (slip.variable, slip.gives) == ("slip", "effort")
    assert np.all(np.diff(slip.law) > 0.0)
    # effort = s/c/sqrt(1 + (s/(c*m))^2): 1/effort^2 is a straight line over 1/s^2, which rises by c^2
    rise = (slip.law[150] ** -2 - slip.law[-1] ** -2) / (slip.x[150] ** -2 - slip.x[-1] ** -2)
    assert rise == pytest.approx((slip.x[101] / slip.law[101]) ** 2, rel=1e-2)
    steep = curve_of(rows["clutch_slip"])
    assert steep is not None and steep.law[-1] == pytest.approx(-steep.law[0])
    assert curve_of(rows["tyre_relaxation"]) is None  # acts in time


def test_laws_of_heat_are_drawn_over_temperatures_and_vanish_at_that_of_what_is_around() -> None:
    rows = {row.name: row for row in catalogue()}
    for name in ("heat_loss", "convection", "radiation"):
        lost = curve_of(rows[name])
        assert lost is not None and lost.x[0] > 200.0
        assert np.interp(293.15, lost.x, lost.law) == pytest.approx(0.0, abs=0.02 * lost.law[-1]), name
    bridge = curve_of(rows["heat_bridge"])  # over the difference
    assert bridge is not None and bridge.law[0] == -bridge.law[-1] < 0.0


def test_laws_with_a_memory_of_their_own_are_no_curves() -> None:
    """They were drawn as straight lines over an inner state, under its name."""
    curves = {row.name: curve_of(row) for row in catalogue()}
    for name in ("hysteresis_loss", "bouc_wen_loss", "lugre_loss", "polarisation", "slow_heat_capacity"):
        assert curves[name] is None, name
    shown = {name: curve.variable for name, curve in curves.items() if curve is not None}
    assert (shown["ripple"], shown["charge_fading"]) == ("angle", "drawn")
