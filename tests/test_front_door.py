"""The front door: what ``import bondgraph as bg`` offers, how little it loads, and what it says of results."""

from __future__ import annotations

import ast
import importlib
import inspect
import subprocess
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import bondgraph as bg
from bondgraph import exchange
from bondgraph.data import LogChannel
from bondgraph.errors import DataError, ModelError, OptionError
from bondgraph.estimate import likelihood_ratio, predict, profile_likelihood, sample_posterior
from bondgraph.simulate import InputSignal, simulate_batch

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(path for path in (ROOT / "bondgraph").rglob("__init__.py") if "exported(" in path.read_text())
VERBS = (
    "build",
    "close_loop",
    "compare",
    "draw",
    "estimate",
    "filter_log",
    "inspect",
    "linearise",
    "load",
    "pose",
    "read_log",
    "simulate",
)


def sled(wind: float = 0.0) -> bg.BondGraph:
    g = bg.BondGraph("sled", doc="A sled on snow, pushed.")
    force = g.input("force", "N", "push")
    mass = g.parameter("mass", 176.0, "lb", "sled with driver", (130.0, 260.0))
    drag = g.parameter("drag", 12.0, "N s/m", "runners on snow", (2.0, 40.0))
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("push", force, at=body)
    g.inertance("sled", mass, at=body, state="v")
    g.resistance("runners", lambda v: drag * v + wind * v * abs(v), at=body)
    g.measure_flow("speed", body, "speed of the sled", unit="km/h")
    return g


def pushed(name: str = "run1", seed: int = 1, samples: int = 400) -> bg.Log:
    """A log of a sled in the wind, in other units than the model's, with a column that the model does not know."""
    pandas = pytest.importorskip("pandas")
    chance = np.random.default_rng(seed)
    time = 0.1 * np.arange(samples)
    push = np.repeat(chance.uniform(0.0, 200.0, samples // 25 + 1), 25)[:samples]
    truth = bg.simulate(bg.build(sled(1.5)), time, {"force": push}, theta={"mass": 95.0})
    speed = 3.6 * (truth.output("speed") + 0.02 * chance.standard_normal(samples))
    table = pandas.DataFrame({"force [kN]": push / 1e3, "speed [km/h]": speed, "hail [1]": 0.0}, index=time)
    return bg.Log.from_dataframe(table, name)


class _Things:
    """One thing of each kind that verbs take."""

    graph = sled()
    model = bg.build(sled())

    @staticmethod
    def log() -> bg.Log:
        times = 0.1 * np.arange(50)
        channels = {"force": LogChannel("force", "N", np.ones(50)), "speed": LogChannel("speed", "km/h", times)}
        return bg.Log("run", times, channels)


#: Calls with a thing of another kind than is asked for, and what is said.
WRONG = {
    "match a model": (lambda a: bg.match(a.model, a.log()), "match: BuiltModel was given where a log is expected"),
    "match to a log": (
        lambda a: bg.match(a.log(), a.log()),
        "match: Log was given where a model is expected - bg.build",
    ),
    "build a model": (lambda a: bg.build(a.model), "build: BuiltModel was given where a graph is expected"),
    "build a function": (lambda a: bg.build(sled), "build: the function sled was given .* - call it: sled"),
    "estimate a graph": (lambda a: bg.estimate(a.graph, a.log()), "BondGraph was given where a model .* - bg.build"),
    "estimate a log": (lambda a: bg.estimate(a.log(), a.model), "estimate: Log was given where a model is expected"),
    "logs that are none": (lambda a: bg.estimate(a.model, [3]), "int was given where a log is expected - bg.read_log"),
    "a model for logs": (lambda a: bg.estimate(a.model, a.model), "BuiltModel was given where a log is expected"),
    "filter a graph": (lambda a: bg.filter_log(a.graph, a.log()), "filter_log: BondGraph was given where a model"),
    "simulate a graph": (lambda a: bg.simulate(a.graph, [0.0, 1.0]), "simulate: BondGraph was given where a model"),
    "a log for times": (lambda a: bg.simulate(a.model, a.log()), "give it by name, inputs=log"),
    "loop of a model": (lambda a: bg.close_loop(a.model, [a.log()]), "close_loop: BuiltModel was given where a graph"),
    "draw a log": (lambda a: bg.draw(a.log()), "draw: Log was given where a graph is expected"),
    "linearise a number": (lambda a: bg.linearise(3), "linearise: int was given where a model is expected"),
    "pose a graph": (lambda a: bg.pose(a.graph, a.log(), ["mass"]), "pose: BondGraph was given where a model"),
    "profile": (lambda a: profile_likelihood(a.model), "profile: BuiltModel was given where a finished"),
    "ratio": (lambda a: likelihood_ratio(a.model, {"mass": 1.0}), "likelihood ratio: BuiltModel was given"),
    "predict": (lambda a: predict(a.model), "predict: BuiltModel was given where"),
    "posterior": (lambda a: sample_posterior(a.model), "posterior: BuiltModel was given where"),
    "sensitivity": (lambda a: bg.sensitivity(a.graph), "where a model is expected - bg.build"),
    "design": (lambda a: bg.design(a.graph), "design: BondGraph was given where a model is expected - bg.build"),
    "inspect a model": (lambda a: bg.inspect(a.model), "inspect: BuiltModel was given where a log is expected"),
    "compare a graph": (lambda a: bg.compare(a.graph, a.log()), "compare: BondGraph was given where a model"),
    "read a log": (lambda a: bg.read_log(a.log()), "read_log: Log was given where a file is expected"),
    "write a graph": (lambda a: bg.write_log("x.csv", a.graph), "write_log: BondGraph was given where a log"),
    "write to a log": (lambda a: bg.write_log(a.log(), "x.csv"), "write_log: Log was given where a file is expected"),
    "write a model": (lambda a: bg.write_graph(a.model, "x.json"), "write_graph: BuiltModel was given where a graph"),
    "load a graph": (lambda a: bg.load(a.graph), "load: BondGraph was given where a file is expected"),
    "no data frame": (lambda a: bg.Log.from_dataframe(a.log()), "Log was given where a data frame is expected"),
    "FMU of a graph": (
        lambda a: exchange.export_fmu(a.graph, "x.fmu"),
        "export_fmu: BondGraph was given where a model",
    ),
    "C of a graph": (lambda a: exchange.c_source(a.graph), "c_source: BondGraph was given where a model is expected"),
    "casadi of a graph": (lambda a: exchange.to_casadi(a.graph), "to_casadi: BondGraph was given where a model"),
    "control of a model": (lambda a: exchange.to_control(a.model), "where a linear model is expected - bg.linearise"),
    "diagram of a log": (lambda a: exchange.dot_text(a.log()), "a diagram: Log was given where a graph is expected"),
    "a model as GraphML": (lambda a: exchange.write_graphml(a.model, "x"), "write_graphml: BuiltModel was given where"),
}


@pytest.mark.parametrize("call", WRONG)
def test_things_of_another_kind_are_refused_in_a_sentence(call: str) -> None:
    """All ended in an AttributeError or a TypeError from somewhere within, or took a model for the name of a file."""
    wrong, said = WRONG[call]
    with pytest.raises(OptionError, match=said):
        wrong(_Things())


def test_a_log_too_short_for_a_noise_is_told_as_such() -> None:
    """Three samples of the speed were told as "no log measures any of its outputs (speed)"."""
    with pytest.raises(DataError, match=r"no log has 4 samples of speed, .* - give a longer log"):
        bg.estimate(bg.build(sled()), pushed().rows(np.arange(3)))


def test_estimation_takes_data_frames_and_one_name() -> None:
    """The change log said so; a data frame ended in an AttributeError, and a name was taken letter by letter."""
    log = pushed(samples=100)
    table, model, how = log.to_dataframe(), bg.build(sled(1.5)), bg.Settings(method="gradient", starts=1)
    fits = [bg.estimate(model, given, "mass", how) for given in (log, table, [table])]
    assert fits[0].values == fits[1].values == fits[2].values
    assert "mass" in fits[0].values and "drag" not in fits[0].values
    assert bg.filter_log(model, table).log_name == "log"


def _typed(path: Path) -> dict[str, str]:
    """Names that a package shows to type checkers, with their modules."""
    found = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module != "typing":
            found |= {alias.name: node.module for alias in node.names if alias.asname == alias.name}
    return {name: module for name, module in found.items() if name != "__version__"}


def _package(path: Path) -> types.ModuleType:
    return importlib.import_module(".".join(path.parent.relative_to(ROOT).parts))


@pytest.mark.parametrize("path", PACKAGES, ids=lambda path: path.parent.name)
def test_what_a_package_exports_is_what_type_checkers_see(path: Path) -> None:
    package, typed = _package(path), _typed(path)
    assert package.__all__ == sorted(typed)
    for name, module in typed.items():
        assert getattr(package, name) is getattr(importlib.import_module(module), name)
        assert not isinstance(getattr(package, name), types.ModuleType)
        assert name in dir(package)


def test_the_front_door_is_small_and_says_what_it_does() -> None:
    assert {*VERBS, "BondGraph", "FilterModel", "Log", "Model", "ROTATION", "Settings", "smooth"} <= set(dir(bg))
    assert len(bg.__all__) <= 45
    for name in bg.__all__:
        value = getattr(bg, name)
        if inspect.isfunction(value):
            assert "Examples" in (inspect.getdoc(value) or ""), f"{name} has no example"
            assert "bg." in (inspect.getdoc(value) or ""), f"{name} shows another door"


def test_a_name_that_is_not_there_is_told_with_the_closest_one() -> None:
    with pytest.raises(AttributeError, match="no attribute 'simulat'; did you mean 'simulate'"):
        bg.simulat  # noqa: B018


def _fresh(code: str, *arguments: str) -> str:
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_importing_loads_nothing_large() -> None:
    said = _fresh(
        "import sys, bondgraph, bondgraph.simulate, bondgraph.estimate, bondgraph.declare, bondgraph.report\n"
        "print([name for name in ('sympy', 'numba', 'pint', 'numpy', 'scipy', 'networkx', 'matplotlib', 'pandas')"
        " if name in sys.modules])"
    )
    assert said == "[]\n"


_COMMANDS = """
import sys
from bondgraph.cli import main
from bondgraph.cli.arguments import parser
parser()
print([name for name in ("sympy", "numba", "pint", "numpy", "scipy", "matplotlib") if name in sys.modules])
status = main(["inspect", sys.argv[1]])
large = ("sympy", "numba", "networkx", "pandas", "scipy.stats", "scipy.sparse", "bondgraph.correct")
print(status, [name for name in large if name in sys.modules])
"""


def test_commands_load_no_more_than_they_use(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("time [s],speed [m/s]\n0,1\n1,2\n2,4\n")
    said = _fresh(_COMMANDS, str(tmp_path / "run.csv")).splitlines()
    assert (said[0], said[-1]) == ("[]", "0 []")


_RUN = """
import sys
import bondgraph as bg
import numpy as np
from bondgraph.data import LogChannel
model = bg.load(sys.argv[1])
time = 0.05 * np.arange(40)
run = bg.simulate(model, time, x0={"v": 3.0})
assert run.outcome.name == "OK" and run.summary()
log = bg.Log("coast", time, {"speed": LogChannel("speed", "m/s", run.output("speed"))})
known = bg.FilterModel(model, {"v": 0.1}, {"speed": 0.1}, {"v": 1.0})
found = bg.filter_log(known, log, constants={"force": 0.0}, compiled=False)
assert bg.smooth(found).summary() and bg.estimate and bg.Settings and bg.pose
print([name for name in ("sympy", "networkx", "matplotlib", "numba") if name in sys.modules])
"""


def test_a_model_runs_without_what_design_needs(tmp_path: Path) -> None:
    (tmp_path / "sled.py").write_text(bg.build(sled()).text)
    assert _fresh(_RUN, str(tmp_path / "sled.py")) == "[]\n"


_POSED = """
import sys
import bondgraph as bg
assert bg.estimate and bg.pose and bg.filter_log and bg.sensitivity and bg.design
import bondgraph.report.filtering, bondgraph.report.comparison
print([name for name in ("scipy.stats", "scipy.integrate", "numba") if name in sys.modules])
"""


def test_estimation_loads_without_what_only_searches_need() -> None:
    """Searches that draw points loaded scipy.stats with whatever filters or compares: a third of the time."""
    assert _fresh(_POSED) == "[]\n"


_EVERY = """
import importlib, pkgutil
from bondgraph import simulate as first
import bondgraph as bg
for found in pkgutil.walk_packages(bg.__path__, "bondgraph."):
    if not found.name.endswith("__main__"):
        importlib.import_module(found.name)
from bondgraph.simulate.model import Model
from bondgraph.simulate import Trajectory
from bondgraph.build import build
assert bg.simulate is first and bg.build is build and bg.Model is Model
print(*(type(getattr(bg, name)).__name__ for name in ("build", "simulate", "estimate")))
"""


def test_a_verb_stays_a_verb_whatever_rooms_are_imported() -> None:
    """``bondgraph.simulate`` would become the room as soon as a module in it is imported for the first time."""
    assert _fresh(_EVERY) == "function function function\n"


def test_a_built_model_is_the_model_of_its_module(tmp_path: Path) -> None:
    built = bg.build(sled())
    (tmp_path / "sled.py").write_text(built.text)
    loaded = bg.load(tmp_path / "sled.py")
    assert built == loaded == built.model and hash(built) == hash(loaded)
    assert type(built.model) is bg.Model and not hasattr(built.model, "graph")
    assert isinstance(built, bg.Model) and built.graph == sled()
    assert (built.driven, loaded.driven) == (("v",), ("v",))
    bg.write_graph(sled(), tmp_path / "sled.json")
    again = bg.build(tmp_path / "sled.json")
    assert again.names("state") == ("v",) and again.theta().tolist() == built.theta().tolist()


def test_a_graph_is_drawn_and_linearised(tmp_path: Path) -> None:
    built = bg.build(sled())
    assert bg.draw(built, tmp_path / "sled.svg") == bg.draw(sled())
    assert (tmp_path / "sled.svg").read_text().startswith("<svg")
    mass = built.theta()[0]
    np.testing.assert_allclose(bg.linearise(built).A, [[-12.0 / mass]], rtol=1e-12)


def test_a_simulation_takes_inputs_times_and_known_parameters_from_a_log() -> None:
    log, model = pushed(), bg.build(sled())
    run = bg.simulate(model, inputs=log)
    np.testing.assert_array_equal(run.time, log.time)
    np.testing.assert_allclose(run.input("force"), 1e3 * log.channel("force").numbers, rtol=1e-14)
    same = bg.simulate(model, log.time, {"force": 1e3 * log.channel("force").numbers})
    np.testing.assert_allclose(run.x, same.x, rtol=1e-12)
    matched = bg.simulate(model, inputs=bg.match(log, model))
    np.testing.assert_array_equal(run.x, matched.x)
    known = bg.Log("heavy", log.time, {**log.channels, "mass": _constant("mass", "kg", 100.0, len(log))})
    heavy = bg.simulate(model, log.time, inputs=known)
    np.testing.assert_array_equal(heavy.x, bg.simulate(model, inputs=log, theta={"mass": 100.0}).x)
    np.testing.assert_array_equal(bg.simulate(model, inputs=known, theta=model.theta()).x, run.x)
    with pytest.raises(ModelError, match="no times are given - give time, or inputs as a log"):
        bg.simulate(model, inputs={"force": 1.0})


def _constant(name: str, unit: str, value: float, size: int) -> LogChannel:
    return LogChannel(name, unit, np.full(size, value))


def test_a_simulation_takes_a_file_or_a_data_frame(tmp_path: Path) -> None:
    """Before, only a log as read: a file was told to have no times."""
    model, log = bg.build(sled()), pushed()
    bg.write_log(tmp_path / "run1.csv", log)
    expected = bg.simulate(model, inputs=log).output("speed")
    for given in (str(tmp_path / "run1.csv"), tmp_path / "run1.csv", log.to_dataframe()):
        np.testing.assert_allclose(bg.simulate(model, inputs=given).output("speed"), expected, rtol=1e-9)


def test_a_log_is_filtered_with_noises_of_its_own_or_given_ones() -> None:
    log, model = pushed(), bg.build(sled())
    found = bg.filter_log(model, log, compiled=False)
    assert 0.01 < found.filter_model.measurement_noise["speed"] < 0.04
    known = bg.FilterModel(model, {"v": 0.1}, {"speed": 0.02}, {"v": 0.1})
    run = bg.filter_log(known, log, {"mass": 95.0}, {"v": 0.5}, compiled=False)
    assert run.predicted_mean[0, 0] == 0.5
    assert run.filter_model is known
    assert type(known.model) is type(found.filter_model.model) is bg.Model, "a filter holds no graph"
    assert (
        bg.filter_log(known, log, {"mass": 95.0}, compiled=False).nll != bg.filter_log(known, log, compiled=False).nll
    )


def test_a_posed_problem_is_given_alone() -> None:
    log, model = pushed(), bg.build(sled())
    problem = bg.pose(bg.FilterModel(model, {"v": 0.1}, {"speed": 0.02}, {"v": 0.1}), bg.match(log, model), ["mass"])
    with pytest.raises(OptionError, match="give it alone"):
        bg.estimate(problem, [log])
    with pytest.raises(OptionError, match="sled needs at least one log"):
        bg.estimate(model, [])


def test_what_is_known_and_what_is_tied_goes_in_with_a_model_and_a_log() -> None:
    """Two stages from logs as read; the second is the problem that is posed by hand, to the digit."""
    model, log = bg.build(sled()), pushed()
    quick = bg.Settings(method="gradient", starts=1, certify="none")
    first = bg.estimate(model, log, ["mass", "drag"], quick)
    later = bg.estimate(model, log, ["mass", "drag"], quick, priors=[first.as_prior()])
    assert all(later.std[name] < 0.8 * first.std[name] for name in ("mass", "drag"))  # 1/sqrt(2) by two equal logs
    known = [bg.pose(model, log, ["mass", "drag"], priors=[first.as_prior()]), bg.pose(model, log, ["mass", "drag"])]
    point = known[0].start[:, np.newaxis]
    more = known[0].nll(point) - known[1].nll(point)
    gap = np.array([known[0].values(known[0].start)[k] - first.values[name] for k, name in enumerate(("mass", "drag"))])
    spread = first.covariance[:2, :2]
    assert more[0] == pytest.approx(0.5 * gap @ np.linalg.solve(spread, gap), rel=1e-6)
    tied = bg.estimate(model, log, settings=quick, ties={"drag": "0.13*mass"})
    assert "drag" not in tied.problem.names and tied.problem.ties[0].name == "drag"
    with pytest.raises(OptionError, match="priors and loss - give it alone"):
        bg.estimate(known[0], priors=[first.as_prior()])


def test_outliers_are_weighed_by_one_word() -> None:
    """A hundredth of the readings is 20 sigma off: the noise that is found stays that of the sensor."""
    table = pushed(samples=800).to_dataframe()
    table.loc[table.index[50::100], "speed [km/h]"] += 3.6 * 0.4
    model, log = bg.build(sled(1.5)), bg.Log.from_dataframe(table, "struck")
    quick = bg.Settings(method="gradient", starts=1, certify="none")
    taken, judged = (bg.estimate(model, log, ["mass", "drag"], quick, robust=loss) for loss in (None, "student"))
    assert taken.values["std(speed)"] > 0.03
    assert judged.values["std(speed)"] == pytest.approx(0.02, rel=0.1)
    assert judged.filter_model.robust == bg.Robust("student")
    known = bg.FilterModel(model, {"v": 0.1}, {"speed": 0.02}, {"v": 0.1})
    run = bg.filter_log(known, log, robust="gate:0.999", compiled=False)
    assert run.nll == bg.filter_log(replace(known, robust=bg.Robust("gate")), log, compiled=False).nll
    with pytest.raises(OptionError, match="robust: float was given where a loss is expected"):
        bg.filter_log(known, log, robust=4.0)  # type: ignore[call-overload]


# ---------------------------------------------------------------------- results in a few lines


@pytest.fixture(scope="module")
def fit() -> object:
    """An estimate; the repr of such a one had 26 000 characters."""
    model = bg.build(sled())
    given = bg.FilterModel(model, {"v": 0.05}, {"speed": 0.02}, {"v": 0.1})
    return bg.estimate(given, [pushed()], ["mass", "drag"], bg.Settings(method="gradient", starts=1, certify="none"))


def test_every_result_says_in_a_line_what_it_is(fit) -> None:
    log, model = pushed(), bg.build(sled())
    matched = bg.match(log, model)
    known = bg.FilterModel(model, {"v": 0.1}, {"speed": 0.02}, {"v": 0.1}, appended={"mass": 0.1})
    run = bg.filter_log(known, log, compiled=False)
    values = [
        model, model.model, model.equations, model.causal, log, log.channel("speed"), matched, known, run, run.nodes,
        bg.smooth(run), bg.simulate(model, inputs=log), simulate_batch(model, log.time, {"force": 1.0}),
        InputSignal.of(model, force=1.0), fit, fit.problem, fit.runs[0], bg.linearise(model), bg.draw(model).nodes[0],
    ]  # fmt: skip
    for value in values:
        text = repr(value)
        assert len(text) < 300 and "\n" not in text and "array(" not in text, text
        if not text.startswith("Drawn"):
            assert text.startswith(f"<{type(value).__name__}"), text
    assert repr(model) == "<BuiltModel sled: 1 state, 1 input, 2 parameters, 1 output>"
    assert repr(log) == "<Log run1: 400 samples, 0 to 39.9 s; force [kN], speed [km/h], hail [1]>"
    assert "free mass, drag; 1 log, 400 samples" in repr(fit.problem)


def test_the_line_of_a_run_that_failed_says_when_and_why() -> None:
    g = bg.BondGraph("runaway")
    body = g.one_junction("body", bg.TRANSLATION)
    g.inertance("mass", 1.0, at=body, state="v", initial=1.0)
    g.resistance("push", lambda v: -(v**2), at=body)
    run = bg.simulate(bg.build(g), np.linspace(0.0, 2.0, 5))
    assert run.outcome.name != "OK" and repr(run).endswith(" s>")
    assert "runaway" in run.summary() and "nan" not in run.summary()


def test_an_estimate_is_a_table_in_declared_units(fit) -> None:
    lines = fit.summary().splitlines()
    mass = next(line.split() for line in lines if line.startswith("mass"))
    assert mass[1] == "lb"
    assert float(mass[2]) == pytest.approx(fit.values["mass"] / 0.45359237, rel=1e-3)
    assert float(mass[4]) < float(mass[2]) < float(mass[5])
    assert len(lines) < 10 and lines[0] == fit.outcome.value
    table = fit.to_dataframe()
    assert list(table.index) == ["mass", "drag"]
    assert table.loc["mass", "value"] == pytest.approx(fit.values["mass"] / 0.45359237, rel=1e-12)
    assert table.loc["mass", ["lower_bound", "upper_bound", "unit"]].tolist() == pytest.approx([130.0, 260.0, "lb"])
    assert not table["at_bound"].any()


def test_an_estimate_is_plotted(fit) -> None:
    figure = fit.plot()
    (axes,) = figure.axes
    assert axes.get_ylabel() == "speed [km/h]" and axes.get_title() == "run1"
    measured = axes.lines[-1].get_ydata()
    np.testing.assert_allclose(measured, pushed().channel("speed").numbers, rtol=1e-12)


def test_one_panel_of_an_estimate_is_drawn_on_axes_of_ones_own(fit) -> None:
    own = Figure().subplots()
    assert fit.plot(ax=own) is own and own.get_ylabel() == "speed [km/h]"
    assert fit.plot("speed", "run1").get_title() == "run1"
    with pytest.raises(bg.BondGraphError, match="no measured output is called 'sped'; did you mean 'speed'"):
        fit.plot("sped")
    with pytest.raises(bg.BondGraphError, match="no log is called 'run7'"):
        fit.plot(log="run7", ax=own)


def test_runs_are_tables_in_declared_units() -> None:
    log, model = pushed(), bg.build(sled())
    run = bg.filter_log(bg.FilterModel(model, {"v": 0.1}, {"speed": 0.02}, {"v": 0.1}), log, compiled=False)
    table = run.to_dataframe()
    assert list(table) == ["v [m/s]", "v_std [m/s]", "speed_measured [km/h]", "speed_predicted [km/h]"]
    np.testing.assert_allclose(table["speed_measured [km/h]"], log.channel("speed").numbers, rtol=1e-12)
    np.testing.assert_array_equal(table["v [m/s]"], run.mean("v"))
    np.testing.assert_array_equal(bg.smooth(run).to_dataframe()["v_std [m/s]"], bg.smooth(run).std("v"))
    channel = next(line.split() for line in run.summary().splitlines() if line.startswith("speed"))
    assert channel[1:3] == ["km/h", "400"]
    assert float(channel[3]) == pytest.approx(3.6 * np.sqrt(np.mean(run.innovation**2)), rel=1e-3)
    free = bg.simulate(model, inputs=log)
    assert list(free.to_dataframe()) == ["v [m/s]", "speed [km/h]", "force [N]"]
    last = next(line.split() for line in free.summary().splitlines() if line.startswith("speed"))
    assert float(last[-1]) == pytest.approx(3.6 * free.output("speed")[-1], rel=1e-3)


def test_sensitivities_take_what_an_estimate_takes() -> None:
    """They asked for a posed problem, where an estimate takes a model with its logs."""
    log, model = pushed(samples=100), bg.build(sled(1.5))
    columns, table = {"v": "speed"}, log.to_dataframe().rename(columns={"speed [km/h]": "v [km/h]"})
    own = bg.pose(model, log, ["mass", "drag"])
    expected = bg.sensitivity(own).to_dict()
    assert bg.sensitivity(model, log, ["mass", "drag"]).to_dict() == expected
    assert bg.sensitivity(model, [table], ["mass", "drag"], columns=columns).to_dict() == expected
    assert bg.sensitivity(model, log, "mass", process_noise="none").names == ("mass", "std(speed)")
    moved = own.start + 0.1
    there = bg.sensitivity(model, log, ["mass", "drag"], point=moved).to_dict()
    assert there == bg.sensitivity(own, moved).to_dict() == bg.sensitivity(own, point=moved).to_dict() != expected
    with pytest.raises(OptionError, match="a posed problem has its own logs"):
        bg.sensitivity(own, log)
    with pytest.raises(OptionError, match="needs at least one log"):
        bg.sensitivity(model)


def test_sensitivities_are_a_table_in_declared_units(fit) -> None:
    known = bg.sensitivity(fit.problem, fit.point)
    assert repr(known) == "<Sensitivity of mass, drag to speed; not identifiable: none>"
    mass = next(line.split() for line in known.summary().splitlines() if line.startswith("mass"))
    assert mass[1] == "lb" and mass[-1] == "100%"
    table = known.to_dataframe()
    written = known.to_dict()["parameters"]
    assert table["std_joint"].tolist() == [written[name]["std_joint"] for name in table.index]
    np.testing.assert_allclose(table.loc["mass", "std_joint"], known.std_joint[0] / 0.45359237, rtol=1e-12)
    np.testing.assert_allclose(table["speed"], 1.0, rtol=1e-12)


def test_a_log_is_inspected_and_a_model_laid_over_it(tmp_path: Path) -> None:
    """Commands did both, and from Python they stood in rooms that nobody looks for."""
    log = pushed(samples=100)
    seen, compared = bg.inspect(log), bg.compare(bg.build(sled()), [log, pushed("run2", 2, 100)])
    assert repr(seen).startswith("<Inspection of run1: force, speed, hail; ") and "hail" in seen.summary()
    assert repr(compared).startswith("<Compared sled: fit of run1: speed ")
    assert "run2: speed [km/h]" in compared.summary()
    table, errors = seen.to_dataframe(), compared.to_dataframe()
    assert list(table.index) == ["force", "speed", "hail"] and table.loc["speed", "unit"] == "km/h"
    assert list(errors["log"]) == ["run1", "run2"] and (errors["rms"] > 0.0).all()
    assert "source" not in seen.to_dict() and "<table>" in seen._repr_html_() + compared._repr_html_()
    for result, channels in ((seen, 3), (compared, 2)):
        whole, axes = result.plot(), Figure().subplots()
        assert isinstance(whole, Figure) and len(whole.axes) == channels
        assert result.plot("speed", ax=axes) is axes and axes.lines and "speed" in axes.get_ylabel()
        with pytest.raises(OptionError, match="'sped'; did you mean 'speed'"):
            result.plot("sped")
    path = tmp_path / "run1.csv"
    bg.write_log(path, log)
    assert bg.inspect(path).channels == bg.inspect(bg.read_log(path)).channels


def test_without_pandas_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    run = bg.simulate(bg.build(sled()), [0.0, 1.0])
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(DataError, match=r"pandas is not installed - run: pip install 'bondloop\[frames\]'"):
        run.to_dataframe()
