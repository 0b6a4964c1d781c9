"""The demonstration: reproducible drives without a trace of the truth, and the truth found by closing the loop."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.data.matching import match
from bondgraph.data.read import read_log
from bondgraph.declare.effect import EffectFunction, effect_functions
from vehicle_graphs.demo import MISSING, SENSOR_NOISE, Missing, Truth, pick, write_drives
from vehicle_graphs.driveline import driveline


@pytest.mark.slow
def test_drives_are_the_same_for_the_same_seed_and_differ_for_others(tmp_path: Path) -> None:
    texts = []
    for folder, seed in (("a", 3), ("b", 3), ("c", 4)):
        (tmp_path / folder).mkdir()
        train, holdout, _ = write_drives(seed, tmp_path / folder, MISSING[0])
        assert [path.name for path in (*train, *holdout)] == ["train_1.csv", "train_2.csv", "holdout_1.csv"]
        texts.append([path.read_bytes() for path in (*train, *holdout)])
    assert texts[0] == texts[1] != texts[2]


@pytest.mark.slow
def test_logs_hold_measurements_and_nothing_of_the_truth(tmp_path: Path) -> None:
    """And in all of them the engine runs forwards and the speed varies."""
    for missing in (MISSING[1], None):
        train, holdout, truth = write_drives(5, tmp_path, missing)
        assert truth.effect == ("coulomb_loss" if missing else "none")
        for path in (*train, *holdout):
            log = read_log(path)
            assert set(log.channels) == {"engine_torque", "grade", *SENSOR_NOISE}
            assert np.median(log.channels["engine_speed"].numbers) > 100.0
            assert np.ptp(log.channels["speed"].numbers) > 3.0
            text = path.read_text().lower()
            assert not any(word in text for word in ("coulomb", "loss", "none", "c_", "load"))
        assert sorted(path.name for path in tmp_path.iterdir()) == ["holdout_1.csv", "train_1.csv", "train_2.csv"]


def test_every_seed_picks_an_entry_and_all_are_picked() -> None:
    assert {MISSING.index(pick(seed)) for seed in range(100)} == set(range(len(MISSING)))


def closed(
    seed: int, folder: Path, missing: Missing | None, offered: Sequence[EffectFunction] = effect_functions(effects)
) -> tuple[ClosedLoop, Truth]:
    train, holdout, truth = write_drives(seed, folder, missing)
    model = build(driveline()).model
    logs = [[match(read_log(path), model) for path in paths] for paths in (train, holdout)]
    return close_loop(driveline(), *logs, offered), truth


def check_found(loop: ClosedLoop, truth: Truth) -> None:
    """One effect: the true one, or one that these sensors cannot tell from it with the truth named beside it."""
    assert loop.verdict == "effect found"
    (added,) = loop.added
    group = [f"{a.name}@{a.junction}" for a in loop.rounds[0].alternatives if a.indistinguishable]
    candidate = added.trial.candidate
    named = f"{candidate.effect.name}@{candidate.place.label}"
    assert f"{truth.effect}@{truth.junction}" in (named, *group)
    if named == f"{truth.effect}@{truth.junction}":
        ((name, value),) = truth.coefficients.items()
        assert loop.corrected.values[name] == pytest.approx(value, rel=0.1)
    assert loop.corrected_holdout.nll < loop.nominal_holdout.nll


#: What the demonstration hides, and near relatives of it.
RELATIVES = (*dict.fromkeys(one.function for one in MISSING), effects.stribeck_loss, effects.slip)


@pytest.mark.slow
@pytest.mark.parametrize("offered", [RELATIVES, effect_functions(effects)], ids=["relatives", "all"])
def test_the_demonstration_finds_its_missing_effect(offered: Sequence[EffectFunction], tmp_path: Path) -> None:
    loop, truth = closed(1, tmp_path, pick(1), offered)
    check_found(loop, truth)
    for name, error in loop.corrected_holdout.channels.items():
        assert error.simulation_rmse < 1.5 * SENSOR_NOISE[name]


@pytest.mark.slow
@pytest.mark.parametrize("index", range(len(MISSING)))
def test_every_missing_effect_is_found(index: int, tmp_path: Path) -> None:
    check_found(*closed(21 + index % 2, tmp_path, MISSING[index]))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [21, 24, 26])
def test_with_nothing_missing_no_effect_is_claimed(seed: int, tmp_path: Path) -> None:
    loop, _ = closed(seed, tmp_path, None)
    assert loop.added == ()
    # whiteness is tested at 1 %: the noise of seed 26 is by chance so coloured that it is called a residual
    assert loop.verdict == ("no missing effect" if seed != 26 else "unexplained residual")
    assert all(one.size > 0.0 for one in loop.detectable)
