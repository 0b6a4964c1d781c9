"""A small machine: its declared graph, its truth as plain functions that scipy integrates, and what is right of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.data.log import FloatArray, MatchedLog

#: Rates of change of the states at (t, x) for inputs at t.
Rates = Callable[[FloatArray, FloatArray], Sequence[float]]


@dataclass(frozen=True)
class Machine:
    """A declared graph, its truth with and without one effect, and what the loop should say of it.

    ``laws`` are the right answers as "law at place". A formula at the place of one of them is right too where all its
    signals are among ``signals``: it is the law in other words. ``effect`` says what the truth has.
    """

    graph: Callable[[], bg.BondGraph]
    rates: Callable[[bool], Rates]
    start: Sequence[float]
    shown: Callable[[FloatArray, FloatArray, bool], FloatArray]
    noise: Sequence[float]
    inputs: Callable[[FloatArray, np.random.Generator], FloatArray]
    step: float
    samples: int
    laws: frozenset[str]
    signals: frozenset[str] = frozenset()
    effect: str = ""

    @property
    def places(self) -> frozenset[str]:
        """Places of the right answers."""
        return frozenset(law.partition(" at ")[2] for law in self.laws)

    def log(self, seed: int, effect: bool = True) -> MatchedLog:
        """A log of the true machine, (n_u, n) inputs that are straight between samples and (n_y, n) outputs."""
        chance = np.random.default_rng(seed)
        time = self.step * np.arange(self.samples)
        u = self.inputs(time, chance)
        rates = self.rates(effect)

        def right(t: float, x: FloatArray) -> Sequence[float]:
            return rates(x, np.array([np.interp(t, time, row) for row in u]))

        x0 = np.asarray(self.start, dtype=float)
        run = solve_ivp(
            right, (0.0, time[-1]), x0, method="Radau", t_eval=time, rtol=1e-8, atol=1e-9, max_step=5 * self.step
        )
        y = self.shown(run.y, u, effect)
        noise = np.asarray(self.noise)[:, np.newaxis]
        return MatchedLog(f"run{seed}", time, u, y + noise * chance.normal(size=y.shape))


def steps(time: FloatArray, chance: np.random.Generator, lower: float, upper: float, every: float) -> FloatArray:
    """Levels that change at random, each over one sample."""
    held = max(int(every / (time[1] - time[0])), 1)
    return np.repeat(chance.uniform(lower, upper, time.size // held + 1), held)[: time.size]


def waves(time: FloatArray, chance: np.random.Generator, size: float, slowest: float, fastest: float) -> FloatArray:
    """Six sines of random phases between two frequencies [Hz], together of a root mean square of ``size``."""
    frequencies = np.geomspace(slowest, fastest, 6)[:, np.newaxis]
    phases = chance.uniform(0.0, 2.0 * np.pi, (6, 1))
    summed: FloatArray = size / np.sqrt(3.0) * np.sin(2.0 * np.pi * frequencies * time + phases).sum(axis=0)
    return summed
