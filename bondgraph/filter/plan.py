"""Integration steps between the nodes of a log, decided once: many where the model bends, few where it is smooth."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bondgraph.arrays import FloatArray, IntArray

#: Scheme, nodes and reach of the process noise, see :class:`bondgraph.filter.filter_model.FilterModel`.
NoiseRule = tuple[str, int, float]

#: Of a model that nothing drives between samples.
NO_RULE: NoiseRule = ("sampled", 0, 0.0)


@dataclass(frozen=True)
class IntervalSteps:
    """Steps between nodes (m-1,), and how much longer each step is than the one before (m-1,).

    Nodes are the samples of a log and, between them, those of the process noise.
    """

    substeps: IntArray
    grading: FloatArray

    def halved(self) -> IntervalSteps:
        """Every step cut in two; the lengths stay graded along the interval."""
        return IntervalSteps(2 * self.substeps, np.sqrt(self.grading))


@dataclass(frozen=True)
class StepPlan:
    """Steps for logs, by :func:`log_key`, for one integration method; plans are equal when their digests are.

    A log that is not in the plan is integrated with the uniform steps of the filter model. ``rule`` tells which nodes
    the process noise had when the steps were planned.

    Examples
    --------
    >>> steps = IntervalSteps(np.array([2, 8]), np.array([1.0, 2.0]))
    >>> plan = StepPlan.of("ros3p", {"key": steps})
    >>> plan.halved().logs["key"].substeps.tolist(), plan == plan.halved()
    ([4, 16], False)
    """

    method: str
    digest: str
    logs: Mapping[str, IntervalSteps] = field(repr=False, compare=False)
    rule: NoiseRule = NO_RULE

    @classmethod
    def of(cls, method: str, logs: Mapping[str, IntervalSteps], rule: NoiseRule = NO_RULE) -> StepPlan:
        """The plan of these logs."""
        digest = hashlib.sha256(repr((method, rule)).encode())
        for key, steps in sorted(logs.items()):
            digest.update(key.encode() + steps.substeps.tobytes() + steps.grading.tobytes())
        return cls(method, digest.hexdigest()[:16], dict(logs), rule)

    @property
    def content(self) -> tuple[str, str, NoiseRule]:
        """Plain values that tell this plan from every other."""
        return (self.method, self.digest, self.rule)

    def halved(self) -> StepPlan:
        """Every step cut in two."""
        return StepPlan.of(self.method, {key: steps.halved() for key, steps in self.logs.items()}, self.rule)

    @property
    def mean_substeps(self) -> float:
        """Steps between nodes on average."""
        counts = [steps.substeps for steps in self.logs.values() if steps.substeps.size]
        return float(np.mean(np.concatenate(counts))) if counts else 0.0


def log_key(time: FloatArray, u: FloatArray, y: FloatArray, theta_overrides: Mapping[str, float]) -> str:
    """Digest of all that a filter reads of a log."""
    digest = hashlib.sha256(repr(sorted(theta_overrides.items())).encode())
    for array in (time, u, y):
        digest.update(np.ascontiguousarray(array, dtype=np.float64).tobytes())
    return digest.hexdigest()[:24]


def cut_steps(substeps: IntArray, grading: FloatArray, share: FloatArray) -> IntArray:
    """Steps of a first part of intervals, as many as keep its own first step as short as that of the whole.

    Sigma points that are drawn anew relax as after a sample, so every part begins with short steps.

    Parameters
    ----------
    substeps, grading
        Of the whole, shape (m,).
    share
        Length of the part over that of the whole, shape (m,).

    Examples
    --------
    >>> cut_steps(np.array([8, 2048, 12]), np.array([1.0, 1.0, 1.35]), np.array([0.5, 0.5, 0.5])).tolist()
    [4, 1024, 10]
    """
    even = grading == 1.0
    ratio, powers = np.where(even, 2.0, grading), np.where(even, 1, substeps).astype(np.float64)
    graded = np.log1p(share * (ratio**powers - 1.0)) / np.log(ratio)
    count = np.where(even, share * substeps, graded)
    # a share that is whole up to rounding takes no step more
    steps: IntArray = np.maximum(1, np.ceil(count - 1e-9)).astype(np.int64)
    return steps


def transferred(steps: IntervalSteps, planned: FloatArray, nodes: FloatArray) -> IntervalSteps:
    """Steps planned between some nodes, for other nodes of the same log.

    A part of what was planned takes the steps that :func:`cut_steps` gives, one that spans several takes theirs.

    Parameters
    ----------
    steps
        Between the nodes ``planned``.
    planned, nodes
        Times, shape (m,) and (k,), s; both begin and end with the log.

    Examples
    --------
    >>> whole = IntervalSteps(np.array([4, 6]), np.ones(2))
    >>> transferred(whole, np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.5, 1.0, 2.0])).substeps.tolist()
    [2, 2, 6]
    """
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    own = np.clip(np.searchsorted(planned, middle) - 1, 0, steps.substeps.size - 1)
    share = np.minimum(np.diff(nodes) / np.diff(planned)[own], 1.0)
    gathered = np.concatenate([[0.0], np.cumsum(steps.substeps)])
    spanned = np.diff(np.interp(nodes, planned, gathered))
    inside = np.diff(nodes) <= np.diff(planned)[own] * (1.0 + 1e-9)
    count = np.where(inside, cut_steps(steps.substeps[own], steps.grading[own], share), np.ceil(spanned - 1e-9))
    return IntervalSteps(count.astype(np.int64), np.where(inside, steps.grading[own], 1.0))
