"""States of a search on disk, so that an interrupted estimation continues as if it had never stopped."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from bondgraph.errors import EstimationError
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import SearchOutcome, TraceRow
from bondgraph.estimate.solvers.abstract import SearchState
from bondgraph.files import write_bytes

FILE = "checkpoint.npz"

#: Times the last writing took that pass before the next: a convention.
_REST = 9.0

#: Entry that says of what type a state is.
_TYPE = "type"


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """What is on disk: the states reached by stage, and the time spent so far in seconds.

    A state is a frozen dataclass of numbers, texts, arrays, outcomes and its trace.
    """

    digest: str
    seconds: float
    states: Mapping[str, SearchState]


def problem_digest(problem: Problem, options: Mapping[str, object]) -> str:
    """Digest of everything on which the course of a search depends."""
    content = hashlib.sha256()
    for part in problem.parts:
        own = (part.filter_model.digest, problem.free, part.initial, sorted(options.items()))
        more = (part.names, part.ties, problem.priors) if part is not problem or part.ties or part.priors else ()
        content.update(repr((*own, *more)).encode())
        for log in part.logs:
            content.update(repr((log.name, sorted(log.theta_overrides.items()))).encode())
            for array in (log.time, log.u, log.y):
                content.update(np.ascontiguousarray(array).tobytes())
    return content.hexdigest()


def save_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint in one step: a reader finds the old one or the new one, never half of it."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    plain: dict[str, Any] = {"digest": checkpoint.digest, "seconds": checkpoint.seconds, "states": {}}
    for stage, state in checkpoint.states.items():
        kind = type(state)
        entry: dict[str, object] = {_TYPE: f"{kind.__module__}.{kind.__qualname__}"}
        plain["states"][stage] = entry
        for field in dataclasses.fields(state):  # type: ignore[arg-type]
            value = getattr(state, field.name)
            if isinstance(value, np.ndarray):
                arrays[f"{stage}.{field.name}"] = value
            else:
                entry[field.name] = _encoded(value)
    arrays["plain"] = np.array(json.dumps(plain))
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    write_bytes(folder / FILE, content.getvalue())


@dataclasses.dataclass
class Kept:
    """States of one search in a folder, None keeps nothing.

    What is noted while it rests is not written: a tenth of the time at most goes to writing, and steps after the last
    that was written are done again with the same numbers.
    """

    folder: Path | None
    digest: str
    rests_until: float = -np.inf
    is_written: bool = True

    def keep(self, states: Mapping[str, SearchState], seconds: float) -> None:
        """Note new states, and write all if the last writing is long enough ago."""
        self.is_written = False
        if time.perf_counter() >= self.rests_until:
            self.write(states, seconds)

    def write(self, states: Mapping[str, SearchState], seconds: float) -> None:
        """Write all states, if some are not written yet: a search that was finished before stays as it is."""
        if self.folder is None or self.is_written:
            return
        began = time.perf_counter()
        save_checkpoint(self.folder, Checkpoint(self.digest, seconds, states))
        ended = time.perf_counter()
        self.rests_until, self.is_written = ended + _REST * (ended - began), True


def load_checkpoint(folder: Path, digest: str) -> Checkpoint | None:
    """The checkpoint in a folder, None if there is none.

    Raises
    ------
    EstimationError
        If it belongs to another estimation or cannot be read.
    """
    path = folder / FILE
    if not path.is_file():
        return None
    try:
        with np.load(path) as content:
            arrays = {name: content[name] for name in content.files}
        plain = json.loads(str(arrays.pop("plain")))
        states = {stage: _decoded(stage, entry, arrays) for stage, entry in plain["states"].items()}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise EstimationError(
            f"{path}: the checkpoint cannot be read ({error}) - delete it to start anew", where=(str(path),)
        ) from None
    if plain["digest"] != digest:
        raise EstimationError(
            f"{path}: the checkpoint belongs to another estimation (model, logs, free parameters, method, settings or "
            "seed differ) - give these again as they were, choose another folder, or start without resume",
            where=(str(path),),
        )
    return Checkpoint(digest, float(plain["seconds"]), states)


def _encoded(value: object) -> object:
    if isinstance(value, tuple):
        return [_encoded(item) for item in value]
    if isinstance(value, SearchOutcome):
        return value.name
    return dataclasses.astuple(value) if isinstance(value, TraceRow) else value


def _decoded(stage: str, entry: Mapping[str, Any], arrays: Mapping[str, np.ndarray[Any, Any]]) -> SearchState:
    known: dict[str, Any] = dict(entry)
    known |= {name.removeprefix(f"{stage}."): array for name, array in arrays.items() if name.startswith(f"{stage}.")}
    known["trace"] = tuple(
        TraceRow(name, iteration, evaluations, nll, tuple(point))
        for name, iteration, evaluations, nll, point in entry["trace"]
    )
    if "outcomes" in entry:
        known["outcomes"] = tuple(None if name is None else SearchOutcome[name] for name in entry["outcomes"])
    module, _, name = known.pop(_TYPE).rpartition(".")
    kind = getattr(sys.modules.get(module), name, None)
    if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
        raise ValueError(f"{module}.{name} is the state of no search that is loaded")
    return cast(SearchState, kind(**known))
