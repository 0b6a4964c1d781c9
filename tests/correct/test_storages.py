"""Storages that are tried at several sizes: how many steps they get, and what those leave remark."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bondgraph.correct import storages
from bondgraph.correct.build import build
from bondgraph.correct.candidates import candidates, places
from bondgraph.correct.decide import alternatives
from bondgraph.correct.fit import fit, noisy_starts
from bondgraph.correct.loop import free_parameters
from bondgraph.correct.refit import Ground
from bondgraph.correct.scoring import linearisation, score_candidates
from bondgraph.correct.setup import FilterSetup, filter_setup
from bondgraph.correct.storages import try_storage
from bondgraph.correct.trials import Trial
from vehicle_graphs import effects
from vehicle_graphs.effect_study.cases import Case
from vehicle_graphs.effect_study.generate import draw
from vehicle_graphs.effect_study.machines import BENCH


def test_a_storage_gets_a_multiple_of_the_steps_at_most_and_says_what_they_do_not_resolve(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    logs = draw(BENCH, Case("none", "as declared", 0.0, 1)).train
    built = build(BENCH.graph())
    setup = filter_setup(built.model, built.driven, logs)
    free = (*free_parameters(setup, ()), *setup.noise)
    base = fit(setup.filter_model, logs, free, starts=noisy_starts(free))
    where = [one for one in places(built, logs, base.runs(logs), base.theta) if one.label == "wheel -> tyre"]
    (candidate,), _ = candidates(built, [effects.added_compliance], where)
    ground = Ground(built, base, logs, 10, 0.01, 5.0)

    def endless(*given: Any) -> FilterSetup:
        own = filter_setup(*given)
        return replace(own, filter_model=replace(own.filter_model, substeps=400))

    monkeypatch.setattr(storages, "filter_setup", endless)
    monkeypatch.setattr(storages, "_MOST_STEPS", 1)
    monkeypatch.setattr(storages, "_SIZES", (0.01, 0.5))  # the first far stiffer than these steps resolve
    tried = try_storage(Trial(candidate, 0.0), ground, float("inf"))
    steps = base.problem.filter_model.substeps
    assert f"was not tried, for which {steps} steps from sample to sample are too few" in tried.remark
    assert tried.evidence is None or not tried.evidence.accepted(0.01)
    (said,) = alternatives(None, [tried], score_candidates(linearisation(base, logs), []).scores, 0.01)
    assert tried.remark in said.why
