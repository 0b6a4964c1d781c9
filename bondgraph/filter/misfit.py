"""Does a model explain its logs? The channels whose innovations say that it does not, each in one sentence.

Innovations of a model that explains a log are white and as large as the filter expects. Both are tested for every
measured channel, and a misfit is reported where either hypothesis is rejected. The chance that a model which is right,
noises included, is reported at all is at most ``LEVEL``, divided among all tests (Bonferroni). Innovations smaller than
expected are no misfit: the noises are then declared or guessed too large, which may colour them as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc, gammainc, gammaincc

from bondgraph.arrays import FloatArray
from bondgraph.filter.whiteness import first_autocorrelation, whiteness_p
from bondgraph.text import inflected

#: Chance of a false alarm about all channels of a report together.
LEVEL = 1e-3
#: The portmanteau statistic has a heavier tail than the chi-square that gives its p-value: of white series of 20 to
#: 1000 values, p-values below p come up in at most 0.14 p^0.37 of the cases (a million series each, p down to 1e-6).
_TAIL, _TAIL_POWER = 0.14, 0.37
#: A variance from the median of n second differences scatters like the mean of so many times n squares.
_GUESSED = 0.2
#: One-step error over noise that a gain of one gives, and a tenth for the noise that is not known exactly.
_GAIN = 1.1 * math.sqrt(2.0)
#: Smaller p-values are not told apart.
_SMALLEST_P = 1e-100


@dataclass(frozen=True)
class ChannelInnovations:
    """Innovations of one channel over several logs, each (n,): over their own deviations, and as they are.

    NaN stands where nothing was measured, and in a gap between the logs that no autocorrelation reaches across.
    ``errors`` are in coherent SI; so many of ``unit``, in which the channel is shown, make one of that.
    """

    name: str
    unit: str
    normalised: FloatArray
    errors: FloatArray
    per_coherent: float = 1.0

    @property
    def count(self) -> int:
        """Number of measured values."""
        return int(np.sum(~np.isnan(self.normalised)))

    @property
    def rmse(self) -> float:
        """Rms of the innovations, in coherent SI."""
        return float(np.sqrt(np.nanmean(self.errors**2)))


@dataclass(frozen=True)
class Misfit:
    """Innovations of a measured channel, and whether a model explains it in some logs.

    ``error`` is the rms of the one-step errors and ``noise`` the standard deviation of the sensor's noise, both in
    ``unit``. ``nis_mean`` is the mean of the normalised squared innovations, 1 for a consistent filter; ``nis_p`` is
    the p-value of its being so large by chance, ``whiteness_p`` that of white innovations. ``is_coloured`` and
    ``is_large`` say which of both was rejected. ``autocorrelation`` is that of neighbouring innovations;
    ``could_be_gain`` where noises that are taken too large would colour them as much.
    """

    channel: str
    unit: str
    logs: tuple[str, ...]
    error: float
    noise: float
    nis_mean: float
    nis_p: float
    whiteness_p: float
    is_coloured: bool
    is_large: bool
    autocorrelation: float = math.nan
    could_be_gain: bool = False

    @property
    def contradicts(self) -> bool:
        """True where the channel is a misfit at all."""
        return self.is_coloured or self.is_large

    @property
    def ratio(self) -> float:
        """One-step error over the noise of the sensor."""
        return self.error / self.noise if self.noise > 0.0 else math.inf

    @property
    def finding(self) -> str:
        """Words for what the innovations of the channel show."""
        why = []
        if self.is_coloured:
            why.append(f"its innovations are coloured ({self._colour})")
        if self.is_large:
            why.append(
                f"its squared innovations are {self.nis_mean:.3g} times what the filter expects ({p_text(self.nis_p)})"
            )
        return (
            f"{', '.join(self.logs)}: {self.channel}: one-step error {self.error:.2g} {self.unit} is "
            f"{_times(self.ratio)} its noise {self.noise:.2g} {self.unit}, and {' and '.join(why)}"
        )

    @property
    def harmless_colour(self) -> str:
        """Words for colour that does not contradict a model; empty where there is none, or where it does."""
        if self.is_coloured or not self.whiteness_p < LEVEL:
            return ""
        if self.could_be_gain:
            why = (
                f"but smaller than the filter expects (NIS {self.nis_mean:.2g}): noises that are taken too large do "
                "that, and then the bands of the states are too wide"
            )
        else:
            one_of = 1.0 / (_TAIL * self.whiteness_p**_TAIL_POWER)
            why = f"which chance alone brings in one of {one_of:.0f} channels of a model that is right"
        return f"{', '.join(self.logs)}: {self.channel}: its innovations are coloured ({self._colour}), {why}"

    @property
    def _colour(self) -> str:
        """How sure colour is, and how much of an innovation the next one repeats."""
        share = f"{100.0 * abs(self.autocorrelation):.0f} %"
        next_one = f"repeats {share} of it" if self.autocorrelation >= 0.0 else f"takes back {share} of it"
        how = f", first autocorrelation {self.autocorrelation:.2g}: after an error the next one {next_one}"
        return p_text(self.whiteness_p) + (how if math.isfinite(self.autocorrelation) else "")

    def __str__(self) -> str:
        return f"{self.finding}: the model does not explain {inflected(self.logs, 'this log', 'these logs')}"

    def to_dict(self) -> dict[str, object]:
        """The misfit as ``result.json`` holds it; a p-value of zero is one that no number can hold."""
        return {
            "channel": self.channel, "unit": self.unit, "logs": list(self.logs), "error": self.error,
            "noise": self.noise, "nis_mean": self.nis_mean, "nis_p": self.nis_p, "whiteness_p": self.whiteness_p,
            "coloured": self.is_coloured, "large": self.is_large, "sentence": str(self),
            "autocorrelation": self.autocorrelation if math.isfinite(self.autocorrelation) else None,
        }  # fmt: skip


def channel_misfits(
    channels: Sequence[ChannelInnovations],
    logs: tuple[str, ...],
    noise: Mapping[str, float],
    level: float = LEVEL,
    *,
    guessed: bool = False,
) -> tuple[Misfit, ...]:
    """Channels whose innovations say that the model does not explain them, see :func:`channel_tests`."""
    return tuple(one for one in channel_tests(channels, logs, noise, level, guessed=guessed) if one.contradicts)


def channel_tests(
    channels: Sequence[ChannelInnovations],
    logs: tuple[str, ...],
    noise: Mapping[str, float],
    level: float = LEVEL,
    *,
    guessed: bool = False,
) -> tuple[Misfit, ...]:
    """Tests of all channels, whether the model explains them or not; ``level`` is that of all tests together.

    Noises ``guessed`` from second differences of the same logs are known less well than the mean of all squares.
    """
    each = level / (2 * len(channels)) if channels else level
    return tuple(
        _tested(channel, logs, float(noise.get(channel.name, math.nan)), each, guessed) for channel in channels
    )


def _tested(
    innovations: ChannelInnovations, logs: tuple[str, ...], noise: float, level: float, guessed: bool
) -> Misfit:
    """What two tests, each of this level, say of the innovations of a channel.

    Colour counts only where innovations are not smaller than expected: too much process noise colours them too, by a
    gain that is too large, and never more than to sqrt(2) times the noise, the error of who believes each measurement.
    """
    squares = float(np.nansum(innovations.normalised**2))
    count = innovations.count
    if guessed:
        large_p = float(fdtrc(count, max(_GUESSED * count, 1.0), squares / count))
    else:
        large_p = float(gammaincc(0.5 * count, 0.5 * squares))
    is_small = float(gammainc(0.5 * count, 0.5 * squares)) < level
    could_be_gain = is_small and not innovations.rmse > _GAIN * noise
    smallest = min(level, (level / _TAIL) ** (1.0 / _TAIL_POWER))
    white_p = whiteness_p(innovations.normalised)
    return Misfit(
        innovations.name, innovations.unit, logs, innovations.rmse * innovations.per_coherent,
        noise * innovations.per_coherent, squares / count, large_p, white_p,
        is_coloured=not could_be_gain and white_p < smallest, is_large=large_p < level,
        autocorrelation=first_autocorrelation(innovations.normalised), could_be_gain=could_be_gain,
    )  # fmt: skip


def p_text(p: float) -> str:
    """A p-value in words.

    Examples
    --------
    >>> p_text(0.034), p_text(0.0)
    ('p = 0.03', 'p < 1e-100')
    """
    return f"p < {_SMALLEST_P:.0e}" if p < _SMALLEST_P else f"p = {p:.1g}"


def _times(ratio: float) -> str:
    return f"{ratio:.2g} times" if ratio < 99.5 else f"{ratio:.0f} times"
