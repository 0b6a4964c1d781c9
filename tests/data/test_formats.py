"""Real files of every format, written by the library of that format, and CSV as the world writes it."""

from __future__ import annotations

import datetime
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bondgraph as bg
from bondgraph.data.formats import csv_quick, csv_text
from bondgraph.data.formats.hdf5 import read_hdf5
from bondgraph.data.formats.matlab import read_mat
from bondgraph.data.formats.mdf import read_mdf
from bondgraph.data.formats.table import Reader
from bondgraph.data.header import Reading
from bondgraph.data.log import Log
from bondgraph.data.read import log_from_table, read_log
from bondgraph.errors import DataError
from bondgraph.simulate.example import pendulum

TIME = np.array([0.0, 0.1, 0.25])


def _read_here(reader: Reader, path: Path, **said: Any) -> Log:
    """A log as its reader gives it in this process, without the wait for another."""
    return log_from_table(reader(path, Reading(**said)), path.name, path.stem, str(path), Reading(**said))


SPEED = np.array([36.0, np.nan, 37.5])


def _write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def _is_the_run(log: Log) -> None:
    np.testing.assert_allclose(log.time, TIME, atol=1e-12)
    np.testing.assert_array_equal(log.channel("speed").values, SPEED)
    assert log.channel("speed").unit == "km/h"


CSV = {
    "semicolons and decimal commas": "time [s];speed [km/h]\n0,0;36\n0,1;\n0,25;37,5\n",
    "semicolons and points": "time [s];speed [km/h]\n0;36\n0.1;\n0.25;37.5\n",
    "tabs": "time [s]\tspeed [km/h]\n0\t36\n0.1\tNaN\n0.25\t37.5\n",
    "tabs and decimal commas": "time [s]\tspeed [km/h]\n0\t36\n0,1\tNA\n0,25\t37,5\n",
    "units in the second row": "time,speed\ns,km/h\n0,36\n0.1,\n0.25,37.5\n",
    "units in brackets in the second row": 'time;speed\n[s];[km/h]\n0;36\n0,1;""\n0,25;37,5\n',
    "the time is not the first column": "speed [km/h],time [ms]\n36,0\n,100\n37.5,250\n",
    "dates": "time,speed [km/h]\n2024-05-01T12:00:00,36\n2024-05-01T12:00:00.1,\n2024-05-01T12:00:00.25,37.5\n",
    "dates with a zone": "time [s],speed [km/h]\n2024-05-01 12:00:00Z,36\n2024-05-01 12:00:00.1Z,\n"
    "2024-05-01 14:00:00.25+02:00,37.5\n",
    "quotes": '"time [s]","speed [km/h]"\n"0","36"\n"0.1",""\n"0.25","37.5"\n',
    "old ends of lines": "time [s],speed [km/h]\r0,36\r0.1,\r0.25,37.5\r",
}


@pytest.mark.parametrize("text", CSV.values(), ids=CSV)
def test_csv_as_the_world_writes_it(tmp_path: Path, text: str) -> None:
    _is_the_run(read_log(_write(tmp_path / "run.csv", text)))


def test_the_column_of_time_and_units_can_be_named(tmp_path: Path) -> None:
    path = _write(tmp_path / "run.csv", "Stamp;v;note [text]\n0;36;a\n100;;\n250;37,5;b\n")
    log = read_log(path, time="Stamp", units={"Stamp": "ms", "v": "km/h"})
    np.testing.assert_allclose(log.time, TIME)
    assert log.channel("v").unit == "km/h" and list(log.channels) == ["v", "note"]


def test_the_date_at_which_a_log_begins_is_kept(tmp_path: Path) -> None:
    log = read_log(_write(tmp_path / "run.csv", CSV["dates"]))
    assert log.metadata["start"].startswith("2024-05-01T12:00:00")


BAD = {
    "both marks": (
        "time [s];v [m/s]\n0;1,5\n1;1.234\n", {},
        "decimal comma in row 2 and a point in row 3, so that one of them may separate thousands",
    ),
    "rows count from the units": ("time,v\ns,m/s\n0,1\n1,fast\n", {}, r"has 'fast' \(row 4\)"),
    "time goes back under units": ("time,v\ns,m/s\n0,1\n1,2\n0.5,2\n", {}, "time does not increase in row 5"),
    "misspelt unit in the second row": ("time,v,w\ns,m/s,rpn\n0,1,2\n", {}, "column 'w' has unit 'rpn'"),
    "no date": ("time,v [1]\n2024-05-01T12:00:00,1\nlater,2\n", {}, r"has 'later' \(row 3\), which is no date"),
    "no day": ("time,v [1]\n2024-05-01T12:00:00,1\n2024-05-32T12:00:00,2\n", {}, "no day or time of a calendar"),
    "one zone": ("time,v [1]\n2024-05-01T12:00:00,1\n2024-05-01T12:00:01Z,2\n", {}, "in its time zone"),
    "unit of no column": ("time [s],v [1]\n0,1\n", {"units": {"w": "rpm"}}, "given for 'w', which is no column"),
    "time of no column": ("time [s],v [1]\n0,1\n", {"time": "stamp"}, "no column 'stamp'.* could hold the time"),
    "no unit of time": ("stamp,v [1]\n0,1\n", {"time": "stamp"}, "column 'stamp' has no unit .* --units 'stamp=UNIT'"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "how", "message"), BAD.values(), ids=BAD)
def test_what_is_wrong_is_said_with_its_row(tmp_path: Path, text: str, how: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        read_log(_write(tmp_path / "run.csv", text), **how)


_CELLS = st.sampled_from(
    ["0", "1.5", "-2e3", ".5", "5.", "", " ", "nan", "NaN", "NA", "n/a", "Null", "inf", "1e999", "+1", "1_0", "0x10",
     " 7 ", "٣", "1,5", '"8"', "x", "H", "true", "9" * 400, "0012", "1d5", "-nan", "-0"]
)  # fmt: skip


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(st.tuples(_CELLS, _CELLS, _CELLS), min_size=1, max_size=4), mark=st.sampled_from(",;\t"),
    end=st.sampled_from(["\n", "\r\n", "\n\n"]), gap=st.sampled_from(["", "", "\n"]),
)  # fmt: skip
def test_the_library_reads_what_the_cells_say(
    tmp_path: Path, rows: list[tuple[str, ...]], mark: str, end: str, gap: str
) -> None:
    """Whatever the quick reader accepts, the slow one reads as the same log or refuses with the same words."""
    lines = [mark.join((f"{k}", *cells)) for k, cells in enumerate(rows)]
    text = mark.join(("time [s]", "v [m/s]", "c [text]", "r [1]")) + "\n" + gap + end.join(lines) + end
    path = tmp_path / "run.csv"
    path.write_bytes(text.encode())
    quick = csv_quick.read_csv_quick(path, Reading())
    if quick is not None:
        assert _outcome(lambda: log_from_table(quick, "run.csv", "run")) == _outcome(
            lambda: log_from_table(csv_text.read_csv_text(path, Reading()), "run.csv", "run")
        )


def _outcome(read: Any) -> Any:
    try:
        log: Log = read()
    except DataError as error:
        return error.message
    return [(one.name, one.unit, [str(value) for value in one.values.tolist()]) for one in log.channels.values()]


@pytest.mark.parametrize("text", [CSV["tabs"], CSV["semicolons and decimal commas"], CSV["dates"]])
def test_ordinary_files_are_read_by_the_library(tmp_path: Path, text: str) -> None:
    assert csv_quick.read_csv_quick(_write(tmp_path / "run.csv", text), Reading()) is not None


def _matlab(kind: str, path: Path, content: dict[str, Any]) -> Path:
    if kind == "v5":
        scipy.io.savemat(path, content)
    else:
        pytest.importorskip("hdf5storage").savemat(str(path), content, format="7.3", store_python_metadata=False)
    return path


_UNITS = {"time": "s", "speed": "km/h"}
MATLAB: dict[str, dict[str, Any]] = {
    "vectors": {"time": TIME, "speed": SPEED, "units": _UNITS},
    "one struct": {"run": {"time": TIME, "speed": SPEED, "driver": "A. B.", "units": _UNITS}},
    "a struct per signal": {
        "run": {"time": TIME, "speed": {"values": SPEED, "unit": "km/h"}, "units": {"time": "s"}},
    },
    "two structs with times of their own": {
        "chassis": {"time": TIME * 1000.0, "speed": SPEED, "units": {"time": "ms", "speed": "km/h"}},
        "engine": {"time": TIME[:2], "torque": np.array([1.0, 2.0]), "units": {"time": "s", "torque": "N m"}},
    },
}


@pytest.mark.parametrize("kind", ["v5", "v73"])
@pytest.mark.parametrize("content", MATLAB.values(), ids=MATLAB)
def test_matlab_structs(tmp_path: Path, kind: str, content: dict[str, Any]) -> None:
    log = _read_here(read_mat, _matlab(kind, tmp_path / "run.mat", content))
    if "chassis" not in content:
        _is_the_run(log)
        return
    np.testing.assert_array_equal(log.channel("chassis.speed").values, SPEED)
    np.testing.assert_array_equal(log.channel("engine.torque").values, [1.0, 2.0, np.nan])


def test_what_simulink_writes(tmp_path: Path) -> None:
    signals = np.array([(SPEED, "speed", 1.0), (2.0 * SPEED, "wheel", 1.0)], dtype=[(n, object) for n in ("values", "label", "dimensions")])  # fmt: skip # noqa: E501
    scipy.io.savemat(tmp_path / "run.mat", {"out": {"time": TIME, "signals": signals, "blockName": "scope"}})
    log = _read_here(read_mat, tmp_path / "run.mat", units={"speed": "km/h", "wheel": "km/h"})
    _is_the_run(log)
    assert list(log.channels) == ["speed", "wheel"]


@pytest.mark.parametrize("version", ["3.30", "4.10"])
def test_mdf_with_a_channel_in_two_groups(tmp_path: Path, version: str) -> None:
    mdf = pytest.importorskip("asammdf")
    valid = ~np.isnan(SPEED)
    with mdf.MDF(version=version) as file:
        for values in (SPEED[valid], SPEED[valid], SPEED[valid] + 1.0):
            file.append([mdf.Signal(values, TIME[valid], unit="km/h", name="speed")], acq_name="bus")
        file.append([mdf.Signal(np.array([7.0]), np.array([0.1]), unit="gubbins", name="odd")])
        saved = file.save(tmp_path / "run.mdf", overwrite=True)
    (tmp_path / "given.mdf").write_bytes(Path(saved).read_bytes())
    log = _read_here(read_mdf, tmp_path / "given.mdf")
    _is_the_run(log)
    np.testing.assert_array_equal(log.channel("speed@2").values, SPEED + 1.0)
    assert "speed@1" not in log.channels and log.channel("odd").unit == "?"


def test_hdf5_groups_and_attributes(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for name, values, unit in (("time", TIME, "s"), ("speed", SPEED, "km/h"), ("mystery", TIME, "")):
            file[f"car/{name}"] = values
            if unit:
                file[f"car/{name}"].attrs["units"] = unit
        file["car/gear"] = np.array([b"N", b"H", b""])
        file["picture"] = np.zeros((4, 4))
    log = _read_here(read_hdf5, tmp_path / "run.h5")
    _is_the_run(log)
    assert log.channel("gear").values.tolist() == ["N", "H", ""] and log.channel("mystery").unit == "?"
    with pytest.raises(DataError, match=r"no data set is called 'stamp' .* there are car/gear, car/mystery, car/speed"):
        _read_here(read_hdf5, tmp_path / "run.h5", time="stamp")


def test_excel_with_units_in_the_second_row(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    start = datetime.datetime(2024, 5, 1, 12)
    for row in (
        ("time", "speed", "gear"), ("s", "km/h", "text"), (start, 36, "N"),
        (start + datetime.timedelta(seconds=0.1), None, "H"), (start + datetime.timedelta(seconds=0.25), 37.5, None),
    ):  # fmt: skip
        book.active.append(row)
    book.save(tmp_path / "run.xlsx")
    log = read_log(tmp_path / "run.xlsx")
    _is_the_run(log)
    assert log.channel("gear").values.tolist() == ["N", "H", ""] and log.first_row == 3


def _twist(store: Any, x: float) -> Any:
    vector = store.types["geometry_msgs/msg/Vector3"]
    return store.types["geometry_msgs/msg/Twist"](linear=vector(x, 0.0, 0.0), angular=vector(0.0, 0.0, 2.0 * x))


def test_ros_bag(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(tmp_path / "run.bag") as bag:
        topic = bag.add_connection("/cmd", "geometry_msgs/msg/Twist", typestore=store)
        for time, speed in zip(TIME, (1.0, 2.0, 3.0), strict=True):
            raw = store.serialize_ros1(_twist(store, speed), "geometry_msgs/msg/Twist")
            bag.write(topic, int(1e18 + time * 1e9), raw)
    log = read_log(tmp_path / "run.bag", units={"cmd.linear.x": "m/s"})
    np.testing.assert_allclose(log.time, TIME, atol=1e-9)
    assert log.channel("cmd.linear.x").unit == "m/s" and log.channel("cmd.angular.z").unit == "?"
    assert log.channel("cmd.angular.z").values.tolist() == [2.0, 4.0, 6.0]


@pytest.mark.parametrize("encoding", ["json", "cdr"])
def test_mcap(tmp_path: Path, encoding: str) -> None:
    writer_module = pytest.importorskip("mcap.writer")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    name = "geometry_msgs/msg/Twist"
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = writer_module.Writer(file)
        writer.start()
        text = store.generate_msgdef(name, ros_version=2)[0].encode()
        schema = writer.register_schema(name, "ros2msg" if encoding == "cdr" else "jsonschema", text)
        channel = writer.register_channel("/cmd", encoding, schema)
        for time, speed in zip(TIME, (1.0, 2.0, 3.0), strict=True):
            message = _twist(store, speed)
            raw = bytes(store.serialize_cdr(message, name)) if encoding == "cdr" else json.dumps(
                {"linear": {"x": speed}, "angular": {"z": 2.0 * speed}, "frame": "base"}
            ).encode()  # fmt: skip
            writer.add_message(channel, log_time=int(1e18 + time * 1e9), publish_time=0, data=raw)
        writer.finish()
    log = read_log(tmp_path / "run.mcap")
    np.testing.assert_allclose(log.time, TIME, atol=1e-9)
    assert log.channel("cmd.angular.z").values.tolist() == [2.0, 4.0, 6.0]


def test_a_unit_that_a_file_cannot_say_is_asked_for_when_it_is_needed() -> None:
    channel = bg.Log("run", TIME, {"deflection": bg.data.LogChannel("deflection", "?", TIME)})
    with pytest.raises(DataError, match=r"column 'deflection' has no unit .* --units 'deflection=m'"):
        bg.match(channel, pendulum(), given={"drive": 0.0})


def test_a_dated_parquet_file(tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    dates = np.datetime64("2024-05-01T12:00:00", "ns") + (TIME * 1e9).astype("timedelta64[ns]")
    parquet.write_table(arrow.table({"time": dates, "speed [km/h]": SPEED}), tmp_path / "run.parquet")
    _is_the_run(read_log(tmp_path / "run.parquet"))


def test_an_unknown_format_says_what_is_read(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"\.mcap \(needs the extra 'mcap'\); pip install 'bondloop\[data\]'"):
        read_log(tmp_path / "run.blf")


_TEXT = b"time [s],v [m/s]\n0,1\n" * 20
_WRONG = [(kind, content) for kind in (".xlsx", ".bag", ".mcap", ".parquet") for content in (b"", b"\x00" * 200, _TEXT)]


@pytest.mark.parametrize(("kind", "content"), [*_WRONG, (".h5", _TEXT)])
def test_what_is_no_file_of_its_kind_is_refused(tmp_path: Path, kind: str, content: bytes) -> None:
    path = tmp_path / f"run{kind}"
    path.write_bytes(content)
    with pytest.raises(DataError, match=rf"run{kind}: this is not a readable") as refused:
        read_log(path)
    assert len(refused.value.message) < 600
