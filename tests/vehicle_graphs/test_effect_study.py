"""The study of effects: its logs, its sizes, its scores, its resumption and tables, and a small study that is real."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.effects import sensors
from bondgraph.errors import DataError, OptionError
from bondgraph.execute import open_executor
from vehicle_graphs.effect_study import __main__ as command
from vehicle_graphs.effect_study import generate, tables
from vehicle_graphs.effect_study import study as running
from vehicle_graphs.effect_study.cases import FAMILIES, NOTHING, Case, all_cases
from vehicle_graphs.effect_study.generate import LARGEST, Drawn, draw, sensor_noise
from vehicle_graphs.effect_study.machine import Kind, StudyMachine
from vehicle_graphs.effect_study.machines import BENCH, MACHINES, RANGER, ROAD
from vehicle_graphs.effect_study.scoring import Answer, Hit, Outcome, compare
from vehicle_graphs.effect_study.study import Study, close_case

DRAG = Case("effect", "quadratic_loss at body", 3.0, 0)
QUICK = replace(BENCH, functions=(effects.quadratic_loss, effects.added_inertia, effects.coulomb_loss))


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    """Logs of the bench with drag that its declaration lacks."""
    return draw(BENCH, DRAG)


@pytest.fixture(scope="module")
def closed(drawn: Drawn) -> ClosedLoop:
    """The loop closed on them with a small dictionary."""
    return close_loop(QUICK.graph(), drawn.train, drawn.holdout, QUICK.functions, QUICK.settings)


def blank(case: Case, kinds: tuple[Kind, ...] = ()) -> Outcome:
    return Outcome(case.family, case.subject, case.size, case.seed, tuple(Hit(kind.label, "failed") for kind in kinds))


def test_a_case_gives_the_same_logs_again_and_another_seed_others(drawn: Drawn) -> None:
    again, other = draw(BENCH, DRAG), draw(BENCH, replace(DRAG, seed=1))
    for log, same, different in zip(
        (*drawn.train, *drawn.holdout), (*again.train, *again.holdout), (*other.train, *other.holdout), strict=True
    ):
        assert np.array_equal(log.y, same.y) and np.array_equal(log.u, same.u)
        assert not np.array_equal(log.u, different.u)
    assert [log.name for log in (*drawn.train, *drawn.holdout)] == ["train_1", "holdout_1"]
    assert all(not log.theta_overrides for log in drawn.train)


def test_an_effect_leaves_the_wanted_size_and_shows_more(drawn: Drawn) -> None:
    assert max(drawn.left.values()) == pytest.approx(3.0, rel=0.1)
    assert 2.0 * max(drawn.left.values()) < max(drawn.shown.values()) < 1.05 * LARGEST
    samples = drawn.train[0].time.size
    assert drawn.promise == pytest.approx(0.5 * samples * sum(one**2 for one in drawn.left.values()), rel=1e-9)
    ((_, coefficients),) = drawn.truth.values.items()
    ((name, value),) = coefficients.items()
    assert name == "c_quadratic_loss_body" and 0.01 < value < 0.3


def test_the_logs_of_a_road_show_its_waves_and_not_its_profile() -> None:
    short = replace(ROAD, seconds=10.0)
    drawn = draw(short, Case("none", "as declared", 0.0, 0))
    level = draw(replace(short, excite=RANGER.excite), Case("none", "as declared", 0.0, 0))
    pitch, rate = drawn.truth.model.index("output", "pitch"), drawn.truth.model.index("input", "inclination_rate")
    for log, same in zip((*drawn.train, *drawn.holdout), (*level.train, *level.holdout), strict=True):
        assert not log.u[rate].any()
        assert log.y[pitch].std() > 3.0 * same.y[pitch].std()


def test_a_fault_shows_in_its_own_sensor_only() -> None:
    known = draw(BENCH, Case("fault", "sensor_bias at sensor speed", 3.0, 0))
    assert known.shown["speed"] > 2.9
    assert {name for name, shown in known.shown.items() if shown > 1e-9} == {"speed"}


def test_an_effect_that_the_drives_do_not_show_is_not_made_huge() -> None:
    """A torque that never changes its sign takes up play once and for all."""
    with pytest.raises(DataError, match="do not show backlash at twist - it would have to be"):
        draw(BENCH, Case("effect", "backlash at twist", 3.0, 2))


def test_true_parameters_differ_from_the_declared_ones_but_where_it_is_said() -> None:
    nominal = {info.name: info.value for info in BENCH.free()}
    for (name, _), differs in zip(NOTHING, (False, True, True, True), strict=True):
        truth = draw(BENCH, Case("none", name, 0.0, 5)).truth
        values = {free: truth.on[truth.model.index("parameter", free)] for free in nominal}
        off = [abs(values[free] / nominal[free] - 1.0) for free in nominal]
        assert (max(off) > 0.0) == differs and max(off) <= BENCH.spread + 1e-12
        assert not truth.kinds and truth.values == {}


def test_an_effect_in_part_of_the_data_begins_half_way() -> None:
    truth = draw(BENCH, Case("part", "coulomb_loss at axle", 3.0, 2)).truth
    drives = generate.in_last_part([generate.Drive(log, 0) for log in draw(BENCH, DRAG).train])
    (half,) = [drive.begin for drive in drives]
    assert half == len(drives[0].pattern) // 2
    part, off = (generate.outputs(BENCH, truth.model, drives, truth.off, on) for on in (truth.on, truth.off))
    gap = np.abs(part - off)[truth.model.index("output", "axle_speed"), :, 0]
    assert gap[: half + 1].max() == 0.0 and gap[half + 5 :].min() > 0.0 and gap[half + 20 :].max() > 0.1
    pair = generate.in_last_part([*drives, *drives])
    assert [drive.begin for drive in pair] == [len(drives[0].pattern), 0]


def test_noise_has_unit_variance_and_the_promised_shape() -> None:
    rng = np.random.default_rng(3)
    drawn = {kind: sensor_noise(kind, (2, 40000), rng) for kind in ("white", "coloured", "heavy")}
    for noise in drawn.values():
        assert noise.shape == (2, 40000) and noise.std() == pytest.approx(1.0, abs=0.15)
    assert abs(np.corrcoef(drawn["white"][0, 1:], drawn["white"][0, :-1])[0, 1]) < 0.03
    assert np.corrcoef(drawn["coloured"][0, 1:], drawn["coloured"][0, :-1])[0, 1] == pytest.approx(0.9, abs=0.02)
    assert np.mean(np.abs(drawn["heavy"]) > 4.0) > 10.0 * np.mean(np.abs(drawn["white"]) > 4.0)


@pytest.mark.parametrize("machine", MACHINES.values(), ids=lambda machine: machine.name)
def test_every_effect_of_a_machine_makes_sense_at_its_place(machine: StudyMachine) -> None:
    known = {function.__name__ for function in (*machine.functions, *sensors.SENSOR_FAULTS)}
    assert len(machine.kinds) >= 12 and len({kind.label for kind in machine.kinds}) == len(machine.kinds)
    if machine is BENCH:  # deriving the vehicle so often takes minutes; the slow test does
        for kind in (*machine.kinds, *machine.faults):
            _, (effect,) = machine.model((kind,))
            assert len(effect.coefficients) == 1 + len(kind.ratios) and len(effect.shapes) == len(kind.shapes)
            assert effect.name == kind.name
    for kind in (*machine.kinds, *machine.faults):
        assert kind.name in known and set(kind.relatives) <= known - {kind.name}


def test_an_effect_at_an_impossible_place_is_refused() -> None:
    with pytest.raises(OptionError, match="slip at axle: makes no sense in driveline - take another place"):
        BENCH.model((Kind(effects.slip, "axle", 1.0),))


def test_cases_go_round_all_kinds_before_any_comes_again() -> None:
    cases = all_cases(BENCH, FAMILIES, (), (1.0, 3.0), 10)
    assert len(set(cases)) == len(cases) and len({case.name for case in cases}) == len(cases)
    assert [case.seed for case in cases if case.family == "effect"] == sorted(
        case.seed for case in cases if case.family == "effect"
    )
    assert sum(case.family == "effect" for case in cases) == 10 * 2 * len(BENCH.kinds)
    assert sum(case.family == "none" for case in cases) == 100
    assert {case.family for case in cases} == set(FAMILIES)
    masked = next(case for case in cases if case.family == "masking")
    assert len(masked.kinds(BENCH)) == 2 and masked.missing_functions(BENCH) == ()
    outside = next(case for case in cases if case.family == "outside" and case.subject == "quadratic_loss at body")
    left = {function.__name__ for function in BENCH.dictionary(outside.missing_functions(BENCH))}
    assert not left & {"quadratic_loss", "headwind", "rolling_speed_loss"} and "coulomb_loss" in left
    near = replace(outside, family="relative")
    assert near.missing_functions(BENCH) == ("quadratic_loss",)
    (only,) = all_cases(BENCH, ["effect"], ["slip at belt"], [1.0], 1)
    assert only.subject == "slip at belt"
    with pytest.raises(OptionError, match="bench: no effect 'slip at blet'; did you mean 'slip at belt'"):
        all_cases(BENCH, ["effect"], ["slip at blet"], [1.0], 1)


def test_later_seeds_give_other_cases_as_many() -> None:
    early, late = (all_cases(BENCH, FAMILIES, (), (1.0, 3.0), 10, first) for first in (0, 20))
    assert late == [replace(case, seed=case.seed + 20) for case in early]
    for seeds, first in ((0, 0), (1, -1)):
        with pytest.raises(OptionError, match=f"{seeds} seeds from {first} on - take one or more"):
            all_cases(BENCH, FAMILIES, (), (1.0,), seeds, first)


@pytest.mark.slow
def test_the_right_answer_is_scored_as_right_with_its_interval(drawn: Drawn, closed: ClosedLoop) -> None:
    outcome = compare(blank(DRAG, drawn.truth.kinds), closed, drawn)
    assert (outcome.verdict, outcome.found, outcome.extra) == ("effect found", ("quadratic_loss at body",), ())
    (hit,) = outcome.hits
    assert hit.answer == "exact" and hit.covered in (True, False) and outcome.is_right
    assert {"quadratic_loss at body", "quadratic_loss at wheel"} <= set(hit.group)
    (known,) = hit.coefficients.values()
    assert known["low"] < known["estimate"] < known["high"] and known["true"] == pytest.approx(
        known["estimate"], rel=0.3
    )
    assert outcome.after["nll"] < outcome.before["nll"]
    assert outcome.after["speed"] < 1.5 and set(outcome.after) == {"nll", *BENCH.noise}
    assert Outcome.read(json.loads(json.dumps(outcome.written()))) == outcome


def as_if(drawn: Drawn, *kinds: Kind) -> Drawn:
    """The same logs, as if other effects had made them."""
    model, made = BENCH.model(kinds)
    truth = replace(drawn.truth, kinds=kinds, effects=made, model=model, on=model.theta(), off=model.theta())
    return replace(drawn, truth=truth)


@pytest.mark.slow
def test_other_answers_are_scored_by_place_and_group(drawn: Drawn, closed: ClosedLoop) -> None:
    at_place = compare(blank(DRAG), closed, as_if(drawn, Kind(effects.added_inertia, "body", 1.0)))
    assert [hit.answer for hit in at_place.hits] == ["place"]
    assert at_place.hits[0].place_right and not at_place.is_right and at_place.extra == ()
    twin = compare(blank(DRAG), closed, as_if(drawn, Kind(effects.quadratic_loss, "wheel", 1.0)))
    assert [hit.answer for hit in twin.hits] == ["group"] and twin.is_right  # geared rigidly to the body
    elsewhere = compare(blank(DRAG), closed, as_if(drawn, Kind(effects.slip, "belt", 1.0)))
    (hit,) = elsewhere.hits
    assert (hit.answer, hit.found, elsewhere.is_right) == ("wrong", "quadratic_loss at body", False)
    both = compare(blank(DRAG), closed, as_if(drawn, *drawn.truth.kinds, Kind(effects.slip, "belt", 1.0)))
    assert [hit.answer for hit in both.hits] == ["exact", "none"] and not both.is_right
    alarm = compare(blank(DRAG), closed, as_if(drawn))
    assert alarm.extra == ("quadratic_loss at body",) and not alarm.is_right
    nothing = replace(closed, added=(), verdict="unexplained residual")
    (hit,) = compare(blank(DRAG), nothing, drawn).hits
    assert hit.answer == "unexplained" and hit.covered is None


def test_what_stops_a_case_is_an_outcome() -> None:
    broken = replace(QUICK, functions=())
    outcome = close_case(broken, replace(DRAG, size=1.0))
    assert outcome.failure.startswith("OptionError: driveline: no effect to try")
    assert [hit.answer for hit in outcome.hits] == ["failed"] and not outcome.is_right and outcome.seconds > 0.0
    assert max(outcome.left.values()) == pytest.approx(1.0, rel=0.1)


def made_up(machine: StudyMachine, case: Case) -> Outcome:
    """An outcome by the case's seed: mostly right; without an effect one alarm in ten."""
    rng = np.random.default_rng([case.seed, len(case.subject)])
    answers: list[Answer] = ["exact", "exact", "group", "exact", "wrong", "exact", "none"]
    answer = answers[int(rng.integers(len(answers)))] if case.size < 3.0 else "exact"
    named = {"exact": case.subject, "group": "headwind at body", "wrong": "slip at belt"}.get(answer, "")
    hits = tuple(Hit(kind.label, answer, named) for kind in case.kinds(machine))
    found = ("slip at belt",) if not hits and case.seed % 10 == 9 else tuple(filter(None, [named] if hits else []))
    sizes = dict.fromkeys(machine.noise, case.size)
    return Outcome(
        case.family, case.subject, case.size, case.seed, hits, "effect found" if found else "no missing effect",
        found=found, extra=() if hits else found, shown={name: 4.0 * one for name, one in sizes.items()}, left=sizes,
        before={"nll": 10.0, "speed": 3.0}, after={"nll": 5.0, "speed": 1.0}, seconds=2.0,
    )  # fmt: skip


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[Case]:
    """Made-up outcomes in place of closed loops; the list says which were asked for."""
    asked: list[Case] = []

    def close(machine: StudyMachine, case: Case) -> Outcome:
        asked.append(case)
        return made_up(machine, case)

    monkeypatch.setattr(running, "close_case", close)
    return asked


def test_a_study_goes_on_where_it_stopped_whoever_computes(tmp_path: Path, quick: list[Case]) -> None:
    study = Study(tmp_path, BENCH)
    cases = all_cases(BENCH, ["effect"], (), (1.0,), 2)
    seen: list[Outcome] = []
    first = study.run(cases[:10], seen.append)
    assert quick == cases[:10] and seen == first
    with ThreadPoolExecutor(2) as executor:
        found = study.run(cases, seen.append, executor)
    assert sorted(map(str, quick)) == sorted(map(str, cases)) and found[:10] == first
    assert [(one.subject, one.seed) for one in found] == [(case.subject, case.seed) for case in cases]
    assert len(list((tmp_path / "cases").iterdir())) == len(cases)
    assert Study(tmp_path, BENCH).run(cases, seen.append, until=0.0) == found
    assert Study(tmp_path, BENCH).run([DRAG, *cases], seen.append, until=0.0) == found
    with pytest.raises(DataError, match="take another folder or remove this one"):
        Study(tmp_path, BENCH.shortened()).run(cases, seen.append)


@pytest.mark.rendered
def test_the_command_prints_tables_and_writes_results(
    tmp_path: Path, quick: list[Case], capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--out", str(tmp_path), "--machine", "bench", "--sizes", "1", "3"]
    assert command.main([*options, "--families", "effect", "none"]) == 0
    text = capsys.readouterr().out
    assert "bench, 420 of 420 cases" in text and "no effect (intervals of Clopper and Pearson)" in text
    assert "8/100 = 8 % (4 to 15 %)" in text
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert result["one_effect"]["by_size"]["3"]["right"]["share"] == 1.0
    assert result["one_effect"]["left_three_times_the_noise"]["right"]["runs"] == 10 * len(BENCH.kinds)
    assert result["no_effect"]["all"]["false_alarm"]["hits"] == 8 and len(result["cases"]) == 420
    assert sum(result["confusion"]["slip at belt"].values()) == 20
    assert (tmp_path / "confusion.png").stat().st_size > 10_000
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "bench, 420 of 420 cases." in page and "8/100 = 8 % (4 to 15 %)" in page
    assert "<h2>What was said of every missing effect</h2>" in page
    assert command.main([*options, "--families", "outside", "--seeds", "1", "--first-seed", "40"]) == 0
    assert {case.seed for case in quick[420:]} == {40}
    capsys.readouterr()
    assert command.main([*options, "--kinds", "nothing at all"]) == 2
    assert "no effect 'nothing at all'" in capsys.readouterr().err


def test_an_interrupted_command_shows_what_is_there_and_goes_on(
    tmp_path: Path, quick: list[Case], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def close(machine: StudyMachine, case: Case) -> Outcome:
        if len(quick) == 3:
            raise KeyboardInterrupt
        quick.append(case)
        return made_up(machine, case)

    options = ["--out", str(tmp_path), "--machine", "bench", "--families", "effect", "--sizes", "1", "--seeds", "1"]
    with monkeypatch.context() as patched:
        patched.setattr(running, "close_case", close)
        assert command.main(options) == 130
    printed = capsys.readouterr()
    assert f"bench, 3 of {len(BENCH.kinds)} cases" in printed.out and "goes on with what is in" in printed.err
    assert command.main(options) == 0
    assert f"{len(BENCH.kinds)} of {len(BENCH.kinds)} cases" in capsys.readouterr().out
    assert len(quick) == len(BENCH.kinds)


class _Deadly(Executor):
    """Workers that die of every task of the second seed."""

    def submit(self, fn: Callable[..., Outcome], /, *args: Any, **kwargs: Any) -> Future[Outcome]:
        future: Future[Outcome] = Future()
        _, case, _ = args
        if case.seed == 1:
            future.set_exception(BrokenProcessPool("out of memory"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_a_case_whose_process_dies_is_an_outcome_and_the_study_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "close_case", made_up)
    cases = [replace(DRAG, seed=seed) for seed in range(3)]
    found = Study(tmp_path, BENCH).run(cases, lambda _: None, _Deadly())
    assert [one.failure for one in found[::2]] == ["", ""]
    assert "died twice without an answer" in found[1].failure
    assert found[1].hits == (Hit("quadratic_loss at body", "failed"),)


@pytest.mark.slow
def test_processes_give_what_this_process_gives(tmp_path: Path) -> None:
    machine = QUICK.shortened()
    cases = [Case("none", name, 0.0, seed) for seed in range(2) for name, _ in NOTHING[:1]]
    with open_executor("processes:2") as executor:
        there = Study(tmp_path / "there", machine).run(cases, lambda _: None, executor)
    here = Study(tmp_path / "here", machine).run(cases, lambda _: None)
    untimed = [[replace(one, seconds=0.0, processor_seconds=0.0) for one in found] for found in (there, here)]
    assert untimed[0] == untimed[1]


def test_answers_about_what_the_dictionary_lacks_are_told_apart() -> None:
    case = Case("outside", "quadratic_loss at body", 3.0, 0)
    plain = blank(case)

    def one(answer: Answer, verdict: str = "effect found", found: str = "x at y", **others: object) -> str:
        hits = (Hit(case.subject, answer, found),)
        return tables.kind_of_answer(
            replace(plain, hits=hits, verdict=verdict, found=(found,) if found else (), **others)
        )

    left = "unexplained residual"
    assert one("exact") == "right"
    assert one("place") == "another effect at its place"
    assert one("wrong") == "another effect elsewhere"
    assert one("unexplained", left, "", unexplained="body", unexplained_right=True) == "unexplained at its place"
    assert one("unexplained", left, "", unexplained="belt") == "unexplained elsewhere"
    assert one("unexplained", left, "") == "unexplained, no place"
    assert one("none", "no missing effect", "") == "none"
    assert one("exact", extra=("z at w",)) == "right, and another beside it"
    assert one("failed", "", "", failure="ValueError: 1") == "failed"


@pytest.mark.slow
def test_a_small_study_is_right_about_a_clear_effect_and_about_none(tmp_path: Path) -> None:
    cases = [replace(DRAG, seed=1), Case("none", "other parameters", 0.0, 1)]
    effect, nothing = Study(tmp_path, QUICK).run(cases, lambda _: None)
    assert effect.is_right and effect.hits[0].answer == "exact"
    assert nothing.is_right and nothing.verdict == "no missing effect" and nothing.found == ()
    assert max(effect.before.values()) > 2.0 * max(effect.after[name] for name in BENCH.noise)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [RANGER.kinds[0], RANGER.kinds[4]], ids=lambda kind: kind.label)
def test_the_vehicle_shows_an_effect_of_the_wanted_size(kind: Kind) -> None:
    known = draw(replace(RANGER, seconds=12.0), Case("effect", kind.label, 3.0, 0))
    assert max(known.left.values()) == pytest.approx(3.0, rel=0.15)
    assert np.isfinite(known.train[0].y).all() and known.train[0].y.shape == (5, 240)
