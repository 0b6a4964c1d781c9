"""Where the searches of fits begin: with how much noise of the process and of the sensors."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from bondgraph.data.log import FloatArray
from bondgraph.estimate.free import FreeParameter

#: Factors on declared noise levels at which a first fit looks for its start.
_NOISIER = (1.0, 5.0, 25.0, 125.0)
#: Factors on declared levels with which a quiet search begins: of process noise, and of the sensors' noise.
_QUIET = {"process": 0.25, "std": 6.0}


def quiet_start(free: Sequence[FreeParameter], point: FloatArray) -> FloatArray:
    """A point (n,) with little process noise and much of the sensors: its errors are then those of the outputs.

    Much process noise lets a filter follow any log whatever its parameters, and likelihoods have an optimum there too.
    A search that begins without finds parameters first, as one of free simulations would.
    """
    start = point.copy()
    for k, parameter in enumerate(free):
        if parameter.target.kind in _QUIET:
            level = parameter.start * _QUIET[parameter.target.kind]
            start[k] = parameter.coordinate(float(np.clip(level, parameter.lower, parameter.upper)))
    return start


def noisy_starts(free: Sequence[FreeParameter]) -> list[FloatArray]:
    """The starts of free parameters with process and measurement noise as declared and several times larger.

    Far from the optimum a model is surprised by all it sees. A search that begins with noise of the right size for that
    surprise moves the parameters first; one that begins with far too little throws every noise level up at once.
    """
    start = np.array([parameter.coordinate(parameter.start) for parameter in free])
    kinds = np.array([parameter.target.kind for parameter in free])
    found = []
    for process, measurement in itertools.product(_NOISIER, _NOISIER[:3]):
        point = start.copy()
        point[kinds == "process"] += np.log(process)
        point[kinds == "std"] += np.log(measurement)
        found.append(point)
    return found
