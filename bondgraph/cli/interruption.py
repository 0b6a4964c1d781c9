"""Ctrl-C and SIGTERM: both stop a command where it stands, leave what there is, and say how to go on."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@dataclass
class Asked:
    """The signal that asked a command to end, None as long as there is none."""

    signal: signal.Signals | None = None

    @property
    def status(self) -> int:
        """Exit status of an interrupted command, as shells give it: 130 after Ctrl-C, 143 after SIGTERM."""
        return 128 + int(self.signal or signal.SIGINT)


@contextmanager
def interruptible() -> Iterator[Asked]:
    """Both signals as KeyboardInterrupt while a command runs; those that are ignored stay ignored."""
    asked = Asked()

    def end(number: int, _: FrameType | None) -> None:
        asked.signal = signal.Signals(number)
        raise KeyboardInterrupt

    before: dict[signal.Signals, Any] = {}
    if threading.current_thread() is threading.main_thread():  # no other may set handlers
        before = {one: signal.getsignal(one) for one in _SIGNALS}
    try:
        for one, handler in before.items():
            if handler not in (signal.SIG_IGN, None):
                signal.signal(one, end)
        yield asked
    finally:
        for one, handler in before.items():
            if handler is not None:
                signal.signal(one, handler)
