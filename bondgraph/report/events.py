"""The events of a simulation, as text and as marks in its picture."""

from __future__ import annotations

from matplotlib.figure import Figure

from bondgraph.simulate.trajectory import EventRecord, Trajectory
from bondgraph.text import count

#: So many events are listed, and so many marked with words; the others are counted, and marked by a line alone.
_LISTED, _WORDED = 40, 8
#: Share of the picture's width between two lines.
_APART = 0.004
_MARK = "#8e44ad"


def events_text(trajectory: Trajectory) -> str:
    """The events, one line each; those of a long run are cut short in the middle."""
    events = trajectory.events
    if not events:
        return "no events"
    lines = [str(event) for event in events]
    if len(lines) > _LISTED:
        half = _LISTED // 2
        lines = [*lines[:half], f"... {len(lines) - 2 * half} more events ...", *lines[-half:]]
    return "\n".join([count(len(events), "event"), *(f"  {line}" for line in lines)])


def mark_events(figure: Figure, trajectory: Trajectory) -> None:
    """A dotted line through all panels at every event; what happened stands along it where there are few.

    Events closer together than lines can be told apart get one line.
    """
    events = trajectory.events
    nearest, last = _APART * float(trajectory.time[-1] - trajectory.time[0]), -float("inf")
    for time in (event.time for event in events):
        if time - last >= nearest:
            last = time
            for axes in figure.axes:
                axes.axvline(time, color=_MARK, linewidth=0.7, linestyle=":", zorder=0.8)
    if figure.axes and len(events) <= _WORDED:
        for time, words in _at_once(events).items():
            figure.axes[0].annotate(
                words, (time, 1.0), xycoords=("data", "axes fraction"), xytext=(-2, -3), textcoords="offset points",
                rotation=90, ha="right", va="top", fontsize=7.0, color=_MARK,
            )  # fmt: skip


def _at_once(events: tuple[EventRecord, ...]) -> dict[float, str]:
    """What happened at each time."""
    found: dict[float, str] = {}
    for event in events:
        words = f"{event.element} {event.what.partition(',')[0]}"
        found[event.time] = f"{found[event.time]}, {words}" if event.time in found else words
    return found
