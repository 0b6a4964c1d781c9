"""CPU times measured side by side: one round of all candidates after another, and the median of the rounds."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping

Action = Callable[[], object]


def side_by_side(actions: Mapping[str, tuple[Action, float]], rounds: int = 5) -> dict[str, float]:
    """Median CPU seconds of one unit of each action; an action does ``units`` of them in one call.

    Every action runs once before, so that nothing is compiled in what is measured.
    """
    for action, _ in actions.values():
        action()
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(rounds):
        for name, (action, units) in actions.items():
            start = time.process_time()
            action()
            seconds[name].append((time.process_time() - start) / units)
    return {name: statistics.median(values) for name, values in seconds.items()}
