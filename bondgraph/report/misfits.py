"""What a report and a terminal say where a model does not explain its logs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from bondgraph.filter.misfit import Misfit
from bondgraph.text import inflected


def misfit_sentences(misfits: Sequence[Misfit], report: Path | None = None) -> list[str]:
    """Sentences on channels that are not explained, each with its error against its noise; then what to do next.

    Examples
    --------
    >>> found = Misfit("speed", "m/s", ("run1",), 0.41, 0.05, 67.0, 0.0, 0.0, is_coloured=True, is_large=False)
    >>> print(*misfit_sentences([found], Path("fit/report.html")))
    run1: speed: one-step error 0.41 m/s is 8.2 times its noise 0.05 m/s, and its innovations are coloured (p < 1e-100):
    the model does not explain this log - look at fit/report.html, free more parameters (bondgraph estimate), or let
    bondgraph close-loop find what is missing
    >>> other = Misfit("torque", "N m", ("run1",), 3.0, 1.0, 9.0, 0.0, 0.5, is_coloured=False, is_large=True)
    >>> print(*misfit_sentences([found, other]), sep=chr(10))  # doctest: +ELLIPSIS
    run1: speed: one-step error 0.41 m/s is 8.2 times its noise 0.05 m/s, and its innovations are coloured (p < 1e-100)
    run1: torque: one-step error 3 N m is 3 times its noise 1 N m, and its squared innovations are 9 times what ...
    The model does not explain this log - free more parameters (bondgraph estimate), or let bondgraph close-loop ...
    """
    look = f"look at {report}, " if report is not None else ""
    todo = f"{look}free more parameters (bondgraph estimate), or let bondgraph close-loop find what is missing"
    if len(misfits) < 2:
        return [f"{misfit} - {todo}" for misfit in misfits]
    these = inflected({log for misfit in misfits for log in misfit.logs}, "this log", "these logs")
    return [*(misfit.finding for misfit in misfits), f"The model does not explain {these} - {todo}"]


def filter_sentences(
    tests: Sequence[Misfit], report: Path | None = None, emptied: Collection[tuple[str, str]] = ()
) -> list[str]:
    """Sentences on channels that are not explained, or that there is none; then on colour that contradicts nothing.

    Of channels of which a gate ``emptied`` a log, pairs of log and channel, innovations tell neither.

    Examples
    --------
    >>> wide = Misfit("speed", "m/s", ("run1",), 0.05, 0.05, 0.1, 1.0, 0.0, is_coloured=False, is_large=False,
    ...     autocorrelation=-0.47, could_be_gain=True)
    >>> print(*filter_sentences([wide]), sep=chr(10))  # doctest: +ELLIPSIS
    No channel contradicts the model.
    run1: speed: its innovations are coloured (p < 1e-100, first autocorrelation -0.47: after an error the next one
    takes back 47 % of it), but smaller than the filter expects (NIS 0.1): noises that are taken too large do that, ...
    """
    against = misfit_sentences([one for one in tests if one.contradicts], report)
    if not against and not emptied:
        against = ["No channel contradicts the model."]
    told = [one for one in tests if not any((log, one.channel) in emptied for log in one.logs)]
    return [*against, *(one.harmless_colour for one in told if one.harmless_colour)]


def band_text(mean: float, band: tuple[float, float], shown: Sequence[str]) -> str:
    """Where the mean of a NIS lies against its band; ``shown`` are the three numbers as text.

    Examples
    --------
    >>> band_text(0.1, (0.9, 1.1), ["0.1", "0.9", "1.1"])
    '0.1 below its band 0.9 to 1.1 (the noises are taken too large)'
    """
    value, low, high = shown
    if mean < band[0]:
        return f"{value} below its band {low} to {high} (the noises are taken too large)"
    if mean > band[1]:
        return f"{value} above its band {low} to {high} (errors are larger than the filter expects)"
    return f"{value} in band {low} to {high}"
