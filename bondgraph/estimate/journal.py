"""A journal of finished fits, so that an interrupted loop or chain of fits goes on where it stopped.

Closing a loop is a fixed sequence of fits with quick work between them. Each finished fit is noted under a digest of
everything it depends on; a loop that is run again takes the noted ones as they are and reaches the point of
interruption in seconds. A changed graph, log or option has other digests, so that nothing stale is ever used.
A search that is not finished yet is no matter of the journal: its state is kept by ``checkpoint``.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from bondgraph.data.log import FloatArray
from bondgraph.errors import EstimationError
from bondgraph.estimate.checkpoint import problem_digest
from bondgraph.estimate.derivatives.formed import Formed, Scheme
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.execute.tasks import in_order
from bondgraph.files import write_text

_Answer = TypeVar("_Answer")

FILE = "fits.json"
#: Fits that end in two threads are noted one after the other.
_NOTING = threading.Lock()


@dataclass(frozen=True)
class Noted:
    """Where a fit ended: its point (n,), how its derivatives were formed, value, evaluations, name of the outcome."""

    point: FloatArray
    formed: Formed
    nll: float
    evaluations: int
    outcome: str


@dataclass(frozen=True)
class Journal:
    """Fits noted in a folder; without a folder nothing is noted. Those that are not are computed by an executor.

    ``file`` is the name of the file there.

    Examples
    --------
    >>> Journal().entry("4f")
    """

    folder: Path | None = None
    executor: Executor | None = field(default=None, compare=False, repr=False)
    file: str = FILE

    @property
    def exists(self) -> bool:
        """Whether fits were noted before."""
        return self.folder is not None and (self.folder / self.file).is_file()

    def start(self, resume: bool) -> None:
        """Begin anew, or keep what is there.

        Raises
        ------
        EstimationError
            If what is there cannot be read.
        """
        if self.folder is None:
            return
        if resume:
            self._read()
        else:
            (self.folder / self.file).unlink(missing_ok=True)

    def find(self, key: str) -> Noted | None:
        """A fit that was noted."""
        entry = self.entry(key)
        if entry is None or "derivatives" not in entry:  # an earlier version noted no such thing
            return None
        near = entry.get("near")
        formed = Formed(
            Scheme[entry["derivatives"]], np.array(entry["formed"]), None if near is None else np.array(near),
            int(entry.get("doublings", 0)),
        )  # fmt: skip
        point, evaluations = np.array(entry["point"]), int(entry["evaluations"])
        return Noted(point, formed, float(entry["nll"]), evaluations, str(entry["outcome"]))

    def note(self, key: str, fit: Noted) -> None:
        """Note a finished fit."""
        self.enter(key, {
            "point": fit.point.tolist(), "derivatives": fit.formed.scheme.name, "formed": fit.formed.at.tolist(),
            "nll": fit.nll, "evaluations": fit.evaluations, "outcome": fit.outcome,
            "near": None if fit.formed.near is None else fit.formed.near.tolist(), "doublings": fit.formed.doublings,
        })  # fmt: skip

    def entry(self, key: str) -> dict[str, Any] | None:
        """Content that was entered under a key, or None."""
        found: dict[str, Any] | None = self._read().get(key)
        return found

    def enter(self, key: str, content: Mapping[str, Any]) -> None:
        """Keep what JSON can hold under a key."""
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        with _NOTING:
            write_text(self.folder / self.file, json.dumps(self._read() | {key: dict(content)}))

    def computed(self, search: Callable[..., _Answer], *task: Any) -> _Answer:
        """The answer of a search of a module to its task, by a worker where there are some."""
        return in_order(self.executor, search, [task])[0]

    def _read(self) -> dict[str, Any]:
        if self.folder is None or not (self.folder / self.file).is_file():
            return {}
        try:
            entries = json.loads((self.folder / self.file).read_text(encoding="utf-8"))
            return dict(entries)
        except (OSError, ValueError) as error:
            raise EstimationError(
                f"{self.folder / self.file}: the journal of fits cannot be read ({error}) - delete it to start anew",
                where=(str(self.folder / self.file),),
            ) from None


def fit_key(problem: EstimationProblem, options: Sequence[object]) -> str:
    """Digest of everything on which a fit depends."""
    return problem_digest(problem, {"options": _plain(options)})


def _plain(option: object) -> object:
    if isinstance(option, np.ndarray):
        return option.tolist()
    return [_plain(one) for one in option] if isinstance(option, list | tuple) else option
