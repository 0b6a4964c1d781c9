"""Axes for the pictures of results, given by the caller or new."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def own_axes(ax: Axes | None, width: float = 5.6, height: float = 3.8) -> Axes:
    """The axes given, or those of a new figure of a width and a height in inches.

    Examples
    --------
    >>> own_axes(None, 3.0, 2.0).figure.get_size_inches().tolist()
    [3.0, 2.0]
    """
    if ax is not None:
        return ax
    from matplotlib.figure import Figure  # a second of its own, which tables do not wait for

    axes: Axes = Figure(figsize=(width, height), layout="constrained").subplots()
    return axes
