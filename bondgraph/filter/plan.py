"""Integration steps of every interval of a log, decided once: many where the model bends, few where it is smooth."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bondgraph.simulate.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class IntervalSteps:
    """Steps of each interval (n-1,), and how much longer each step is than the one before (n-1,)."""

    substeps: IntArray
    grading: FloatArray

    def halved(self) -> IntervalSteps:
        """Every step cut in two; the lengths stay graded along the interval."""
        return IntervalSteps(2 * self.substeps, np.sqrt(self.grading))


@dataclass(frozen=True)
class StepPlan:
    """Steps for logs, by :func:`log_key`, for one integration method; plans are equal when their digests are.

    A log that is not in the plan is integrated with the uniform steps of the filter model.

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

    @classmethod
    def of(cls, method: str, logs: Mapping[str, IntervalSteps]) -> StepPlan:
        """The plan of these logs."""
        digest = hashlib.sha256(method.encode())
        for key, steps in sorted(logs.items()):
            digest.update(key.encode() + steps.substeps.tobytes() + steps.grading.tobytes())
        return cls(method, digest.hexdigest()[:16], dict(logs))

    def halved(self) -> StepPlan:
        """Every step cut in two."""
        return StepPlan.of(self.method, {key: steps.halved() for key, steps in self.logs.items()})

    @property
    def mean_substeps(self) -> float:
        """Steps per interval on average."""
        counts = [steps.substeps for steps in self.logs.values() if steps.substeps.size]
        return float(np.mean(np.concatenate(counts))) if counts else 0.0


def log_key(time: FloatArray, u: FloatArray, y: FloatArray, theta_overrides: Mapping[str, float]) -> str:
    """Digest of all that a filter reads of a log."""
    digest = hashlib.sha256(repr(sorted(theta_overrides.items())).encode())
    for array in (time, u, y):
        digest.update(np.ascontiguousarray(array, dtype=np.float64).tobytes())
    return digest.hexdigest()[:24]
