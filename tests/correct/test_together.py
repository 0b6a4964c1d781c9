"""Laws that pass only together: which one is taken on trial, and a cell with two effects that hide each other."""

from __future__ import annotations

from dataclasses import replace
from math import exp
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.correct.constants import LEVEL
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.progress import Progress
from bondgraph.correct.round import Round, RoundSettings, one_round
from bondgraph.correct.scores.gates import Gate
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.together import _on_trial, two_laws
from bondgraph.data.log import FloatArray
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import EffectFunction, Place, Scale
from tests.correct.sled import added, built, fitted, pull, sled

LOG = pull(added(effects.quadratic_loss, "runner", 8.0), 4)
RUNNER = Place(handle(sled(), "runner"), Scale(150.0, 4.0))
REFUSED = Evidence(200.0, 1e-9, 1.0, 190.0, 10)


def refitted(size: float, evidence: Evidence = REFUSED) -> Trial:
    """Air drag of the sled, refitted to a log that has it, with the evidence that is given."""
    (made,), _ = candidates(built(), [effects.quadratic_loss], [RUNNER])
    done = refit_from(Trial(made, 0.0), [size], Context(built(), fitted([LOG]), (LOG,), 10, 0.01, 5.0))
    return replace(done, evidence=evidence)


def turn(*trials: Trial, chosen: Trial | None = None) -> SimpleNamespace:
    return SimpleNamespace(trials=trials, chosen=chosen)


def test_a_law_that_one_test_refuses_is_taken_on_trial() -> None:
    law = refitted(8.0)
    gated = replace(law, gate=Gate("from", "run", 3.0), evidence=replace(REFUSED, bic_gain=150.0, p_robust=1e-9))
    assert _on_trial(turn(law), LEVEL) is law  # type: ignore[arg-type]
    assert _on_trial(turn(law, gated, chosen=gated), LEVEL) is law  # type: ignore[arg-type]
    more = replace(gated, evidence=replace(REFUSED, bic_gain=210.0, p_robust=1e-9))
    assert _on_trial(turn(law, more, chosen=more), LEVEL) is None  # type: ignore[arg-type]
    sure = replace(law, evidence=replace(REFUSED, p_robust=1e-9))
    assert _on_trial(turn(law, sure, chosen=sure), LEVEL) is None  # type: ignore[arg-type]


def test_a_law_that_its_own_scatter_does_not_tell_is_not() -> None:
    quiet = pull(sled(), 4)
    (made,), _ = candidates(built(), [effects.quadratic_loss], [RUNNER])
    done = refit_from(Trial(made, 0.0), [0.1], Context(built(), fitted([quiet]), (quiet,), 10, 0.01, 5.0))
    assert _on_trial(turn(replace(done, evidence=REFUSED)), LEVEL) is None  # type: ignore[arg-type]
    costly = replace(refitted(8.0), evidence=replace(REFUSED, bic_gain=-1.0))
    assert _on_trial(turn(costly), LEVEL) is None  # type: ignore[arg-type]


def refused_round(log: bg.MatchedLog) -> tuple[Progress, Round]:
    """The sled before anything was added, and a round that refused its air drag."""
    base = fitted([log])
    done = one_round(built(), base, (log,), FUNCTIONS)
    law = next(one for one in done.trials if one.candidate.label == "quadratic_loss at runner")
    assert law.fit is not None and law.evidence is not None
    refused = replace(law, evidence=replace(law.evidence, p_robust=1.0))
    state = Progress(sled(), built(), base, (log,))
    return state, replace(done, chosen=None, trials=(refused,))


FUNCTIONS = (effects.quadratic_loss, effects.constant_effort, effects.added_inertia)


@pytest.mark.parametrize(("function", "size"), [(effects.added_inertia, 12.0), (effects.constant_effort, 20.0)])
def test_both_stay_where_each_passes_beside_the_other(function: EffectFunction, size: float) -> None:
    true = added(function, "runner", size, added(effects.quadratic_loss, "runner", 8.0))
    state, done = refused_round(pull(true, 5))
    found = two_laws(state, done, FUNCTIONS, RoundSettings())
    assert found is not None
    both, (first_round, second) = found
    assert first_round.chosen is not None and first_round.chosen.candidate.label == "quadratic_loss at runner"
    assert second.chosen is not None and second.chosen.candidate.effect.name == function.__name__
    parts = {part.candidate.effect.name for law in both.laws for part in (law, *law.forms)}
    assert parts == {"quadratic_loss", function.__name__}
    assert both.fit.values["c_quadratic_loss_runner"] == pytest.approx(8.0, rel=0.1)
    assert all(one.evidence is not None and one.evidence.accepted(LEVEL) for one in both.laws)
    first, *_ = both.history
    assert first.what == "quadratic_loss at runner" and "without that it does not pass" in first.why


def test_nothing_is_learnt_where_no_second_law_is_found() -> None:
    state, done = refused_round(pull(added(effects.quadratic_loss, "runner", 8.0), 5))
    assert two_laws(state, done, FUNCTIONS, RoundSettings()) is None


def cell() -> bg.BondGraph:
    """A cell in a climate chamber, declared with a constant resistance and without polarisation."""
    g = bg.BondGraph("cell")
    current = g.input("I", "A", "charging current", hold=True)
    around = g.input("Ta", "K", "climate chamber", hold=True)
    open_circuit = g.parameter("U0", 3.3, "V")
    charge = g.parameter("Cq", 1.0e5, "F", "", (4e4, 4e5))
    ohm = g.parameter("R", 0.0031, "ohm", "", (0.0005, 0.02))
    heat, film = g.parameter("Ct", 520.0, "J/K", "", (150.0, 2e3)), g.parameter("Gt", 0.55, "W/K", "", (0.05, 4.0))
    terminal, series = g.zero_junction("terminal", bg.ELECTRICAL), g.one_junction("series", bg.ELECTRICAL)
    plates, body = g.zero_junction("plates", bg.ELECTRICAL), g.zero_junction("body", bg.THERMAL)
    chamber, air = g.zero_junction("chamber", bg.THERMAL), g.one_junction("film", bg.THERMAL)
    g.flow_source("cycler", current, at=terminal)
    g.bond(terminal, series)
    ohmic = g.resistance("ohmic", lambda i: ohm * i, at=series)
    g.bond(series, plates)
    g.compliance("charge", lambda q: open_circuit + q / charge, at=plates, state="q", initial=36000.0)
    g.flow_source("heat", ohmic.effort * ohmic.flow, at=body)
    g.compliance("mass", lambda stored: stored / heat, at=body, state="H", initial=1.55e5)
    g.effort_source("air", around, at=chamber)
    g.bond(body, air)
    g.bond(air, chamber)
    g.resistance("convection", flow=lambda d: film * d, at=air)
    g.measure_effort("voltage", terminal)
    g.measure_effort("temperature", body)
    return g


def cycled(seed: int, mean: float) -> bg.Log:
    """A log at 0.2 Hz, by scipy: R exp(2300 K (1/T - 1/298 K)), and 2.2 mohm with 75 s beside it.

    All of that warms the cell. The current changes every so many samples on the mean.
    """
    chance, samples = np.random.default_rng(seed), 1200
    time: FloatArray = 5.0 * np.arange(samples)
    current, k, charge = np.zeros(samples), 2, 36000.0
    while k < samples:
        size, length = round(chance.uniform(-70.0, 50.0)), max(3, int(chance.exponential(mean)))
        size = size if 6000.0 < charge + 5.0 * size * length < 70000.0 else 0
        current[k : k + length] = size
        charge, k = charge + 5.0 * size * length, k + length
    around = np.round(np.interp(time, time[::300], chance.uniform(268.0, 313.0, time[::300].size)), 1)

    def resistance(warm: float) -> float:
        return 0.0038 * exp(2300.0 * (1.0 / warm - 1.0 / 298.0))

    def rates(t: float, x: np.ndarray) -> list[float]:
        n = min(int(t / 5.0), samples - 1)
        i = current[n]
        warmed = resistance(x[1]) * i**2 + x[2] ** 2 / 0.0022 - 0.45 * (x[1] - around[n])
        return [i, warmed / 430.0, (0.0022 * i - x[2]) / 75.0]

    x, states = np.array([36000.0, around[0], 0.0]), []
    for n in range(samples):
        states.append(x)
        x = solve_ivp(rates, (time[n], time[n] + 5.0 * (1.0 - 1e-12)), x, rtol=1e-8, atol=1e-8).y[:, -1]
    q, warm, slow = np.array(states).T
    voltage = 3.3 + q / 9e4 + np.array([resistance(one) for one in warm]) * current + slow
    columns = {
        "I": ("A", current), "Ta": ("K", around),
        "voltage": ("V", voltage + 0.004 * chance.standard_normal(samples)),
        "temperature": ("K", warm + 0.2 * chance.standard_normal(samples)),
    }  # fmt: skip
    return bg.Log(f"cycled_{seed}", time, {name: bg.LogChannel(name, *own) for name, own in columns.items()})


@pytest.mark.slow
def test_two_effects_of_a_cell_that_hide_each_other_are_both_found() -> None:
    """Where neither passed alone the resistance was told to change at 3915 s, which is no law."""
    closed = bg.close_loop(cell(), [cycled(1, 12.0), cycled(2, 100.0)], [cycled(3, 14.0)])
    labels = {one.trial.candidate.label for one in closed.added}
    assert labels >= {"thermal_activation at series", "polarisation at series"} and not closed.events
    values = closed.corrected.values
    assert values["b_thermal_activation_series"] == pytest.approx(2300.0, rel=0.05)
    assert values["c_polarisation_series"] == pytest.approx(0.0022, rel=0.05)
    assert values["T_polarisation_series"] == pytest.approx(75.0, rel=0.05)
    (heat,) = labels - {"thermal_activation at series", "polarisation at series"}  # what the slow part gives the body
    assert "square_of_follows_polarisation_series" in heat
