"""Simulate: load and compile generated modules, integrate them over inputs."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.simulate.batch import simulate_batch as simulate_batch
    from bondgraph.simulate.inputs import InputSignal as InputSignal
    from bondgraph.simulate.model import Model as Model
    from bondgraph.simulate.model import load as load
    from bondgraph.simulate.outcome import Outcome as Outcome
    from bondgraph.simulate.scenario import Scenario as Scenario
    from bondgraph.simulate.simulation import simulate as simulate
    from bondgraph.simulate.state_space import state_space as state_space
    from bondgraph.simulate.trajectory import BatchTrajectory as BatchTrajectory
    from bondgraph.simulate.trajectory import EventRecord as EventRecord
    from bondgraph.simulate.trajectory import Trajectory as Trajectory
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "simulate.batch": "simulate_batch",
            "simulate.inputs": "InputSignal",
            "simulate.model": "Model load",
            "simulate.outcome": "Outcome",
            "simulate.scenario": "Scenario",
            "simulate.simulation": "simulate",
            "simulate.state_space": "state_space",
            "simulate.trajectory": "BatchTrajectory EventRecord Trajectory",
        },
    )
