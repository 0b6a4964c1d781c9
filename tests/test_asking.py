"""Design at the front door, against closed forms of models that are linear in what is free."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import bondgraph as bg
from bondgraph.data import LogChannel
from bondgraph.errors import OptionError
from bondgraph.estimate import FreeParameter, Manoeuvre, discriminate, rank_manoeuvres
from bondgraph.estimate.design.answer import Design, standing
from bondgraph.simulate import Scenario

#: Samples and step of the manoeuvres, noise of the speed, bounds of what is free.
SIZE, STEP, STD, BOUNDS = 41, 0.1, 0.02, (0.2, 5.0)
TIME = STEP * np.arange(SIZE)
GAIN = FreeParameter("gain", *BOUNDS, 1.0)
#: Variance of what is known before: that of an even spread over the bounds.
BEFORE = (BOUNDS[1] - BOUNDS[0]) ** 2 / 12.0


def cart(power: int = 1) -> bg.Model:
    """A cart of 2 kg that is pushed by a gain times a power of the command, whose speed is linear in the gain."""
    g = bg.BondGraph("cart" if power == 1 else "bent cart")
    command = g.input("command", "N", "push", between="hold")
    gain = g.parameter("gain", 1.0, "1" if power == 1 else "1/N", "", BOUNDS)
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("push", gain * command**power, at=body)
    g.inertance("cart", g.parameter("mass", 2.0, "kg"), at=body, state="v")
    g.measure_flow("speed", body)
    return bg.build(g)


def push(*levels: float) -> np.ndarray:
    """A command of several levels of the same length, shape (SIZE,)."""
    found: np.ndarray = np.resize(np.repeat(levels, -(-SIZE // len(levels))), SIZE)
    return found


def course(command: np.ndarray) -> np.ndarray:
    """Speed at a gain of one: the integral of a held command over the mass."""
    found: np.ndarray = np.concatenate([[0.0], np.cumsum(command[:-1])]) * STEP / 2.0
    return found


def log(name: str, command: np.ndarray, seed: int | None = None) -> bg.Log:
    """A log of a command, with measured speeds where a seed is given."""
    channels = {"command": LogChannel("command", "N", command)}
    if seed is not None:
        speed = course(command) + STD * np.random.default_rng(seed).standard_normal(SIZE)
        channels["speed"] = LogChannel("speed", "m/s", speed)
    return bg.Log(name, TIME, channels)


def told(command: np.ndarray) -> float:
    return float((course(command) ** 2).sum()) / STD**2


def test_a_design_tells_what_a_linear_model_tells() -> None:
    plans = {"weak": log("any", push(0.1)), "strong": log("any", push(3.0, -1.0))}
    found = bg.design(cart(), plans, [GAIN], noise={"speed": STD})
    assert [row.name for row in found.information.rows] == ["strong", "weak"] and found.discrimination is None
    for row in found.information.rows:
        expected = told(plans[row.name].channel("command").numbers)
        assert row.information[0, 0] == pytest.approx(expected, rel=1e-6)
        assert row.gain == pytest.approx(0.5 * np.log1p(BEFORE * expected), rel=1e-6)
        assert row.std_left[0] == pytest.approx((1.0 + BEFORE * expected) ** -0.5, rel=1e-6)


def test_what_logs_at_hand_tell_is_known_before() -> None:
    """A filter with its noise, a posed problem and an estimate say the same of the next log."""
    known = bg.FilterModel(cart(), {}, {"speed": STD}, {}, method="auto")
    first, plan = log("first", push(1.0, -2.0), seed=1), log("plan", push(3.0, -1.0))
    problem = bg.pose(known, first, [GAIN])
    fit = bg.estimate(problem, settings=bg.Settings(method="gradient", starts=1, certify="none"))
    before = 1.0 + BEFORE * told(push(1.0, -2.0))
    expected = 0.5 * np.log((before + BEFORE * told(push(3.0, -1.0))) / before)
    asked = bg.design(cart(), plan, [GAIN], noise={"speed": STD}, logs=first), bg.design(problem, [plan])
    for found in (*asked, bg.design(known, plan, [GAIN], logs=[first]), bg.design(fit, plan)):
        rows = {row.name: row for row in found.information.rows}
        assert rows["plan"].gain == pytest.approx(expected, rel=1e-6)
        assert any(name.startswith("steps of command") for name in rows), "steps within the range of the log are tried"


def test_rivals_are_told_apart_by_what_the_best_of_one_leaves_of_the_other() -> None:
    """Both speeds are linear: the expected ratio is half the squared rest of one course beside the other."""
    plans = [log("one level", push(2.0)), log("two levels", push(3.0, 1.0))]
    found = bg.design(cart(), plans, "gain", noise={"speed": STD}, rivals=cart(2))
    assert found.discrimination is not None and found.discrimination.rivals == ("cart", "bent cart")
    assert found.discrimination.rows[0].name == "two levels"
    own, theirs = course(push(3.0, 1.0)), course(push(3.0, 1.0) ** 2)
    rest = own @ own - (own @ theirs) ** 2 / (theirs @ theirs)
    assert found.discrimination.rows[0].nats[0, 1] == pytest.approx(0.5 * rest / STD**2, rel=1e-3)
    assert found.discrimination.rows[1].nats[0, 1] == pytest.approx(0.0, abs=1e-2)
    table = found.to_dataframe()
    assert list(table.columns[-3:]) == ["apart_nats", "apart_rate", "apart_seconds"]
    assert (
        table.loc["two levels", "apart_nats"] == found.discrimination.rows[0].nats[found.discrimination.rows[0].worst]
    )
    assert found.advice[0] in found.summary() and found.table() == found.discrimination.table()
    several = bg.design(cart(), plans, noise={"speed": STD}, rivals={"bent": cart(2), "same": cart()})
    assert several.discrimination is not None and several.discrimination.rivals == ("cart", "bent", "same")
    twins = bg.design(cart(), plans, noise={"speed": STD}, rivals=[cart()])
    assert twins.discrimination is not None and twins.discrimination.rivals == ("cart", "cart (2)")


def test_rivals_are_fitted_to_logs_at_hand() -> None:
    first, plan = log("first", push(1.0, -2.0), seed=1), log("plan", push(3.0, 1.0))
    known = [bg.FilterModel(cart(k), {}, {"speed": STD}, {}, method="auto") for k in (1, 2)]
    found = bg.design(known[0], plan, logs=first, rivals=known[1])
    posed = [bg.pose(one, first) for one in known]
    by_hand = [standing(name, one, fitted=True) for name, one in zip(("cart", "bent cart"), posed, strict=True)]
    assert by_hand[0].point != posed[0].start
    expected = discriminate(by_hand, [Manoeuvre.of_log(bg.match(log("plan", push(3.0, 1.0), seed=2), cart()))])
    assert found.discrimination is not None
    (row,) = [one for one in found.discrimination.rows if one.name == "plan"]
    np.testing.assert_allclose(row.nats, expected.rows[0].nats, rtol=1e-9)


def test_scenarios_manoeuvres_tables_and_files_are_planned(tmp_path: Path) -> None:
    command = push(3.0, -1.0)
    scenario = Scenario("as declared", 4.0, {"command": [(0.0, 3.0), (2.1, 3.0), (2.1, -1.0)]})
    plan = Manoeuvre("by hand", TIME, command[np.newaxis])
    table = log("any", command).to_dataframe().rename(columns={"command [N]": "u [N]"})
    bg.write_log(tmp_path / "file.csv", log("file", command))
    plans = [scenario, plan, table, log("log", command)]
    found = bg.design(
        cart(), [*plans[:2], plans[3], tmp_path / "file.csv"], [GAIN], noise={"speed": STD}, rate=1.0 / STEP
    )
    assert {row.name for row in found.information.rows} == {"as declared", "by hand", "log", "file"}
    for row in found.information.rows:
        assert row.information[0, 0] == pytest.approx(told(command), rel=1e-6), row.name
    mapped = bg.design(cart(), table, [GAIN], noise={"speed": STD}, columns={"u": "command"})
    assert [row.name for row in mapped.information.rows] == ["plan1"]
    assert mapped.information.rows[0].information[0, 0] == pytest.approx(told(command), rel=1e-6)


def test_a_design_is_a_table_a_picture_and_a_line(tmp_path: Path) -> None:
    found = bg.design(cart(), log("plan", push(1.0)), noise={"speed": STD}, rivals=cart(2))
    assert repr(found) == "<Design of cart: 1 manoeuvres, 2 rivals; best: plan>"
    own = Figure().subplots()
    assert found.plot(ax=own) is own and own.get_xlabel() == "expected log-likelihood ratio [nats/s]"
    assert "<table>" in found._repr_html_()
    again = Design.load(found.save(tmp_path / "design.npz"))
    assert again.summary() == found.summary() and again.to_dict() == found.to_dict()
    plain = bg.design(cart(), log("plan", push(1.0)), noise={"speed": STD})
    assert plain.table() == plain.information.table() and plain.plot().get_xlabel() == "standard deviation left"
    problem = bg.pose(bg.FilterModel(cart(), {}, {"speed": STD}, {}, method="auto"), log("plan", push(1.0), seed=1))
    same = rank_manoeuvres(problem, [Manoeuvre("plan", TIME, push(1.0)[np.newaxis])])
    assert plain.to_dict()["information"] == same.to_dict()


WRONG = {
    "nothing planned": (lambda: bg.design(cart(), noise={"speed": STD}), "no manoeuvre is planned"),
    "no noise": (lambda: bg.design(cart(), log("a", push(1.0))), "no noise of a sensor of cart is known - give noise"),
    "an unknown sensor": (
        lambda: bg.design(cart(), log("a", push(1.0)), noise={"sped": STD}),
        "noise of 'sped', but no model has that output; did you mean 'speed'",
    ),
    "no deviation": (lambda: bg.design(cart(), log("a", push(1.0)), noise={"speed": 0.0}), "speed 0 - give"),
    "no rate": (lambda: bg.design(cart(), log("a", push(1.0)), noise={"speed": STD}, rate=0.0), "a rate of 0"),
    "a graph": (lambda: bg.design(bg.BondGraph("cart"), log("a", push(1.0))), "where a model is expected - bg.build"),
    "a number": (lambda: bg.design(cart(), [3], noise={"speed": STD}), "int was given where a log is expected"),
    "a posed problem with more": (
        lambda: bg.design(bg.pose(cart(), log("a", push(1.0, 2.0), seed=1)), log("b", push(1.0)), "gain"),
        "a posed problem has its own logs, noises and free parameters",
    ),
}


@pytest.mark.parametrize("call", WRONG)
def test_what_cannot_be_planned_is_refused_in_a_sentence(call: str) -> None:
    wrong, said = WRONG[call]
    with pytest.raises(OptionError, match=said):
        wrong()
