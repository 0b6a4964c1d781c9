"""A value that many tasks need: pickled once where they are made, opened once in each process that takes some."""

from __future__ import annotations

import hashlib
import pickle
import threading
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar, cast

_Value = TypeVar("_Value")

#: Values that a process keeps open: as many as the parts of a joint problem that take turns.
_KEPT = 16
_OPEN: dict[str, Any] = {}
_OPENING = threading.Lock()


@dataclass(frozen=True)
class Shared(Generic[_Value]):
    """A value on its way to workers; ``open`` gives it, the same object to all tasks of a process.

    What an object has computed about itself (compiled equations, samples of a log) is so computed once per worker.

    Examples
    --------
    >>> there = pickle.loads(pickle.dumps(Shared.of([1, 2])))
    >>> there.open(), there.open() is there.open()
    ([1, 2], True)
    """

    content: bytes = field(repr=False)
    digest: str

    @classmethod
    def of(cls, value: _Value) -> Shared[_Value]:
        """The value, pickled."""
        content = pickle.dumps(value)
        return cls(content, hashlib.sha256(content).hexdigest())

    def open(self) -> _Value:
        """The value."""
        with _OPENING:
            value = _OPEN.pop(self.digest) if self.digest in _OPEN else pickle.loads(self.content)
            while len(_OPEN) >= _KEPT:
                del _OPEN[next(iter(_OPEN))]  # asked for longest ago
            _OPEN[self.digest] = value
            return cast("_Value", value)
