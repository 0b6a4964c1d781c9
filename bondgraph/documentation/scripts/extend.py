"""Things of one's own: a domain, an element, a log format, a search."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from sled import measured, sled

import bondgraph as bg
from bondgraph.declare.domains import Domain
from bondgraph.declare.graph import ElementType
from bondgraph.estimate.objective import FloatArray, Objective, SearchOutcome, TraceRow
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult, search_to_end

# a domain: units of its effort, flow, displacement and momentum, and how their names begin
MAGNETIC = Domain("magnetic", "A", "Wb/s", "Wb", "A s", "mmf", "flux_rate")

# an element: what it gives at each port, and the law in that form; each form is one set of strokes that it allows
g = bg.BondGraph("coil", doc="A coil with its winding on an iron core.")
turns, R = g.parameter("turns", 200.0, "1"), g.parameter("R", 4.0, "ohm", "winding")
winding = ElementType({("flow", "flow"): lambda u, mmf: (mmf / turns, -(u - R * mmf / turns) / turns)})
supply = g.one_junction("supply", bg.ELECTRICAL)
core = g.one_junction("core", MAGNETIC)
g.effort_source("u", g.input("u", "V"), at=supply)
g.element("winding", winding, at=(supply, core))
g.compliance("iron", g.parameter("reluctance", 5e5, "A/Wb", "iron"), at=core, state="flux")
g.measure_displacement("flux_linked", "iron", "flux of the core")
bg.draw(g, "coil.svg")
print(repr(bg.build(g)))


# a log format: whatever gives times and columns with units
def read_pairs(text: str) -> bg.Log:
    """Lines ``t force speed``."""
    t, force, speed = np.array([line.split() for line in text.splitlines()], dtype=float).T
    return bg.Log(
        "pairs", t, {"force": bg.LogChannel("force", "N", force), "speed": bg.LogChannel("speed", "m/s", speed)}
    )


print(repr(read_pairs("0.0 100 0.00\n0.1 100 0.12\n0.2 110 0.23")))


# a search: a frozen record of settings, a frozen record of its state, and four methods
@dataclass(frozen=True)
class Sprinkled:
    iteration: int
    points: FloatArray
    values: FloatArray
    evaluations: int
    trace: tuple[TraceRow, ...]


@dataclass(frozen=True)
class RandomSearch(AbstractSearch[Sprinkled]):
    """Points at random in the box."""

    steps: int = 10
    stage: ClassVar[str] = "random search"

    def init(self, objective: Objective, starts: FloatArray) -> Sprinkled:
        points = starts.reshape(objective.lower.size, -1)
        values = objective.nll(points)
        return Sprinkled(0, points, values, values.size, (self._row(0, values),))

    def step(self, objective: Objective, state: Sprinkled) -> Sprinkled:
        chance = np.random.default_rng(state.iteration)
        new = chance.uniform(objective.lower[:, None], objective.upper[:, None], (objective.lower.size, 50))
        points, values = np.hstack([state.points, new]), np.hstack([state.values, objective.nll(new)])
        trace = (*state.trace, self._row(state.iteration + 1, values))
        return Sprinkled(state.iteration + 1, points, values, values.size, trace)

    def ended(self, state: Sprinkled) -> SearchOutcome | None:
        return SearchOutcome.ITERATION_LIMIT if state.iteration >= self.steps else None

    def result(self, state: Sprinkled) -> SearchResult:
        return SearchResult(state.points, state.values)

    def _row(self, iteration: int, values: FloatArray) -> TraceRow:
        return TraceRow(self.stage, iteration, values.size, float(values.min()), ())


model = bg.build(sled(wind=1.5))
noise = bg.FilterModel(model, {"v": 0.02}, {"speed": 0.02}, {"v": 0.1})
problem = bg.pose(noise, bg.match(measured("run1", 1), model), ["mass", "drag"])
search = RandomSearch()
state, outcome = search_to_end(search, problem, problem.start)
best = problem.values(search.result(state).best)
print(outcome.name, *(f"{name} = {value:.1f}" for name, value in zip(problem.names, best, strict=True)))
