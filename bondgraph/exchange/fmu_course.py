"""An FMU along a course of its inputs, by FMPy: what it is fed with between samples, and its answer at samples."""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bondgraph.data.log import FloatArray, Log
from bondgraph.errors import BondGraphError, DataError, ModelError
from bondgraph.exchange.fmu_variables import Fmu, FmuVariable, said
from bondgraph.exchange.libraries import library

#: Kinds of FMUs as FMPy calls them.
_FMPY = {"co-simulation": "CoSimulation", "model-exchange": "ModelExchange"}
#: Communication steps that FMPy is given at a time: so few that the search for the next event costs less than a step.
_BLOCK = 500
#: Share of a step by which times of an even log differ from even ones, by the digits in which they are written.
_EVEN = 0.01
#: Relative distance below which FMPy takes two times for one (that of math.isclose), with a margin of ten.
_CLOSEST = 1e-8


@dataclass(frozen=True)
class Course:
    """Inputs over time: at each of ``times`` their numbers before and after, shape (n_u, n); ``wanted`` are samples.

    ``interval`` is that of the answer: a step of an FMU whose steps are even, else all of the time.
    """

    times: FloatArray
    before: FloatArray
    after: FloatArray
    wanted: FloatArray
    interval: float

    def table(self, fmu: Fmu) -> Any:
        """The course as FMPy reads it: every time twice, with the numbers before and after."""
        both = np.zeros(2 * self.times.size, dtype=[(name, float) for name in ("time", *_names(fmu.inputs))])
        both["time"] = np.repeat(self.times, 2)
        for one, before, after in zip(fmu.inputs, self.before, self.after, strict=True):
            both[one.name] = np.stack([before, after], axis=1).ravel()
        return both


def _names(variables: Collection[FmuVariable]) -> list[str]:
    return [one.name for one in variables]


def course_of(fmu: Fmu, log: Log, rows: FloatArray, kind: str, steps: int) -> Course:
    """Inputs of an FMU: values at the samples of a log, shape (n_u, n), between them as they run.

    Raises
    ------
    DataError
        If the times cannot be told apart, or are uneven where the FMU asks for even steps.
    """
    samples = log.time
    if np.diff(samples).min() <= _CLOSEST * np.abs(samples).max():
        raise DataError(
            f"{log.name}: samples follow each other so closely that FMPy takes their times for one"
            " - count the time from the start of the log",
            where=(log.name, "time"),
        )
    span = float(samples[-1] - samples[0])
    held = np.array([one.interpolation == "hold" for one in fmu.inputs], dtype=bool)[:, np.newaxis]
    earlier = np.concatenate([rows[:, :1], rows[:, :-1]], axis=1)
    if kind == "model-exchange":
        return Course(samples, np.where(held, earlier, rows), rows, samples, span)
    interval = span
    if not fmu.described.coSimulation.canHandleVariableCommunicationStepSize:
        step = span / (samples.size - 1)
        even = samples[0] + step * np.arange(samples.size)
        if np.abs(even - samples).max() > _EVEN * step:
            raise DataError(
                f"{log.name}: the steps of time are uneven, and {fmu.name} allows even ones only - "
                "bring the log to even steps first",
                where=(log.name, "time"),
            )
        samples, interval = even, step / steps
    place = np.arange((samples.size - 1) * steps + 1) / steps
    times = np.interp(place, np.arange(samples.size), samples)
    times[::steps] = samples
    index = np.arange(samples.size)
    middle = np.array([np.interp(place[:-1] + 0.5 / steps, index, row) for row in rows]).reshape(-1, times.size - 1)
    kept = np.where(held, np.repeat(rows[:, :-1], steps, axis=1), middle)
    before, after = (np.concatenate(pair, axis=1) for pair in ((rows[:, :1], kept), (kept, rows[:, -1:])))
    return Course(times, before, after, samples, interval)


def simulated(fmu: Fmu, course: Course, starts: Mapping[str, float], kind: str, rtol: float) -> FloatArray:
    """Outputs at the samples, shape (n_y, n), as numbers of the FMU.

    Raises
    ------
    ModelError
        If the FMU is not for this machine, or fails.
    GenerationError
        If FMPy is not installed.
    """
    fmpy = library("fmpy", "fmu")
    simulation = library("fmpy.simulation", "fmu")
    printed = io.StringIO()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        try:
            fmpy.extract(fmu.path, folder)
            _require_binary(fmu, fmpy, folder)
            with contextlib.redirect_stdout(printed):
                instance = simulation.instantiate_fmu(folder, fmu.described, _FMPY[kind])
                if kind == "model-exchange":
                    _let_inputs_run(instance, fmu, course)
                answer = _answer(simulation, folder, fmu, instance, course, starts, kind, rtol)
                instance.freeInstance()
        except BondGraphError:
            raise
        except Exception as error:  # FMPy raises many kinds, among them bare exceptions
            lines = [line.strip() for line in printed.getvalue().splitlines() if line.strip()]
            raise ModelError(
                f"{fmu.path}: the FMU fails as {kind}: {said(error)}" + (f" ({lines[-1]})" if lines else ""),
                where=(str(fmu.path),),
            ) from None
    return _at_samples(fmu, course, answer)


def _answer(
    simulation: Any, folder: str, fmu: Fmu, instance: Any, course: Course, starts: Mapping[str, float], kind: str,
    rtol: float,
) -> Any:  # fmt: skip
    """Records of FMPy; co-simulation goes block by block, since FMPy seeks each event among all of its inputs."""
    table, answers, last = course.table(fmu), [], course.times.size - 1
    block = _BLOCK if kind == "co-simulation" else last
    for first in range(0, last, block):
        end = min(first + block, last)
        begins, ends = first == 0, end == last
        # at the first time of a table FMPy takes its first row: before the start, after the end of a block before
        rows = table[2 * first + (not begins) : 2 * end + 2] if fmu.inputs else None
        answers.append(
            simulation.simulate_fmu(
                folder, start_time=course.times[first], stop_time=course.times[end], set_stop_time=False,
                relative_tolerance=rtol, output_interval=course.interval, output=_names(fmu.outputs),
                input=rows, start_values=dict(starts) if begins else {},
                model_description=fmu.described, fmi_type=_FMPY[kind], fmu_instance=instance, initialize=begins,
                terminate=ends,
            )
        )  # fmt: skip
    return np.concatenate(answers)


def _require_binary(fmu: Fmu, fmpy: Any, folder: str) -> None:
    held = fmpy.supported_platforms(folder)
    if fmpy.platform not in held:
        raise ModelError(
            f"{fmu.path}: the FMU has no binary for this machine ({fmpy.platform}), it has {', '.join(held) or 'none'}"
            + (" - compile its sources, such as by: fmpy compile FILE.fmu" if "c-code" in held else ""),
            where=(str(fmu.path), fmpy.platform),
        )


def _let_inputs_run(instance: Any, fmu: Fmu, course: Course) -> None:
    """Let inputs run linearly with the time at which the solver asks; FMPy sets them at the ends of its steps only."""
    running = [k for k, one in enumerate(fmu.inputs) if one.interpolation == "linear"]
    kinds = sorted({fmu.inputs[k].kind for k in running})
    groups: list[tuple[Callable[..., Any], list[int], FloatArray]] = []
    for kind in kinds:
        chosen = [k for k in running if fmu.inputs[k].kind == kind]
        groups.append(
            (getattr(instance, f"set{kind}"), [fmu.inputs[k].reference for k in chosen], course.after[chosen])
        )
    times, set_time = course.times, instance.setTime

    def set_both(time: float) -> Any:
        status = set_time(time)
        k = min(max(int(np.searchsorted(times, time, side="right")) - 1, 0), times.size - 2)
        share = min(max((time - times[k]) / (times[k + 1] - times[k]), 0.0), 1.0)
        for setter, references, rows in groups:
            setter(references, list(rows[:, k] + share * (rows[:, k + 1] - rows[:, k])))
        return status

    if groups:
        instance.setTime = set_both


def _at_samples(fmu: Fmu, course: Course, answer: Any) -> FloatArray:
    """The last of the rows that FMPy gives for each sample: before an event, it gives one more."""
    reached, close = answer["time"], _CLOSEST * max(1.0, float(np.abs(course.wanted).max()))
    place = np.searchsorted(reached, course.wanted + close, side="right") - 1
    late = np.flatnonzero(np.abs(reached[place] - course.wanted) > close)
    if late.size:
        raise ModelError(
            f"{fmu.path}: the FMU ends the simulation at {reached[-1]:g} s, before the log ends", where=(str(fmu.path),)
        )
    found = np.array([answer[one.name][place] for one in fmu.outputs], dtype=float).reshape(-1, place.size)
    for one, row in zip(fmu.outputs, found, strict=True):
        if not np.isfinite(row).all():
            first = course.wanted[int(np.argmin(np.isfinite(row)))]
            raise ModelError(f"{fmu.path}: output {one.name!r} is no number from {first:g} s on", where=(one.name,))
    return found
