"""The end of a loop: a disturbance against a function that made effects needless."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bondgraph.correct import cautions, rest
from bondgraph.correct.evidence.trials import Alternative
from bondgraph.correct.places.unexplained import Unexplained
from bondgraph.correct.progress import Progress
from bondgraph.correct.rest import Rest, at_random
from bondgraph.correct.round import Round, RoundSettings
from bondgraph.estimate.fitted import Fit
from bondgraph.report.closed_loop import _or_twins
from bondgraph.report.formulas import twins, with_size
from bondgraph.report.words import law_at
from tests.correct.sled import built, fitted, pull, sled


@pytest.mark.parametrize(("explained", "least"), [(0.0, 100.0), (6700.0, 6700.0)])
def test_a_function_explains_what_it_made_needless(
    explained: float, least: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Formulas worth 6700 nats went beside a function, and a disturbance of 3500 took their place."""
    log = pull(sled(), 1)
    state = Progress(sled(), built(), fitted([log]), (log,))
    found = cast(Unexplained, SimpleNamespace(signal="speed", gain=100.0, knots=np.zeros(8)))
    asked: list[float] = []

    def looked_for(state: Progress, settings: RoundSettings, worth: float, *, sensors: bool) -> Progress:
        asked.append(worth)
        return state

    monkeypatch.setattr(rest, "with_disturbance", looked_for)
    at_random(Rest(state, (found,), explained=explained), RoundSettings())
    measured = int(np.isfinite(log.y).sum())
    assert asked == [pytest.approx(least - 4.0 * np.log(measured))]


def test_what_a_later_round_found_is_not_beyond_detection() -> None:
    """ "Convection at product cannot be detected" stood below "the model lacks convection at product"."""
    seen = [
        SimpleNamespace(effect=name, junction="product", size=np.inf, taken=name == "leak")
        for name in ("convection", "radiation", "leak", "overflow")
    ]
    effect = SimpleNamespace(described="convection where air moves", name="convection")
    place = SimpleNamespace(label="product")
    chosen = SimpleNamespace(candidate=SimpleNamespace(effect=effect, place=place))
    twin = SimpleNamespace(name="overflow", junction="product", indistinguishable=True)  # the law stands for it
    rounds = [
        SimpleNamespace(detectable=seen, chosen=None, alternatives=()),
        SimpleNamespace(detectable=[], chosen=chosen, alternatives=(twin,)),
    ]
    taken, small = cautions._undetectable(cast("list[Round]", rounds))
    assert taken == "cannot be told from what is free, whatever its size: leak at product"
    assert small == "these logs would not show these, even as large as all else at their places: radiation at product"


@pytest.mark.parametrize(
    ("twins", "said"),
    [
        ([], "leak at tank"),
        (["scale"], "leak at tank or scale at gauge, which these data do not tell apart"),
        (["scale", "bias"], "leak at tank or one of 2 others that these data do not tell from it"),
    ],
)
def test_the_verdict_names_what_the_data_do_not_tell_apart(
    twins: list[str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = [SimpleNamespace(name=name, junction="gauge", indistinguishable=True) for name in twins]
    others.append(SimpleNamespace(name="drag", junction="tank", indistinguishable=False))
    monkeypatch.setattr(
        "bondgraph.report.formulas.round_of", lambda closed, added: SimpleNamespace(alternatives=others)
    )
    monkeypatch.setattr("bondgraph.report.closed_loop.headline_name", lambda closed, added: "leak at tank")
    closed = SimpleNamespace(corrected=cast(Fit, None))
    leak = SimpleNamespace(effect=SimpleNamespace(described="leak"), place=SimpleNamespace(label="tank"))
    added = SimpleNamespace(trial=SimpleNamespace(candidate=leak, simplifies="", rivals=(), stands_for=()))
    assert _or_twins(closed, added) == said  # type: ignore[arg-type]


def test_a_law_that_is_not_told_apart_has_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A relief valve had the true threshold in the place of an overflow that had not, and nobody could see it."""
    effect = SimpleNamespace(described="relief_valve", parameters=("e_valve", "w_valve"), widths=("w_valve",))
    candidate = SimpleNamespace(effect=effect, place=SimpleNamespace(label="pump"))
    turn = SimpleNamespace(trials=[SimpleNamespace(fit=object(), candidate=candidate)])
    monkeypatch.setattr("bondgraph.report.formulas.round_of", lambda closed, added: turn)
    monkeypatch.setattr("bondgraph.report.formulas.value_text", lambda fitted, name: "4.33e+05 Pa")
    told = [
        with_size(SimpleNamespace(), SimpleNamespace(), Alternative(name, "pump", 80.0, True, ""))  # type: ignore[arg-type]
        for name in ("relief_valve", "leakage")
    ]
    assert told == ["relief_valve at pump (e_valve = 4.33e+05 Pa)", "leakage at pump"]


def test_the_same_law_by_other_levels_is_no_twin_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A contact of a heat pipe "below 327 K or contact_resistance where it is between two levels at pipe"."""
    where = "contact_resistance where temperature of evaporator is"
    others = [Alternative(f"{where} between two levels", "pipe", 80.0, True, "")]
    others.append(Alternative("leakage where temperature of pipe is above a level", "pipe", 79.0, True, ""))
    monkeypatch.setattr(
        "bondgraph.report.formulas.round_of", lambda closed, added: SimpleNamespace(alternatives=others)
    )
    own = SimpleNamespace(
        effect=SimpleNamespace(described=f"{where} below a level"), place=SimpleNamespace(label="pipe")
    )
    trial = SimpleNamespace(candidate=own, simplifies="", rivals=(), stands_for=(), gain=80.0)
    found = twins(SimpleNamespace(), SimpleNamespace(trial=trial))  # type: ignore[arg-type]
    assert [law_at(one.name, one.junction) for one in found] == [
        "leakage at pipe where temperature of pipe is above a level"
    ]


def test_what_took_the_place_of_a_law_is_told_apart_from_no_more_than_that(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the law of more coefficients would have done as well elsewhere, so would the simpler one."""
    others = [
        Alternative("stribeck_loss", "hook", 250.0, True, ""),
        Alternative("coulomb_loss", "motor", 229.0, True, ""),
    ]
    monkeypatch.setattr(
        "bondgraph.report.formulas.round_of", lambda closed, added: SimpleNamespace(alternatives=others)
    )
    dry = SimpleNamespace(effect=SimpleNamespace(described="coulomb_loss"), place=SimpleNamespace(label="motor"))
    trial = SimpleNamespace(
        candidate=dry, simplifies="stribeck_loss at motor", rivals=(), stands_for=("torque_loss at motor",), gain=252.0
    )
    found = twins(SimpleNamespace(), SimpleNamespace(trial=trial))  # type: ignore[arg-type]
    assert [(one.name, one.junction) for one in found] == [("coulomb_loss", "hook"), ("torque_loss", "motor")]
