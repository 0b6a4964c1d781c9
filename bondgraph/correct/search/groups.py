"""Groups of candidates that no sensor tells apart, and which of them stands for the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.correct.constants import CHANCE
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.scores.score import SAME, Scores
from bondgraph.data.log import FloatArray


def alike(trials: Sequence[Trial], found: Scores, least: float) -> list[list[int]]:
    """Indices of candidates worth a refit, those with the same response together, the preferred one of each first.

    A law that is not smooth at zero is told little by its score, which is no reason to pass it over. Nor is one of more
    coefficients the same as one of fewer, though its step may be: a fit may move them apart. So it does where one of
    two different laws is not straight in its coefficients: a spring that nears a limit begins as one with a cube.

    Parameters
    ----------
    trials, found
        Candidates and their scores, in the same order.
    least
        Gain in nats that a candidate must promise.
    """
    groups: list[list[int]] = []
    for j in map(int, np.argsort(-found.gain, kind="stable")):
        if found.gain[j] <= least:
            break
        size = len(found.steps[j])
        twin = next(
            (
                group
                for group in groups
                if abs(found.correlation[group[0], j]) > SAME
                and len(found.steps[group[0]]) == size
                and not trials[group[0]].candidate.parts_from(trials[j].candidate)
            ),
            None,
        )
        if twin is not None:
            twin.append(j)
        elif found.p_value[j] < CHANCE or trials[j].candidate.effect.amplitudes:
            groups.append([j])
    return [
        sorted(group, key=lambda j: (*remoteness(trials[j].candidate, found.steps[j]), j)) for group in groups
    ]  # fmt: skip


def remoteness(candidate: Candidate, step: Sequence[float] | FloatArray = ()) -> tuple[int, bool, bool, bool, bool]:
    """Order of preference among candidates that the sensors cannot tell apart; the smallest is preferred.

    In this order: fewer parameters, coefficients that may be as large as the score asks for (``step``), a law that only
    takes energy, a law before a fault of a sensor, a place whose flow is that of a storage.
    """
    size = len(candidate.effect.parameters)
    beyond = any(
        not lower <= value <= upper for value, lower, upper in zip(step, candidate.lower, candidate.upper, strict=False)
    )
    return size, beyond, not candidate.passive, bool(candidate.effect.channel), not candidate.beside_storage
