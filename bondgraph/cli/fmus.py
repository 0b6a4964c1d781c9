"""FMUs where a command takes a graph: simulated along a log, and laid over one."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from bondgraph.cli.between import ways_between
from bondgraph.cli.folders import answer_folder
from bondgraph.cli.given_logs import read_given, read_parts, units_by_column
from bondgraph.cli.printing import say
from bondgraph.cli.tables import give_table
from bondgraph.cli.values import assignments, initial
from bondgraph.data.log import Log
from bondgraph.data.matching import match, read_mapping, renamed
from bondgraph.errors import OptionError
from bondgraph.exchange.fmu_import import RTOL, FmuRun, run_fmu, with_units
from bondgraph.exchange.fmu_variables import Fmu, read_fmu
from bondgraph.report.comparison import Compared, ComparedLog, comparison_text, laid_over, write_comparison
from bondgraph.report.figures import save_figure
from bondgraph.report.inspection import inspection_figure
from bondgraph.text import few

#: Options of ``simulate`` that say something of a graph, by their names in the options, and why an FMU has none of it.
_OF_GRAPHS: Mapping[str, str] = {
    "scenario": "scenarios are declared beside a graph",
    "exact": "it has no modes that are known here",
    "all": "it has no bonds",
    "step": "it answers at the samples of the log",
    "atol": "its maker sets the size of its states",
}


def is_fmu(reference: str) -> bool:
    """True for a reference to an FMU.

    Examples
    --------
    >>> is_fmu("engine.fmu"), is_fmu("sled.py")
    (True, False)
    """
    return Path(reference).suffix == ".fmu"


def simulate_fmu(options: argparse.Namespace) -> int:
    """Write the outputs of an FMU along a log."""
    for name, reason in _OF_GRAPHS.items():
        if getattr(options, name):
            raise OptionError(f"--{name} is not for an FMU: {reason}", where=(f"--{name}", options.graph))
    if not options.inputs:
        raise OptionError(
            f"{options.graph}: an FMU is simulated along a log - give it with --inputs", where=("--inputs",)
        )
    fmu, log = _fed(options, options.graph, read_given(options.inputs, options))
    values = {**initial(options.initial), **assignments(options.set, "--set")}
    run = _run(fmu, log, options, values, options.rtol)
    unused = [name for name in log.channels if name not in {one.name for one in (*fmu.inputs, *fmu.parameters)}]
    for line in (*run.notes, *([f"columns the FMU does not use: {few(unused)}"] if unused else [])):
        print(line, file=sys.stderr)
    if options.plot:
        save_figure(inspection_figure(run.log), Path(options.plot))
        print(f"picture: {options.plot}", file=sys.stderr)
    give_table(run.log, options.out, bool(options.plot))
    return 0


def compare_fmu(options: argparse.Namespace) -> int:
    """Lay an FMU over logs."""
    folder = answer_folder(options)
    runs = [_compared(options, log) for path in options.data for log in read_parts(path, options)]
    compared = Compared(read_fmu(options.model).name, tuple(runs), ())
    write_comparison(compared, folder)
    say(comparison_text(compared))
    print(f"written: {folder}")
    return 0


def _fed(options: argparse.Namespace, path: str, read: Log) -> tuple[Fmu, Log]:
    """An FMU in the units that a log and the options tell, and the log with its names."""
    if options.start == "settled":
        raise OptionError(
            "--start settled is not for an FMU: where it comes to rest is not known; its states start as it declares, "
            "or as given",
            where=("--start", path),
        )
    fmu = read_fmu(path)
    log = renamed(read, fmu, read_mapping(options.map))
    return with_units(fmu, units_by_column(options.fmu_units, "--fmu-units"), log), log


def _run(
    fmu: Fmu, log: Log, options: argparse.Namespace, values: Mapping[str, float | str], rtol: float = RTOL
) -> FmuRun:
    ways = ways_between([one.name for one in fmu.inputs if one.interpolation == "linear"], options)
    for name, way in ways.items():
        if way == "band limited":
            raise OptionError(
                f"--inputs-between {name}=band: inputs of an FMU are held or linear between samples",
                where=("--inputs-between", name),
            )
    held = [name for name, way in ways.items() if way == "hold"]
    return run_fmu(fmu, log, values=values, held=held, rtol=rtol)


def _compared(options: argparse.Namespace, read: Log) -> ComparedLog:
    fmu, log = _fed(options, options.model, read)
    values = assignments(options.set, "--set")
    inputs = {name: value for name, value in values.items() if name in {one.name for one in fmu.inputs}}
    matched = match(log, fmu, given=inputs)
    run = _run(fmu, log, options, values)
    for line in (*matched.notes, *run.notes):
        say(line, sys.stderr)
    channels = [
        (one.name, one.unit, measured, run.log.channels[one.name].numbers)
        for one, measured in zip(fmu.outputs, matched.y, strict=True)
        if not np.isnan(measured).all()
    ]
    return laid_over(log.name, log.time, channels, run.log)
