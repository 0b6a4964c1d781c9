"""Bond graphs to corrected models: declare a machine, derive and generate its model, explain its measurements.

    import bondgraph as bg

Everything that most work needs is found here and loaded when it is first used; each room exports its own handful. The
verbs ``build``, ``simulate`` and ``estimate`` are called like the module or room they come from, whose contents are
imported by ``from bondgraph.simulate import Trajectory``.
"""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported
from bondgraph.version import __version__ as __version__

if TYPE_CHECKING:
    from bondgraph.asking import design as design
    from bondgraph.asking import sensitivity as sensitivity
    from bondgraph.build import BuiltModel as BuiltModel
    from bondgraph.build import build as build
    from bondgraph.correct.loop import LoopSettings as LoopSettings
    from bondgraph.data.log import Log as Log
    from bondgraph.data.log import LogChannel as LogChannel
    from bondgraph.data.log import MatchedLog as MatchedLog
    from bondgraph.data.matching import match as match
    from bondgraph.data.read import read_log as read_log
    from bondgraph.data.select import split_at_gaps as split_at_gaps
    from bondgraph.data.write import write_log as write_log
    from bondgraph.declare.domains import CHEMICAL as CHEMICAL
    from bondgraph.declare.domains import ELECTRICAL as ELECTRICAL
    from bondgraph.declare.domains import HYDRAULIC as HYDRAULIC
    from bondgraph.declare.domains import ROTATION as ROTATION
    from bondgraph.declare.domains import THERMAL as THERMAL
    from bondgraph.declare.domains import TRANSLATION as TRANSLATION
    from bondgraph.declare.files import read_graph as read_graph
    from bondgraph.declare.files import write_graph as write_graph
    from bondgraph.declare.graph import BondGraph as BondGraph
    from bondgraph.declare.modal import clutch as clutch
    from bondgraph.declare.modal import friction as friction
    from bondgraph.declare.modal import impact as impact
    from bondgraph.derive.linearisation import linearise as linearise
    from bondgraph.errors import BondGraphError as BondGraphError
    from bondgraph.estimate.estimation import Settings as Settings
    from bondgraph.estimate.joint import pose_joint as pose_joint
    from bondgraph.filter.detector import ChangeDetector as ChangeDetector
    from bondgraph.filter.filter_model import FilterModel as FilterModel
    from bondgraph.filter.online import OnlineFilter as OnlineFilter
    from bondgraph.filter.robust import Robust as Robust
    from bondgraph.filter.smoother import smooth as smooth
    from bondgraph.report.comparison import compare as compare
    from bondgraph.report.correction import Correction as Correction
    from bondgraph.report.correction import close_loop as close_loop
    from bondgraph.report.drawing import draw as draw
    from bondgraph.report.inspection import inspect as inspect
    from bondgraph.simulate.model import Model as Model
    from bondgraph.simulate.model import load as load
    from bondgraph.simulate.simulation import simulate as simulate
    from bondgraph.simulate.state_space import state_space as state_space
    from bondgraph.verbs import estimate as estimate
    from bondgraph.verbs import filter_log as filter_log
    from bondgraph.verbs import pose as pose
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "asking": "design sensitivity",
            "build": "BuiltModel build",
            "correct.loop": "LoopSettings",
            "data.log": "Log LogChannel MatchedLog",
            "data.matching": "match",
            "data.read": "read_log",
            "data.select": "split_at_gaps",
            "data.write": "write_log",
            "declare.domains": "CHEMICAL ELECTRICAL HYDRAULIC ROTATION THERMAL TRANSLATION",
            "declare.files": "read_graph write_graph",
            "declare.graph": "BondGraph",
            "declare.modal": "clutch friction impact",
            "derive.linearisation": "linearise",
            "errors": "BondGraphError",
            "estimate.estimation": "Settings",
            "estimate.joint": "pose_joint",
            "filter.detector": "ChangeDetector",
            "filter.filter_model": "FilterModel",
            "filter.online": "OnlineFilter",
            "filter.robust": "Robust",
            "filter.smoother": "smooth",
            "report.comparison": "compare",
            "report.correction": "Correction close_loop",
            "report.drawing": "draw",
            "report.inspection": "inspect",
            "simulate.model": "Model load",
            "simulate.simulation": "simulate",
            "simulate.state_space": "state_space",
            "verbs": "estimate filter_log pose",
        },
    )
