"""What a log looks like when its numbers are read in another unit or sampled too coarsely: said, never corrected.

A wrong unit shows only against a model. A channel is suspected where the measured values, divided by the factor between
two units, agree with a simulation that starts from them, while as they are they do not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bondgraph import units
from bondgraph.data.log import FIRST_ROW, FloatArray

#: Model's answer (n,) to a channel divided by a factor, or None where the simulation fails.
Answer = Callable[[float], FloatArray | None]

#: Ratios of the numbers of one unit to those of another: for which dimension, and what they suggest.
_ANGLE, _SPEED, _ANY = ("rad", "rad/s"), ("m/s",), ()
FACTORS: tuple[tuple[float, tuple[str, ...], str], ...] = (
    (30.0 / math.pi, ("rad/s",), "rpm read as rad/s"),
    (math.pi / 30.0, ("rad/s",), "rad/s read as rpm"),
    (180.0 / math.pi, _ANGLE, "degrees read as radians"),
    (math.pi / 180.0, _ANGLE, "radians read as degrees"),
    (2.0 * math.pi, _ANGLE, "radians read as revolutions"),
    (0.5 / math.pi, _ANGLE, "revolutions read as radians"),
    (3.6, _SPEED, "km/h read as m/s"),
    (1.0 / 3.6, _SPEED, "m/s read as km/h"),
    (1.0 / 0.44704, _SPEED, "mph read as m/s"),
    (1000.0, _ANY, "a unit a thousand times smaller (mm, mV, g) read as the unit itself"),
    (0.001, _ANY, "a unit a thousand times larger (km, kN, kPa) read as the unit itself"),
)
#: Measured over modelled must differ by more than this factor before anything is suspected, and agree within this one
#: with the suspected ratio; parameters are seldom better known, and the nearest two ratios, 6.28 and 9.55, stay apart.
_FAR, _NEAR = 2.0, 1.15
#: Largest share of the measured values (rms) that may be left after the suspected ratio is taken out, and the largest
#: share of the error without it.
_LEFT, _BETTER = 0.3, 0.5
#: Fewer common samples tell nothing.
_FEWEST = 20
#: A gap is an interval so many times the usual one, and 0.5 s at least.
_GAP_INTERVALS, _GAP_SECONDS = 10.0, 0.5
#: A mode is settled between two samples that are so many of its time constants apart: 4 % of it are left.
_SETTLED = 3.2
#: Gaps named in one note.
_NAMED = 3


@dataclass(frozen=True)
class Agreement:
    """Of measured against modelled values: slope of the regression through zero, rest after it, and error without."""

    slope: float
    rest: float
    error: float


def agreement(measured: FloatArray, modelled: FloatArray | None) -> Agreement | None:
    """How measured values (n,) agree with modelled ones; None where there are too few, or none differ from zero.

    Rest and error are rms values as shares of that of the measured values.

    Examples
    --------
    >>> wave = np.sin(np.arange(50.0))
    >>> found = agreement(3.6 * wave, wave)
    >>> round(found.slope, 3), round(found.rest, 3), round(found.error, 3)
    (3.6, 0.0, 0.722)
    """
    if modelled is None:
        return None
    both = np.isfinite(measured) & np.isfinite(modelled)
    y, m = measured[both], modelled[both]
    if y.size < _FEWEST or not np.any(y) or not np.any(m):
        return None
    slope = float(y @ m / (m @ m))
    size = float(np.sqrt(y @ y))
    return Agreement(slope, float(np.linalg.norm(y - slope * m)) / size, float(np.linalg.norm(y - m)) / size)


def scale_suspicion(name: str, unit: str, measured: FloatArray, answer: Answer) -> str | None:
    """The sentence that suspects a channel of another unit, or None.

    Parameters
    ----------
    name, unit
        Of the channel in the model.
    measured
        Shape (n,), in that unit as read.
    answer
        What the model says at the samples when its start follows the channel divided by a factor.
    """
    as_read = agreement(measured, answer(1.0))
    if as_read is None or (as_read.slope > 0.0 and abs(math.log(as_read.slope)) < math.log(_FAR)):
        return None
    found = []
    for factor, dimensions, suggestion in FACTORS:
        if dimensions and not any(units.dimension(unit) == units.dimension(one) for one in dimensions):
            continue
        scaled = agreement(measured / factor, answer(factor))
        if scaled is not None and _agrees(scaled) and scaled.error < _BETTER * as_read.error:
            found.append((scaled.error, factor * scaled.slope, suggestion))
    if not found:
        return None
    _, ratio, suggestion = min(found)
    return (
        f"output {name!r}: measured values are {ratio:.4g} times the modelled ones, which suggests {suggestion} - "
        "check the unit in the header of the column"
    )


def _agrees(scaled: Agreement) -> bool:
    return scaled.slope > 0.0 and abs(math.log(scaled.slope)) < math.log(_NEAR) and scaled.rest < _LEFT


def looks_like_milliseconds(time: FloatArray) -> bool:
    """Whether times (n,) could be milliseconds: whole numbers, a second or more apart.

    Examples
    --------
    >>> looks_like_milliseconds(np.arange(0.0, 500.0, 20.0)), looks_like_milliseconds(np.arange(0.0, 5.0, 0.1))
    (True, False)
    """
    return time.size > _FEWEST and bool(np.all(time == np.round(time))) and float(np.median(np.diff(time))) >= 1.0


def time_suspicion(time: FloatArray, as_read: Sequence[Agreement], scaled: Sequence[Agreement]) -> str | None:
    """The sentence that suspects times of being milliseconds, from how all channels agree with both readings."""
    if not as_read or len(scaled) != len(as_read):
        return None
    before, after = (math.sqrt(sum(one.error**2 for one in each) / len(each)) for each in (as_read, scaled))
    if not (after < _BETTER * before and after < _LEFT):
        return None
    step = float(np.median(np.diff(time)))
    return (
        f"times are {step:g} s apart, but the model follows the log as if they were {step:g} ms - write the header as "
        "'time [ms]'"
    )


def time_gaps(time: FloatArray, first_row: int = FIRST_ROW) -> list[str]:
    """The sentence on jumps in time (n,) that are much longer than the usual interval; none where there are none.

    Examples
    --------
    >>> time_gaps(np.array([0.0, 0.1, 0.2, 0.3, 5.3, 5.4]))
    ['time jumps from 0.3 s to 5.3 s (row 5 to 6): inputs are carried across as declared, and states drift - split the
    log there if the machine did something else meanwhile']
    """
    intervals = np.diff(time)
    if intervals.size < 2:
        return []
    usual = float(np.median(intervals))
    found = np.flatnonzero(intervals > max(_GAP_SECONDS, _GAP_INTERVALS * usual))
    if not found.size:
        return []
    each = [
        f"{time[k]:.6g} s to {time[k + 1]:.6g} s (row {k + first_row} to {k + 1 + first_row})" for k in found[:_NAMED]
    ]
    more = f" and {found.size - _NAMED} more" if found.size > _NAMED else ""
    return [
        f"time jumps from {', '.join(each)}{more}: inputs are carried across as declared, and states drift - split the "
        "log there if the machine did something else meanwhile"
    ]


def sampling_notes(time: FloatArray, modes: npt.NDArray[np.complex128]) -> list[str]:
    """Sentences on modes of a machine that samples at these times (n,) cannot show.

    Parameters
    ----------
    modes
        Eigenvalues of the machine at the start, 1/s, complex. A single fast mode beside slow ones is no matter: it is
        settled between samples. A machine all of whose modes are settled shows no dynamics, and an oscillation above
        half the sampling rate that lasts from sample to sample is seen at another frequency (Shannon 1949).

    Examples
    --------
    >>> sampling_notes(np.arange(0.0, 60.0, 5.0), np.array([-10.0, -200.0 + 0j]))
    ['samples are 5 s apart, but the slowest mode of the machine decays in 0.1 s: the log shows it settled, and says
    little of inertias and stiffnesses - sample faster, or estimate only what steady states show']
    >>> sampling_notes(np.arange(0.0, 60.0, 5.0), np.array([0.0, -200.0 + 0j]))
    []
    """
    if time.size < 2 or not modes.size or not np.isfinite(modes).all():
        return []
    step = float(np.median(np.diff(time)))
    notes = []
    slowest = float(np.min(-modes.real))  # of a machine that grows or drifts, not positive
    if slowest * step > _SETTLED:
        notes.append(
            f"samples are {step:.3g} s apart, but the slowest mode of the machine decays in {1.0 / slowest:.3g} s: the "
            "log shows it settled, and says little of inertias and stiffnesses - sample faster, or estimate only what "
            "steady states show"
        )
    folded = modes[(modes.imag * step > math.pi) & (np.abs(modes.real) * step < 1.0)]
    if folded.size:
        frequency = float(np.max(folded.imag)) / (2.0 * math.pi)
        notes.append(
            f"the machine oscillates at {frequency:.3g} Hz, above half the sampling rate of {1.0 / step:.3g} Hz, and "
            "longer than a sample: the log shows it at another frequency - sample faster"
        )
    return notes
