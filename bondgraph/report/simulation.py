"""Simulate a declared graph over a table of inputs, and write what comes out as a log."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from sympy import Expr

from bondgraph.data.log import FloatArray, Log, LogChannel, MatchedLog
from bondgraph.data.matching import known_parameters, match_inputs, match_outputs, renamed
from bondgraph.data.signals import names_of
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.requirements import check_requirements
from bondgraph.errors import OptionError, suggest
from bondgraph.estimate.initial import InitialRule, initial_states
from bondgraph.generate.pipeline import render_graph
from bondgraph.report.energy import energy_states, inertia_value
from bondgraph.simulate.inputs import InputSignal
from bondgraph.simulate.model import Model
from bondgraph.simulate.quantities import OutputInfo, StateInfo
from bondgraph.simulate.scenario import Scenario
from bondgraph.simulate.simulation import simulate
from bondgraph.simulate.starts import starts_in
from bondgraph.simulate.trajectory import Trajectory
from bondgraph.text import few

#: Points written where neither inputs nor a step say how many.
_POINTS = 1000
#: Points of an answer beyond which a step is a mistake: an hour at 10 kHz has half as many.
_MOST_POINTS = 100_000_000


@dataclass(frozen=True)
class SimulationOptions:
    """What a simulation may be told: end and step of time in s, values by name, tolerances, every bond's variables.

    Values and initial states are in the declared units of what they belong to.
    A ``scenario`` gives inputs, start and end; values and initial states given beside it come before its own. With
    ``signals`` the named signals are outputs too. Not ``smooth``: switches, friction and impacts have modes, and events
    are located. ``mapping`` says which columns of the table have other names in the model, ``start`` by which rule
    states begin whose values are not given (:func:`bondgraph.estimate.initial.initial_states`).
    """

    until: float | None = None
    step: float | None = None
    values: Mapping[str, float | str] | None = None
    initial: Mapping[str, float] | None = None
    rtol: float = 1e-9
    atol: float | None = None
    all_variables: bool = False
    scenario: Scenario | None = None
    signals: bool = False
    smooth: bool = True
    mapping: Mapping[str, str] = field(default_factory=dict)
    start: InitialRule = "model"


def simulate_graph(graph: BondGraph, inputs: Log | None, options: SimulationOptions) -> Trajectory:
    """Derive a graph and integrate it over a table of inputs.

    Parameters
    ----------
    graph
        The declared graph.
    inputs
        A table with columns called like the inputs; None: every input at its default or at its given value. Of columns
        called like outputs it reads where states start that are declared to.
    options
        Times, values of parameters and inputs, initial states, tolerances.

    Raises
    ------
    OptionError
        If a name is unknown or the end of time is not given anywhere.
    DataError
        If the table does not fit the inputs.
    """
    rendered = render_graph(
        graph, smooth=options.smooth, bonds=options.all_variables, signals=options.signals or options.all_variables
    )
    model = Model.from_text(rendered.text, source=graph.name)
    table = None if inputs is None else renamed(inputs, model, options.mapping)
    theta, constants = _values(model, options.values or {})
    theta = (known_parameters(table, model) if table else {}) | theta
    flat = graph.flatten()
    check_requirements(flat.requirements, flat.parameters, graph.name, theta)
    initial = _initial(model, energy_states(rendered.derivation.variables), options.initial or {}, theta)
    start = options.scenario.start(model) if options.scenario else {}
    times, signal = _inputs(model, table, constants, options)
    begun = _begun(model, signal, {*constants, *_given_inputs(table, options.scenario)}, table, theta, options.start)
    compiled = options.scenario is not None  # a manoeuvre is run again and again, and its machine code is kept
    return simulate(
        model, times, signal, theta, begun | start | initial, rtol=options.rtol, compiled=compiled,
        atol=None if options.atol is None else (options.atol,) * len(model.states),
    )  # fmt: skip


def _given_inputs(inputs: Log | None, scenario: Scenario | None) -> tuple[str, ...]:
    return (*(() if inputs is None else inputs.channels), *(() if scenario is None else scenario.inputs))


def _begun(
    model: Model,
    signal: InputSignal,
    given: Container[str],
    table: Log | None,
    theta: Mapping[str, float],
    rule: InitialRule,
) -> dict[str, float]:
    """The states that begin at a signal for which somebody gave values, or by a rule at what was measured."""
    y = np.full((len(model.outputs), signal.time.size), np.nan)
    if table is not None and table.time.size == signal.time.size:
        y = match_outputs(table, model)
    names = model.names("state")
    if rule != "model" and table is not None:
        log = MatchedLog(table.name, signal.time, signal.at(signal.time), y)
        return dict(zip(names, map(float, initial_states(model, [log], model.theta(**theta), rule)[0]), strict=True))
    x0, found = starts_in(model, signal.time, signal.at(signal.time[:1]), y)
    inputs = model.names("input")
    unused = {one.state for one in model.starts if one.signal in inputs and one.signal not in given}
    return {name: float(x0[k]) for k, name in enumerate(names) if found[k] and name not in unused}


def _values(model: Model, values: Mapping[str, float | str]) -> tuple[dict[str, float], dict[str, float]]:
    """Values given as they are shown, as those of parameters and those of inputs, in coherent SI."""
    theta: dict[str, float] = {}
    constants: dict[str, float] = {}
    parameters, inputs = model.names("parameter"), model.names("input")
    for name, value in values.items():
        if name in parameters and not isinstance(value, str):
            theta[name] = model.parameters[parameters.index(name)].coherent(value)
        elif name in inputs:
            info = model.inputs[inputs.index(name)]
            constants[name] = model.input_value(name, value) if isinstance(value, str) else info.coherent(value)
        else:
            known = (*parameters, *inputs)
            raise OptionError(
                f"--set {name}: {model.name} has no parameter or input of this name{suggest(name, known)} - it has "
                f"{', '.join(known)}",
                where=("--set", name),
            )
    return theta, constants


def _initial(
    model: Model,
    energies: Mapping[str, tuple[str, Expr | None]],
    given: Mapping[str, float],
    theta: Mapping[str, float],
) -> dict[str, float]:
    """Initial states by their names, given by these or by energy variables of the independent storages."""
    parameters = {parameter.name: parameter.value for parameter in model.parameters} | dict(theta)
    found = {}
    for name, value in given.items():
        if name in energies:
            state, inertia = energies[name]
            found[state] = value / inertia_value(inertia, parameters)
        elif name in model.names("state"):
            found[name] = model.states[model.index("state", name)].coherent(value)
        else:
            known = model.names("state")
            raise OptionError(
                f"--initial {name}: {model.name} has no state of this name{suggest(name, (*known, *energies))} - it "
                f"has {', '.join(known)}",
                where=("--initial", name),
            )
    return found


def _inputs(
    model: Model, inputs: Log | None, constants: Mapping[str, float], options: SimulationOptions
) -> tuple[FloatArray, InputSignal]:
    """Times of the answer, and the input signal."""
    if options.scenario is not None:
        return _scenario_inputs(model, options.scenario, constants, options)
    if inputs is None:
        if options.until is None:
            raise OptionError("simulate needs --until T, or --inputs with a table that has an end", where=("--until",))
        times = np.array([0.0, options.until])
        values = np.repeat(model.u0()[:, np.newaxis], 2, axis=1)
    else:
        times, values = inputs.time, match_inputs(inputs, model, given=constants)
    for name, value in constants.items():
        values[model.index("input", name)] = value
    end = float(times[-1]) if options.until is None else options.until
    if end <= times[0]:
        raise OptionError(f"--until {end:g} lies before the start at {times[0]:g} s", where=("--until",))
    if options.step is not None:
        count = _steps(end - float(times[0]), options.step)
        wanted = times[0] + options.step * np.arange(count + 1)
    elif inputs is not None and times.size > 2:
        wanted = times[times <= end]
    else:
        wanted = np.linspace(times[0], end, _POINTS + 1)
    given = {*constants, *(inputs.channels if inputs is not None else ())}
    return wanted, InputSignal.of_table(model, times, values, given)


def _steps(duration: float, step: float) -> int:
    """How many steps fit into a duration."""
    if duration > step * _MOST_POINTS:
        raise OptionError(
            f"--step {step:g}: gives more than {_MOST_POINTS} points in {duration:g} s - take a longer step",
            where=("--step",),
        )
    return max(1, int(np.floor(duration / step + 1e-9)))


def _scenario_inputs(
    model: Model, scenario: Scenario, constants: Mapping[str, float], options: SimulationOptions
) -> tuple[FloatArray, InputSignal]:
    shorter = scenario if options.until is None else replace(scenario, duration=options.until)
    signal = scenario.signal(model)
    values = signal.values.copy()
    for name, value in constants.items():
        values[model.index("input", name)] = value
    if options.step is not None:
        _steps(shorter.duration, options.step)
    times = shorter.times() if options.step is None else shorter.times(options.step)
    return times, InputSignal.of_table(model, signal.time, values, constants)


def input_notes(
    model: Model, inputs: Log | None, given: Container[str], mapping: Mapping[str, str] | None = None
) -> list[str]:
    """Sentences on inputs that nobody gave a value, in the table or without one, and on columns that are not used."""
    modes = {mode.input for mode in model.modes}
    columns = [] if inputs is None else [(mapping or {}).get(name, name) for name in inputs.channels]
    unused = [name for name in columns if name not in names_of(model)]
    lacking = [one for one in model.inputs if not (one.name in given or one.name in columns or one.name in modes)]
    notes = [f"columns the model does not use: {few(unused)}"] if unused else []
    return notes + [
        f"input {one.name!r} has no value; 0 {one.unit} is taken - give it with --set {one.name}=VALUE"
        if not one.has_default
        else f"input {one.name!r} is not in the table; {one.default:g} {one.unit} is taken from the declaration"
        for one in lacking
        if not (one.rate_of or one.late_of) and (inputs is not None or not one.has_default)
    ]


def trajectory_log(trajectory: Trajectory, inputs: bool = False) -> Log:
    """A trajectory as a log in declared units: states, outputs that are not states already, and modes.

    With its ``inputs`` it is a log that the model can be filtered, estimated or simulated with again.
    """
    model = trajectory.model
    channels: dict[str, LogChannel] = {}
    infos: list[StateInfo | OutputInfo] = [*model.states, *model.outputs]
    for info, values in zip(infos, (*trajectory.x, *trajectory.y), strict=True):
        if info.name not in channels:
            channels[info.name] = LogChannel(info.name, info.display_unit or "1", info.shown(values))
    for mode in model.modes:
        channels.setdefault(mode.input, LogChannel(mode.input, "1", trajectory.input(mode.input)))
    for one in model.inputs if inputs else ():
        if not (one.rate_of or one.late_of) and one.name not in channels:
            channels[one.name] = LogChannel(one.name, one.display_unit or "1", one.shown(trajectory.input(one.name)))
    return Log(model.name, trajectory.time, channels)
