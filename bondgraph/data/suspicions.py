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

#: How a sentence on jumps in time begins.
JUMPS = "time jumps"
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
#: Measured over modelled must surely differ by more than this factor before anything is suspected; and under the
#: suspected unit they must agree within this one, as far as can be told: parameters are seldom better known, and the
#: nearest two ratios, 6.28 and 9.55, stay apart.
_FAR, _NEAR = 2.0, 1.15
#: Largest share of the error with times as read that may be left with times in ms, and of the measured values (rms).
BETTER, _LEFT = 0.5, 0.3
#: Blocks of a log, whose scatter tells the error of a ratio whatever the colour of the noise, and Student's t of nine
#: degrees of freedom at 99 %, two-sided. Ten blocks and so few degrees hold their level where noise is correlated
#: over a tenth of the log or less (Ibragimov and Mueller 2010, J. Bus. Econ. Stat. 28(4)).
_BLOCKS, _STUDENT = 10, 3.25
#: Errors below this share (of the squares) are rounding.
_ROUNDING = 1e-12
#: Fewer common samples tell nothing.
FEWEST = 20
#: A gap is an interval so many times the usual one, and 0.5 s at least.
_GAP_INTERVALS, _GAP_SECONDS = 10.0, 0.5
#: A mode is settled between two samples that are so many of its time constants apart: 4 % of it are left.
_SETTLED = 3.2
#: Share of steps that are no multiple of the usual one, from which a clock jitters: a tenth, a convention.
_JITTER = 0.1
#: Gaps named in one note.
_NAMED = 3


@dataclass(frozen=True)
class Agreement:
    """Of measured against modelled values: slope of the regression through zero with its deviation, and errors.

    ``error`` is the rms difference, as a share of the rms of the measured values; ``squares`` (blocks,) holds what each
    block of the log adds to its square.
    """

    slope: float
    deviation: float
    error: float
    squares: FloatArray

    @property
    def sure(self) -> tuple[float, float]:
        """Between which values the slope lies, at 99 %."""
        return self.slope - _STUDENT * self.deviation, self.slope + _STUDENT * self.deviation

    def is_surely_better_than(self, other: Agreement) -> bool:
        """True where its errors are smaller by more than the scatter between blocks, see :func:`is_surely_smaller`."""
        return is_surely_smaller(self.squares + _ROUNDING, other.squares + _ROUNDING)


def is_surely_smaller(squares: FloatArray, others: FloatArray) -> bool:
    """True where squared errors of blocks (blocks,) are smaller by more than their scatter, at 99 %.

    A paired test of two forecasts (Diebold and Mariano 1995, J. Bus. Econ. Stat. 13(3)), of the logarithms of the
    blocks' squares, since blocks in which the machine hardly moves would say nothing beside the others.

    Examples
    --------
    >>> errors = 1.0 + 0.1 * np.cos(np.arange(10.0))
    >>> is_surely_smaller(errors, 2.0 * errors), is_surely_smaller(errors, errors[::-1])
    (True, False)
    """
    tiny = np.finfo(np.float64).tiny  # of a model that follows to the last digit
    gains = np.log((others + tiny) / (squares + tiny))
    return bool(gains.mean() > _STUDENT * gains.std(ddof=1) / math.sqrt(gains.size))


def in_blocks(values: FloatArray) -> FloatArray:
    """Sums of values (n,) over the blocks of a log, shape (blocks,)."""
    edges = np.linspace(0, values.size, _BLOCKS + 1).astype(int)[:-1]
    sums: FloatArray = np.add.reduceat(values, edges)
    return sums


def agreement(measured: FloatArray, modelled: FloatArray | None) -> Agreement | None:
    """How measured values (n,) agree with modelled ones; None where there are too few, or none differ from zero.

    The deviation of the slope comes from the scatter of its equation between blocks of the log.

    Examples
    --------
    >>> wave = np.sin(np.arange(50.0))
    >>> found = agreement(3.6 * wave + 0.1 * np.cos(7.0 * np.arange(50.0)), wave)
    >>> round(found.slope, 2), round(found.deviation, 3), round(found.error, 3)
    (3.61, 0.023, 0.723)
    """
    if modelled is None:
        return None
    both = np.isfinite(measured) & np.isfinite(modelled)
    y, m = measured[both], modelled[both]
    if y.size < FEWEST or not np.any(y) or not np.any(m):
        return None
    power = float(np.sum(m * m))  # not by a BLAS, whose number of threads shows in last digits
    slope = float(np.sum(y * m)) / power
    scores = in_blocks(m * (y - slope * m))
    deviation = math.sqrt(_BLOCKS / (_BLOCKS - 1) * float(scores @ scores)) / power
    squares = in_blocks((y - m) ** 2) / float(np.sum(y * y))
    return Agreement(slope, deviation, math.sqrt(float(squares.sum())), squares)


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
    if as_read is None or _may_be_one(as_read):
        return None
    found = []
    for factor, dimensions, suggestion in FACTORS:
        if dimensions and not any(units.dimension(unit) == units.dimension(one) for one in dimensions):
            continue
        scaled = agreement(measured / factor, answer(factor))
        if scaled is not None and _is_one(scaled):
            found.append((scaled.error, factor, scaled, suggestion))
    if not any(scaled.is_surely_better_than(as_read) for _, _, scaled, _ in found):
        return None
    found.sort(key=lambda one: one[0])
    _, factor, scaled, _ = found[0]
    ratio, spread = factor * scaled.slope, factor * _STUDENT * scaled.deviation
    return (
        f"output {name!r}: measured values are {ratio:.4g} +- {spread:.2g} times the modelled ones, which suggests "
        f"{', or '.join(suggestion for *_, suggestion in found)} - check the unit in the header of the column"
    )


def _may_be_one(found: Agreement) -> bool:
    """Whether measured over modelled may be one but for parameters that are not well known."""
    lower, upper = found.sure
    return lower < _FAR and upper > 1.0 / _FAR


def _is_one(found: Agreement) -> bool:
    """Whether measured over modelled agrees with one, and with nothing that is far from it."""
    lower, upper = found.sure
    return 1.0 / _FAR < lower < _NEAR and 1.0 / _NEAR < upper < _FAR


def looks_like_milliseconds(time: FloatArray) -> bool:
    """Whether times (n,) could be milliseconds: whole numbers, a second or more apart.

    Examples
    --------
    >>> looks_like_milliseconds(np.arange(0.0, 500.0, 20.0)), looks_like_milliseconds(np.arange(0.0, 5.0, 0.1))
    (True, False)
    """
    return time.size > FEWEST and bool(np.all(time == np.round(time))) and float(np.median(np.diff(time))) >= 1.0


def looks_counted_in_milliseconds(time: FloatArray) -> bool:
    """True for times (n,) that look like milliseconds without a model: whole numbers, and steps that jitter by some.

    A logger that takes a row every second is ordinary; a clock that counts milliseconds hardly hits every tenth. Steps
    of several usual ones are missing rows, and no jitter.

    Examples
    --------
    >>> jitter = np.cumsum(20.0 + np.random.default_rng(0).integers(-1, 2, 50))
    >>> looks_counted_in_milliseconds(jitter), looks_counted_in_milliseconds(np.arange(0.0, 500.0, 20.0))
    (True, False)
    """
    if not looks_like_milliseconds(time):
        return False
    steps = np.diff(time)
    return bool(np.mean(steps % np.median(steps) != 0.0) > _JITTER)


def time_suspicion(time: FloatArray, as_read: Sequence[Agreement], scaled: Sequence[Agreement]) -> str | None:
    """The sentence that suspects times of being milliseconds, from how all channels agree with both readings."""
    if not as_read or len(scaled) != len(as_read):
        return None
    before, after = (math.sqrt(sum(one.error**2 for one in each) / len(each)) for each in (as_read, scaled))
    if not (after < BETTER * before and after < _LEFT):
        return None
    step = float(np.median(np.diff(time)))
    return (
        f"times are {step:g} s apart, but the model follows the log as if they were {step:g} ms - write the header as "
        "'time [ms]'"
    )


def time_gaps(time: FloatArray, first_row: int = FIRST_ROW, apart: bool = False) -> list[str]:
    """The sentence on jumps in time (n,) that are much longer than the usual interval; none where there are none.

    ``apart``: the parts between them are logs of their own.

    Examples
    --------
    >>> time_gaps(np.array([0.0, 0.1, 0.2, 0.3, 5.3, 5.4]))
    ['time jumps from 0.3 s to 5.3 s (row 5 to 6): inputs are carried across as declared, and states drift - if the
    machine did something else meanwhile give --split-gaps, in Python bg.split_at_gaps(log)']
    """
    found = gaps(time)
    if not found.size:
        return []
    each = [
        f"{time[k]:.6g} s to {time[k + 1]:.6g} s (row {k + first_row} to {k + 1 + first_row})" for k in found[:_NAMED]
    ]
    more = f" and {found.size - _NAMED} more" if found.size > _NAMED else ""
    across = (
        "inputs are carried across as declared, and states drift - if the machine did something else meanwhile give "
        "--split-gaps, in Python bg.split_at_gaps(log)"
    )
    between = (
        "nobody knows what the inputs did meanwhile, so that the parts are logs of their own - lead across with "
        "--across-gaps, in Python across_gaps=True"
    )
    return [f"{JUMPS} from {', '.join(each)}{more}: {between if apart else across}"]


def gaps(time: FloatArray) -> npt.NDArray[np.intp]:
    """Samples (found,) of times (n,) after which time jumps by ten times the usual interval, and half a second."""
    intervals = np.diff(time)
    if intervals.size < 2:
        return np.zeros(0, dtype=np.intp)
    usual = float(np.median(intervals))
    return np.flatnonzero(intervals > max(_GAP_SECONDS, _GAP_INTERVALS * usual))


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
