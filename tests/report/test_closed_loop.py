"""What a terminal is told of a closed loop."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.correct.places.structure import Structure
from bondgraph.correct.places.unexplained import Unexplained
from bondgraph.correct.shapes.forms import joined
from bondgraph.declare.effect import Place, Scale
from bondgraph.estimate.free import FreeParameter
from bondgraph.report.closed_loop import all_series, explanation, on_bounds, structure_lines, summary
from bondgraph.report.formulas import formula_sentences, headline_name
from bondgraph.report.html import write_report
from bondgraph.report.series import Power
from bondgraph.report.unknown import shape_sentence
from tests.correct.sled import added, pull, sled
from tests.report.examples import coast_down_report


def test_coefficients_are_told_with_their_units_and_intervals() -> None:
    data = coast_down_report()
    assert "c_drag = 0.559 kg/m [0.518, 0.599]" in summary(data)
    (effect,) = data.effects
    share = replace(effect.coefficients[0], name="share", value=0.0272, unit="1", ci95=(0.0259, 0.0284))
    bare = replace(data, effects=(replace(effect, coefficients=(share,)),))
    assert "share = 0.0272 [0.0259, 0.0284]" in summary(bare)


@pytest.mark.usefixtures("undrawn")
def test_errors_come_before_the_sizes_that_would_have_been_found(tmp_path: Path) -> None:
    data = replace(coast_down_report(), effects=(), power=(Power("drag", "body", 0.12, "kg/m"),))
    told = summary(data)
    assert 0 < told.index("error before and after") < told.index("smallest size found")
    write_report(data, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert 0 < page.index('<section id="errors">') < page.index('<section id="power">')


def test_an_unknown_function_is_told_with_the_units_of_both() -> None:
    place = Place.sensor("way", Scale(1.0, 1.0))
    found = Unexplained(
        place, "effort", "effort of rope", "N", "V", np.array([-1.0, 2.0]), np.array([0.03, -0.04]), np.full(2, 0.005),
        12.0, 1e-4,
    )  # fmt: skip
    told = "[V] over effort of rope [N], less what free parameters can take of it: 0.0300 ± 0.00500 at -1.00; "
    assert told in shape_sentence(found)
    assert shape_sentence(found).endswith(
        "Positive values take power from a positive flow there, as a brake does; negative ones drive it."
    )
    assert "flow out of the junction" in shape_sentence(replace(found, variable="flow"))
    bare = replace(found, signal="slip", signal_unit="", unit="", taken=("k",))
    assert "sensor way over slip, less what k can take of it: " in shape_sentence(bare)


def test_a_form_of_its_own_is_named_with_how_far_it_is_from_its_name() -> None:
    """A headline called a sum of a dead zone, three powers and a clip "actuator_dead_zone", and no more."""
    log = pull(added(effects.quadratic_loss, "runner", 1.0), 8, samples=1000)
    closed = close_loop(sled(), [log], [], (effects.quadratic_loss,))
    (found,) = closed.added
    assert headline_name(closed, found) == "quadratic_loss at runner"
    candidate, row = found.trial.candidate, closed.corrected.problem.names.index(found.coefficients[0])
    spring = replace(found, trial=replace(found.trial, candidate=replace(
        candidate, effect=replace(candidate.effect, name="hardening_spring")
    )))  # fmt: skip
    assert "softens" not in headline_name(closed, spring)
    negative = closed.corrected.point.copy()
    negative[row] = -1.0
    turned = replace(closed, corrected=replace(closed.corrected, point=negative))
    assert headline_name(turned, spring).endswith("hardening_spring at runner, which softens")
    whole = replace(found, trial=joined(found.trial, found.trial))  # twice the same is the same curve
    assert headline_name(closed, whole) == "quadratic_loss at runner in a form of its own"
    far = replace(closed, added=(whole,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bondgraph.report.formulas.departs", lambda added, closed: 0.118)
        said = "The declared model lacks quadratic_loss at runner in a form of its own, 12 % from it"
        assert explanation(far).startswith(said)


def test_a_sum_of_laws_of_one_signal_is_named_by_all_of_them() -> None:
    """Drag and dry friction of a bicycle were called "stribeck_loss at road in a form of its own, 47 % from it"."""
    log = pull(added(effects.quadratic_loss, "runner", 1.0), 8, samples=1000)
    closed = close_loop(sled(), [log], [], (effects.quadratic_loss,))
    (found,) = closed.added
    other = replace(found.trial.candidate, effect=replace(found.trial.candidate.effect, name="coulomb_loss"))
    both = replace(closed, added=(replace(found, trial=joined(found.trial, replace(found.trial, candidate=other))),))
    said = explanation(both)
    assert said.startswith("The declared model lacks the sum of quadratic_loss and coulomb_loss at runner")
    assert any(
        line.startswith("Of quadratic_loss and coulomb_loss at runner these logs tell the sum alone: effort = ")
        for line in formula_sentences(both)
    )


def test_noise_with_a_memory_is_noise_of_its_sensor() -> None:
    """A column said 0.0115 K of noise beside errors of 0.14 K, most of which was noise with a memory."""
    closed = close_loop(sled(), [pull(sled(), 8)], [], (effects.quadratic_loss,))
    effect = SimpleNamespace(channel="force")
    one = SimpleNamespace(trial=SimpleNamespace(candidate=SimpleNamespace(effect=effect)), size=4.0, period=0.0)
    white = {series.channel: series.noise_std for series in all_series(closed)}
    both = {series.channel: series.noise_std for series in all_series(replace(closed, disturbances=(one,)))}  # type: ignore[arg-type]
    assert both["force"] == pytest.approx(np.hypot(white["force"], 4.0)) and both["speed"] == white["speed"]


def test_outputs_that_add_elements_of_one_junction_are_told_with_the_structure() -> None:
    loop = SimpleNamespace(structure=Structure((), (), ("force",), ("force is declared as a sum",)), added=())
    assert structure_lines(cast(ClosedLoop, loop))[-1] == "force is declared as a sum."


def test_one_sensor_is_no_several() -> None:
    for sensors, words in (
        (("force",), "the sensor force can tell"),
        (("force", "v"), "the sensors force, v can tell"),
    ):
        for laws in ((), ("law",)):
            loop = SimpleNamespace(structure=Structure((), (), sensors, ()), added=laws)
            (said,) = structure_lines(cast(ClosedLoop, loop))
            assert words in said and ("stands beside each effect" in said) == bool(laws)


def test_a_declared_parameter_on_its_bound_is_told_beside_what_was_found() -> None:
    """An effect was "found" and confirmed while a declared loss stood on a bound that forbade the true one."""
    free = (FreeParameter("G", 0.5, 4.0, 2.0), FreeParameter("loss", 0.0, 9.0, 1.0))
    values = {"G": 0.5, "loss": 1.0}
    corrected = SimpleNamespace(problem=SimpleNamespace(free=free), held=np.array([True, False]), values=values)
    nominal = SimpleNamespace(problem=SimpleNamespace(names=("G",), free=free[:1]))
    loop = SimpleNamespace(added=("loss",), corrected=corrected, nominal=nominal)
    (said,) = on_bounds(cast(ClosedLoop, loop))
    assert said == "But G rests on its bound beside it: what was found may make good for what this bound forbids."
    corrected.values = {"G": 0.005, "loss": 1.0}  # the law takes the place of its element
    assert on_bounds(cast(ClosedLoop, loop)) == []
    corrected.values = values
    corrected.held = np.array([False, True])  # of a coefficient of the law itself nothing is said
    assert on_bounds(cast(ClosedLoop, loop)) == []
    corrected.held, loop.added = np.array([True, False]), ()
    assert on_bounds(cast(ClosedLoop, loop)) == []
