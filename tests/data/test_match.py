"""Matching a log to a model, what is said about it, and parts of logs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.data.checks import check_log
from bondgraph.data.header import convert_unit
from bondgraph.data.log import Log, LogChannel
from bondgraph.data.matching import match, read_mapping
from bondgraph.data.select import decimate, split, window
from bondgraph.errors import DataError, OptionError


@dataclass(frozen=True)
class Named:
    name: str
    unit: str


@dataclass(frozen=True)
class Signal(Named):
    default: float = 0.0
    interpolation: str = "linear"
    letters: Mapping[str, float] | None = None
    rate_of: str = ""
    late_of: str = ""

    @property
    def has_default(self) -> bool:
        return self.default != 0.0 or self.unit == "A"


@dataclass(frozen=True)
class Car:
    name: str = "car"
    inputs: tuple[Signal, ...] = (
        Signal("torque", "N m"),
        Signal("gear", "1", 10.0, "hold", {"H": 10.0, "L": 22.0}),
        Signal("grade", "1", 0.05),
    )
    parameters: tuple[Named, ...] = (Named("mass", "kg"), Named("drag", "m^2"))
    outputs: tuple[Named, ...] = (Named("engine_speed", "rad/s"), Named("speed", "m/s"))


TIME = np.arange(5) * 0.1


def log_of(**columns: tuple[str, list[float] | list[str]]) -> Log:
    channels = {name: LogChannel(name, unit, np.array(values)) for name, (unit, values) in columns.items()}
    return Log("run7", TIME, channels)


def base(**more: tuple[str, list[float] | list[str]]) -> Log:
    nan = float("nan")
    return log_of(
        torque=("kN m", [0.0, nan, 0.2, nan, nan]),
        gear=("text", ["H", "", "L", "", "L"]),
        engine_speed=("rpm", [60.0, nan, 120.0, nan, 30.0]),
        oil=("degC", [20.0, 21.0, 22.0, 23.0, 24.0]),
        **more,
    )


def test_units_become_those_of_the_model_and_missing_measurements_stay_missing() -> None:
    matched = match(base(), Car())
    rpm = 2.0 * np.pi / 60.0
    np.testing.assert_allclose(matched.y[0], [60.0 * rpm, np.nan, 120.0 * rpm, np.nan, 30.0 * rpm])
    assert np.isnan(matched.y[1]).all()
    assert "output 'speed' is not in the log; it counts as not measured" in matched.notes


def test_inputs_run_between_samples_as_they_declare() -> None:
    matched = match(base(), Car())
    np.testing.assert_allclose(matched.u[0], [0.0, 100.0, 200.0, 200.0, 200.0])
    np.testing.assert_array_equal(matched.u[1], [10.0, 10.0, 22.0, 22.0, 22.0])
    np.testing.assert_array_equal(matched.u[2], np.full(5, 0.05))
    assert "input 'grade' is not in the log; 0.05 1 is taken from the declaration" in matched.notes
    assert "input 'torque' is interpolated over 3 of 5 samples" in matched.notes
    assert "input 'gear' is held over 2 of 5 samples" in matched.notes


def test_a_held_input_has_its_first_value_before_the_first_sample() -> None:
    log = log_of(gear=("text", ["", "", "L", "", "H"]), speed=("m/s", [1.0] * 5))
    matched = match(log, Car(), given={"torque": 0.0})
    np.testing.assert_array_equal(matched.u[1], [22.0, 22.0, 22.0, 22.0, 10.0])


def test_an_input_without_values_is_refused_unless_it_is_given() -> None:
    """Before, the torque was taken as 0 N m and the log was filtered as a coast-down."""
    speed = ("m/s", [1.0] * 5)
    silent = (log_of(speed=speed), log_of(speed=speed, torque=("N m", [float("nan")] * 5)))
    for log in silent:
        with pytest.raises(DataError, match=r"^run7: no values for the input 'torque' \[N m\] of car.* --set torque=0"):
            match(log, Car())
        matched = match(log, Car(), given={"torque": 40.0})
        np.testing.assert_array_equal(matched.u[0], np.full(5, 40.0))
        assert "input 'torque' is not in the log; 40 N m is taken as given" in matched.notes


def test_a_column_that_is_there_but_empty_is_told_and_not_suggested_for_itself() -> None:
    """Before, the user was asked to map a column of the same name, which stood in the list of columns."""
    nothing = [float("nan")] * 5
    with pytest.raises(DataError, match=r"of car; column 'torque' is there, but empty - map a column"):
        match(log_of(speed=("m/s", [1.0] * 5), torque=("N m", nothing)), Car())
    with pytest.raises(DataError, match=r"is measured; column 'speed' is there, but empty - the columns are"):
        match(log_of(speed=("m/s", nothing), torque=("N m", [1.0] * 5)), Car())


def test_the_column_that_may_hold_a_missing_input_is_suggested() -> None:
    with pytest.raises(DataError, match=r"did you mean 'torqe'\? - map a column with --map column=torque"):
        match(log_of(torqe=("N m", [1.0] * 5), speed=("m/s", [1.0] * 5)), Car())


def test_a_given_value_does_not_hide_a_column() -> None:
    matched = match(base(), Car(), given={"torque": 40.0})
    assert matched.u[0, 2] == pytest.approx(200.0)
    assert "input 'torque' is in the log; the value 40.0 given for it is not used" in matched.notes


def test_given_letters_and_names_are_checked() -> None:
    log = log_of(speed=("m/s", [1.0] * 5))
    assert match(log, Car(), given={"torque": 0.0, "gear": "L"}).u[1].tolist() == [22.0] * 5
    with pytest.raises(OptionError, match="--set gear=X: the value must be a number or one of H, L"):
        match(log, Car(), given={"torque": 0.0, "gear": "X"})
    with pytest.raises(OptionError, match="--set torqe: car has no input of this name; did you mean 'torque'"):
        match(log, Car(), given={"torqe": 0.0})


def test_every_missing_input_is_named_once() -> None:
    two = replace(Car(), inputs=(Signal("a", "N"), Signal("b", "V"), Signal("c", "A")))
    with pytest.raises(
        DataError, match=r"no values for the inputs 'a' \[N\], 'b' \[V\] of car - .* --set a=0 --set b=0"
    ):
        match(log_of(speed=("m/s", [1.0] * 5)), two)


def test_columns_that_the_model_does_not_use_are_listed() -> None:
    matched = match(base(), Car())
    assert matched.unmatched == ("oil",)
    assert "columns the model does not use: oil" in matched.notes


def test_a_constant_column_called_like_a_parameter_is_known_for_this_log() -> None:
    matched = match(base(mass=("g", [2.5e5] * 5)), Car())
    assert matched.theta_overrides == {"mass": pytest.approx(250.0)}
    with pytest.raises(DataError, match="one value per log, but varies from 250 to 251 kg"):
        match(base(mass=("kg", [250.0, 250.0, 251.0, 250.0, 250.0])), Car())


def test_other_names_are_mapped_and_collisions_refused() -> None:
    log = log_of(rev=("rpm", [60.0] * 5), torque=("N m", [0.0] * 5))
    assert match(log, Car(), {"rev": "engine_speed"}).y[0] == pytest.approx(2.0 * np.pi)
    both = log_of(rev=("rpm", [60.0] * 5), engine_speed=("rpm", [60.0] * 5))
    with pytest.raises(DataError, match="columns 'rev' and 'engine_speed' both give 'engine_speed'"):
        match(both, Car(), {"rev": "engine_speed"})
    with pytest.raises(DataError, match="mapped to 'engine_sped', which car does not have; did you mean"):
        match(log, Car(), {"rev": "engine_sped"})
    with pytest.raises(DataError, match="no column 'revs' to map to 'engine_speed'; did you mean 'rev'"):
        match(log, Car(), {"revs": "engine_speed"})


def test_numbers_of_a_coded_signal_are_codes_or_values() -> None:
    numbered = replace(Car(), inputs=(Signal("gear", "1", 1.0, "hold", {"1": 10.0, "2": 20.0}),))
    codes = log_of(gear=("1", [1.0, 1.0, 2.0, 2.0, 1.0]), speed=("m/s", [1.0] * 5))
    np.testing.assert_array_equal(match(codes, numbered).u[0], [10.0, 10.0, 20.0, 20.0, 10.0])
    values = log_of(gear=("1", [10.0, 10.0, 20.0, 20.0, 15.0]), speed=("m/s", [1.0] * 5))
    np.testing.assert_array_equal(match(values, numbered).u[0], [10.0, 10.0, 20.0, 20.0, 15.0])


REFUSED = {
    "unknown code": (base(), {"gear": ("text", ["H", "", "X", "", "L"])}, r"has 'X' \(row 4\).*the model knows H, L"),
    "dimension": (base(), {"torque": ("N", [0.0] * 5)}, "has unit 'N' .* but the model needs 'N m'"),
    "cycles": (base(), {"engine_speed": ("Hz", [1.0] * 5)}, "counts cycles or radians, .* write 'rpm'"),
    "text": (base(), {"speed": ("1", ["a", "b", "c", "d", "e"])}, r"holds codes such as 'a' \(row 2\)"),
    "empty parameter": (base(), {"mass": ("kg", [float("nan")] * 5)}, "sets parameter 'mass' but is empty"),
}


@pytest.mark.parametrize(("log", "change", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_matched_is_refused(log: Log, change: dict, message: str) -> None:
    changed = log_of(**change)
    with pytest.raises(DataError, match=message):
        match(replace(log, channels={**log.channels, **changed.channels}), Car())


def test_a_log_that_measures_no_output_is_refused() -> None:
    with pytest.raises(DataError, match=r"none of the outputs of car .* is measured; did you mean 'engine_spd'"):
        match(log_of(engine_spd=("rpm", [1.0, 2.0, 3.0, 4.0, 5.0])), Car())


def test_a_pair_of_a_mapping_that_changes_nothing_is_told() -> None:
    """A pair with a wrong column was taken in silence where the log has the name of the model too."""
    before, after = (match(base(), Car(), mapping).notes for mapping in ({}, {"spd": "engine_speed"}))
    (note,) = set(after) - set(before)
    assert note.startswith("no column 'spd' to map to 'engine_speed'") and set(before) < set(after)


def test_mappings_come_from_options_and_files(tmp_path: Path) -> None:
    path = tmp_path / "names.json"
    path.write_text(json.dumps({"rev": "engine_speed"}))
    assert read_mapping([str(path), "v = speed"]) == {"rev": "engine_speed", "v": "speed"}
    with pytest.raises(OptionError, match="write it as column=name"):
        read_mapping(["rev"])
    with pytest.raises(OptionError, match="is mapped to 'engine_speed' and to 'speed'"):
        read_mapping([str(path), "rev=speed"])
    with pytest.raises(OptionError, match="cannot be read"):
        read_mapping([str(tmp_path / "absent.json")])
    path.write_text("[1]")
    with pytest.raises(OptionError, match="must hold an object"):
        read_mapping([str(path)])


def one(values: np.ndarray, unit: str = "m/s", rate: float = 100.0) -> Log:
    return Log("run7", np.arange(values.size) / rate, {"v": LogChannel("v", unit, values)})


def wave() -> np.ndarray:
    return 5.0 + np.sin(np.arange(400) / 20.0) + 0.01 * np.cos(np.arange(400) * 1.7)


def test_a_healthy_channel_has_no_findings() -> None:
    assert check_log(one(wave())) == ()


@pytest.mark.parametrize(
    ("change", "kind", "rows", "message"),
    [
        (
            lambda v: v.__setitem__(slice(100, 300), np.nan),
            "gap",
            (102, 301),
            "from 0.99 s to 3 s (rows 102 to 301)",
        ),
        (lambda v: v.__setitem__(slice(None), 3.0), "constant", (2, 401), "constant at 3 m/s in all 400"),
        (lambda v: v.__setitem__(slice(None), np.nan), "missing", (2, 401), "no measurement at all"),
        (lambda v: np.minimum(v, 5.8, out=v), "saturation", None, "rests at its highest value 5.8 m/s for"),
        (lambda v: v.__setitem__(50, 3e3), "beyond limits", (52, 52), "beyond -400 to 400 m/s in row 52"),
        (lambda v: v.__setitem__(50, 0.0), "spike", (52, 52), "jumps away and back in row 52"),
    ],
)
def test_every_trouble_has_its_finding(change: object, kind: str, rows: tuple[int, int] | None, message: str) -> None:
    values = wave()
    change(values)  # type: ignore[operator]
    finding = next(finding for finding in check_log(one(values)) if finding.kind == kind)
    assert rows is None or finding.rows == rows
    assert message in finding.message


def test_limits_can_be_given_per_channel() -> None:
    (finding,) = check_log(one(wave()), {"v": (0.0, 5.9)})
    assert finding.kind == "beyond limits" and "beyond 0 to 5.9 m/s" in finding.message


def test_findings_of_used_columns_reach_the_notes() -> None:
    log = base(speed=("m/s", [3.0] * 5), spare=("m/s", [3.0] * 5))
    notes = match(log, Car()).notes
    assert "column 'speed' is constant at 3 m/s in all 5 samples" in notes
    assert not any("'spare' is constant" in note for note in notes)


def test_pedals_at_their_stops_and_known_values_are_no_trouble() -> None:
    time = np.arange(100) * 0.1
    rest = np.where(np.arange(100) < 50, 40.0, 20.0 + 0.01 * np.arange(100))
    channels = [
        LogChannel("torque", "N m", rest),
        LogChannel("speed", "m/s", rest),
        LogChannel("mass", "kg", 0 * time + 250),
    ]
    notes = match(Log("run7", time, {channel.name: channel for channel in channels}), Car()).notes
    assert any("'speed' rests at its highest value" in note for note in notes)
    assert not any("'torque' rests" in note or "'mass' is constant" in note for note in notes)


def test_dropouts_of_the_engine_speed_of_a_measured_launch_are_found(shared_data: Path) -> None:
    table = np.genfromtxt(
        shared_data / "measured" / "baja_terps_tr24" / "runs_100hz.csv.gz", delimiter=",", names=True, encoding="utf-8"
    )
    runs = set()
    for run in np.unique(table["run"]):
        part = table[table["run"] == run]
        channel = LogChannel("engine_speed", "rpm", part["engine_rpm"].astype(float))
        findings = check_log(Log(f"run {run:g}", part["t_s"].astype(float), {"engine_speed": channel}))
        runs |= {int(run) for finding in findings if finding.kind == "spike"}
    assert {1, 2} <= runs


def test_parts_of_logs() -> None:
    log = one(wave())
    first, second = split(log, 0.25)
    assert len(first) + len(second) == len(log) and first.time[-1] < second.time[0]
    assert len(window(log, 1.0, 2.0)) == 100
    with pytest.raises(DataError, match=r"no samples from 9 s to 10 s; the log runs from 0 s to 3\.99 s"):
        window(log, 9.0, 10.0)
    with pytest.raises(DataError, match=r"no samples from 9 s on; the log runs"):
        window(log, 9.0, np.inf)
    with pytest.raises(DataError, match=r"no samples to -1 s; the log runs"):
        window(log, -np.inf, -1.0)
    with pytest.raises(DataError, match="cannot be split at 1 "):
        split(log, 1.0)
    with pytest.raises(DataError, match="rate of 0 samples"):
        decimate(log, 0.0)


@settings(max_examples=30, deadline=None)
@given(step=st.integers(1, 20), jitter=st.floats(0.0, 0.2))
def test_decimation_keeps_samples_as_they_are_and_no_signal_vanishes(step: int, jitter: float) -> None:
    rng = np.random.default_rng(step)
    time = (np.arange(400) + jitter * rng.uniform(-1, 1, 400)) / 100.0
    odd, even = (np.where(np.arange(400) % 2 == side, wave(), np.nan) for side in (0, 1))
    channels = {"a": LogChannel("a", "m/s", odd), "b": LogChannel("b", "m/s", even)}
    log = Log("run7", time, channels)
    thin = decimate(log, 100.0 / step)
    rows = np.searchsorted(time, thin.time)
    for name, full in channels.items():
        np.testing.assert_array_equal(thin.channel(name).values, full.values[rows])
        kept = int((~thin.channel(name).missing).sum())
        # jitter may put two neighbours into one interval and none into the next, but never empties a signal
        assert kept >= 400 // max(step, 2) // 2


@pytest.mark.parametrize("unit", ["1/min", "1/s", "Hz"])
def test_a_bare_number_per_time_is_no_angular_speed(unit):
    """3000 1/min were read as 50 rad/s."""
    with pytest.raises(DataError, match=r"which counts cycles or radians, .* write 'rpm' .* 'rad/s'"):
        convert_unit("n", unit, "rad/s", "run7")
    with pytest.raises(DataError, match="an angular speed, but the model needs"):
        convert_unit("n", "rpm", unit, "run7")
    assert convert_unit("rate", unit, "1/s", "run7")[1] == 0.0


@pytest.mark.parametrize(("unit", "meant"), [("U/min", "rpm"), ("Grad", "deg"), ("UPM", "rpm"), ("Grad/s", "deg/s")])
def test_other_spellings_of_speeds_and_angles_are_told(unit, meant):
    with pytest.raises(DataError, match=f"run7: column 'n' has unit '{unit}' .row 1.; did you mean '{meant}'"):
        convert_unit("n", unit, "rad/s", "run7")


def test_a_command_may_be_given_for_one_sample() -> None:
    """A torque that was held and stepped was said to jump away and back, like the outliers of a sensor."""
    time = 0.1 * np.arange(100)
    pulse = np.where(np.arange(100) == 50, 40.0, 1.0 + 1e-3 * np.sin(time))

    def notes(interpolation: str) -> list[str]:
        car = replace(Car(), inputs=(Signal("torque", "N m", 0.0, interpolation),))
        columns = {"torque": LogChannel("torque", "N m", pulse), "speed": LogChannel("speed", "m/s", time)}
        return [note for note in match(Log("run", time, columns), car).notes if "jumps away and back" in note]

    assert notes("hold") == [] and len(notes("linear")) == 1
