"""Runs a function on many inputs in another process, with limits of time and memory for each, and says how each ended.

A process that hangs is ended, one that breaks is replaced; what follows goes on in the next one.
"""

from __future__ import annotations

import faulthandler
import importlib
import multiprocessing
import os
import random
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from bondgraph.errors import BondGraphError

#: Limits for one input. Reading and deriving a small graph takes a tenth of a second, ten on a busy machine.
SECONDS, MEMORY = 60.0, 6 << 30


@dataclass
class Findings:
    """How many inputs ended in which way, and the inputs that ended badly with what happened."""

    counts: Counter[str] = field(default_factory=Counter)
    bad: list[tuple[Any, str]] = field(default_factory=list)

    def __str__(self) -> str:
        return ", ".join(f"{count} {kind}" for kind, count in sorted(self.counts.items()))


def survey(function: str, inputs: Iterable[Any], seconds: float = SECONDS, memory: int = MEMORY) -> Findings:
    """Call ``module:function`` with each input; a clean end and an error of the toolkit are good."""
    findings = Findings()
    with _Child(function, seconds, memory) as child:
        for given in inputs:
            kind, detail = child.call(given)
            findings.counts[kind] += 1
            if kind not in ("clean", "refused"):
                findings.bad.append((given, f"{kind}: {detail}"))
    return findings


def mutants(
    make: Callable[[random.Random], Any], name: str, seconds: float, first: int = 0, most: int | None = None
) -> Iterator[Any]:
    """Inputs made from seeds ``first``, ``first + 1`` .. for some seconds; how far they went is printed.

    ``most`` ends them earlier, so that a suite repeats what was searched before and a fast machine finds nothing new.
    """
    ends, seed = time.monotonic() + seconds, first
    while time.monotonic() < ends and (most is None or seed - first < most):
        yield make(random.Random(f"{name} {seed}"))
        seed += 1
    print(f"{name}: seeds {first} to {seed - 1}")


class _Child:
    def __init__(self, function: str, seconds: float, memory: int) -> None:
        self._function, self._seconds, self._memory = function, seconds, memory
        self._process: Any = None

    def __enter__(self) -> _Child:
        self._start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def call(self, given: Any) -> tuple[str, str]:
        """How the function ended."""
        self._pipe.send(given)
        try:
            if self._pipe.poll(self._seconds):
                kind, detail = self._pipe.recv()
                return str(kind), str(detail)
            answer = ("hang", f"no end within {self._seconds:g} s")
        except EOFError:
            self._process.join()
            answer = ("crash", f"exit status {self._process.exitcode}")
        self._end()
        self._start()
        return answer

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, self._function, self._memory), daemon=True)
        self._process.start()
        other.close()
        assert self._pipe.recv() == "ready"

    def _end(self) -> None:
        self._process.kill()
        self._process.join()
        self._pipe.close()


def _serve(pipe: Any, function: str, memory: int) -> None:
    faulthandler.enable()
    warnings.simplefilter("ignore")
    module, name = function.split(":")
    call = getattr(importlib.import_module(module), name)
    if os.name == "posix":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    pipe.send("ready")
    while True:
        given = pipe.recv()
        try:
            call(given)
            pipe.send(("clean", ""))
        except BondGraphError as error:
            pipe.send(
                ("refused", error.message) if len(error.message) < 3000 else ("endless message", error.message[:900])
            )
        except MemoryError:
            pipe.send(("memory", traceback.format_exc()))
        except BaseException:
            pipe.send(("foreign", traceback.format_exc()))
