"""Reading and writing: every format gives the same value, and every broken file its own message."""

from __future__ import annotations

import gzip
import importlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bondgraph.data.log import Log, LogChannel
from bondgraph.data.read import read_log
from bondgraph.data.write import write_log
from bondgraph.errors import DataError

TEXT = "time [s],engine_speed [rpm],gear [text],throttle [1]\n0.0,1800,N,0\n0.1,,H,0.5\n0.25,1860.5,,1\n"


def example() -> Log:
    channels = (
        LogChannel("engine_speed", "rpm", np.array([1800.0, np.nan, 1860.5])),
        LogChannel("gear", "text", np.array(["N", "H", ""])),
        LogChannel("throttle", "1", np.array([0.0, 0.5, 1.0])),
    )
    return Log("run7", np.array([0.0, 0.1, 0.25]), {channel.name: channel for channel in channels})


def same(first: Log, second: Log) -> None:
    np.testing.assert_array_equal(first.time, second.time)
    assert list(first.channels) == list(second.channels)
    for name, channel in first.channels.items():
        other = second.channels[name]
        assert (channel.unit, channel.is_text) == (other.unit, other.is_text)
        np.testing.assert_array_equal(channel.values, other.values)


def test_csv_is_read_as_written(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv"
    path.write_text(TEXT)
    log = read_log(path)
    assert log.name == "run7" and log.source == str(path)
    same(log, example())


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".parquet"])
def test_written_log_reads_back_as_the_same_value(tmp_path: Path, suffix: str) -> None:
    same(read_log(write_log(tmp_path / f"run7{suffix}", example())), example())


def test_same_log_gives_the_same_bytes(tmp_path: Path) -> None:
    first, second = (write_log(tmp_path / name, example()).read_bytes() for name in ("a.csv.gz", "b.csv.gz"))
    assert first == second


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=hnp.arrays(np.float64, 5, elements=st.floats(allow_infinity=False)),
    codes=st.lists(st.sampled_from(["", "H", "L", "R 2", 'a"b', "x,y"]), min_size=5, max_size=5),
)
def test_any_numbers_and_codes_survive_a_csv_file(tmp_path: Path, values: np.ndarray, codes: list[str]) -> None:
    channels = {"a": LogChannel("a", "1", values), "code": LogChannel("code", "text", np.array(codes, dtype=np.str_))}
    log = Log("run", np.cumsum(np.array([0.1, 0.2, 0.3, 1e-6, 1e3])), channels)
    same(read_log(write_log(tmp_path / "run.csv", log)), log)


def test_matlab_v5_gives_the_same_value(tmp_path: Path) -> None:
    content = {
        "time": np.array([[0.0, 0.1, 0.25]]).T,
        "engine_speed": np.array([[1800.0, np.nan, 1860.5]]).T,
        "gear": np.array([["N"], ["H"], [""]], dtype=object),
        "throttle": np.array([[0.0, 0.5, 1.0]]).T,
        "units": {"time": "s", "engine_speed": "rpm", "gear": "text", "throttle": "1"},
    }
    scipy.io.savemat(tmp_path / "run7.mat", content)
    same(read_log(tmp_path / "run7.mat"), example())


def test_matlab_v73_gives_the_same_value(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run7.mat", "w", userblock_size=512) as file:

        def put(name: str, value: np.ndarray, kind: str) -> None:
            file[name] = value
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)

        def text(name: str, value: str) -> None:
            put(name, np.array([[ord(letter)] for letter in value], dtype=np.uint16), "char")

        put("engine_speed", np.array([[1800.0, np.nan, 1860.5]]), "double")
        for index, code in enumerate(["N", "H"]):
            text(f"#refs#/{index}", code)
        put("#refs#/2", np.array([0, 0], dtype=np.uint64), "char")
        file["#refs#/2"].attrs["MATLAB_empty"] = np.uint8(1)
        references = [file[f"#refs#/{index}"].ref for index in range(3)]
        put("gear", np.array([references], dtype=h5py.ref_dtype), "cell")
        put("throttle", np.array([[0.0, 0.5, 1.0]]), "double")
        put("time", np.array([[0.0, 0.1, 0.25]]), "double")
        for name, unit in {"time": "s", "engine_speed": "rpm", "gear": "text", "throttle": "1"}.items():
            text(f"units/{name}", unit)
    with (tmp_path / "run7.mat").open("r+b") as stream:  # the header by which MATLAB marks its HDF5 files
        stream.write(b"MATLAB 7.3 MAT-file".ljust(116) + b" " * 8 + b"\x00\x02IM")
    same(read_log(tmp_path / "run7.mat"), example())


def test_mdf_keeps_every_sensor_at_its_own_times(tmp_path: Path) -> None:
    mdf = pytest.importorskip("asammdf", reason="needs the extra 'data'")
    with mdf.MDF(version="4.10") as file:
        file.append([mdf.Signal(np.array([1.0, 2.0]), np.array([0.0, 0.1]), unit="rpm", name="engine_speed")])
        file.append([mdf.Signal(np.array([36.0, 37.0]), np.array([0.05, 0.1]), unit="km/h", name="speed")])
        file.save(tmp_path / "run7.mf4")
    log = read_log(tmp_path / "run7.mf4")
    np.testing.assert_allclose(log.time, [0.0, 0.05, 0.1])
    np.testing.assert_array_equal(log.channel("engine_speed").values, [1.0, np.nan, 2.0])
    np.testing.assert_array_equal(log.channel("speed").values, [np.nan, 36.0, 37.0])


@pytest.mark.parametrize(("suffix", "package", "extra"),
    [
        (".parquet", "pyarrow", "parquet"), (".mf4", "asammdf", "mdf"), (".h5", "h5py", "hdf5"),
        (".xlsx", "openpyxl", "excel"), (".bag", "rosbags", "ros"), (".mcap", "mcap", "mcap"),
    ],
)  # fmt: skip
def test_a_missing_package_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, package: str, extra: str
) -> None:
    def absent(name: str) -> object:
        raise ImportError(name)

    (tmp_path / f"run7{suffix}").write_bytes(b"")
    monkeypatch.setattr(importlib, "import_module", absent)
    (tmp_path / f"{package}.py").write_text("raise ImportError", encoding="utf-8")  # some are read in another process
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(
        DataError, match=rf"needs {package}, which is not installed - run: pip install 'bondloop\[{extra}\]'"
    ):
        read_log(tmp_path / f"run7{suffix}")


def test_time_in_another_unit_becomes_seconds(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv"
    path.write_text("time [ms],v [m/s]\n0,1\n100,2\n")
    np.testing.assert_allclose(read_log(path).time, [0.0, 0.1])


def test_windows_files_with_byte_order_mark_read_the_same(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv"
    path.write_bytes(("﻿" + TEXT.replace("\n", "\r\n")).encode())
    same(read_log(path), example())


BAD = {
    "unit typo": ("time [s],engine_speed [rpn]\n0,1\n", r"has unit 'rpn' \(row 1\); did you mean 'rpm'\?"),
    "no unit": ("time [s],engine_speed\n0,1\n", r"column 'engine_speed' has no unit \(row 1\) - write it as"),
    "nonsense unit": ("time [s],a [qqzz]\n0,1\n", "has unit 'qqzz' .*it is not a unit"),
    "no time": ("v [m/s],t [s]\n0,1\n", r"first column must be 'time \[s\]' but is 'v' .*name the .* with --time"),
    "time not a time": ("time [m],v [m/s]\n0,1\n", "column 'time' has unit 'm' .* but the model needs 's'"),
    "twice": ("time [s],v [m/s],v [km/h]\n0,1,2\n", "column 'v' stands twice"),
    "not a number": ("time [s],v [m/s]\n0,1\n1,fast\n", r"column 'v' has 'fast' \(row 3\), which is not a number"),
    "infinite": ("time [s],v [m/s]\n0,1\n1,inf\n", "column 'v' is infinite in row 3"),
    "time back": (
        "time [s],v [m/s]\n0,1\n1,1\n0.5,1\n0.7,1\n0.6,1\n",
        r"does not increase in rows 4, 6 \(1 s, then 0.5",
    ),
    "time repeated": ("time [s],v [m/s]\n0,1\n0,1\n", "time does not increase in row 3"),
    "time missing": ("time [s],v [m/s]\n0,1\n,1\n", "column 'time' has no value in row 3"),
    "no samples": ("time [s],v [m/s]\n", "run7.csv: the log has no samples"),
    "empty file": ("", "the file is empty"),
    "too many cells": ("time [s],v [m/s]\n0,1\n1,2,3\n", "row 3 has 3 cells under 2 headers - complete or delete"),
    "headers without cells": ("time [s],v [m/s],w [m/s]\n0,1\n1,2\n", "row 2 has 2 cells under 3 headers"),
    "line cut off": ("time [s],v [m/s],w [m/s]\n0,1,2\n1\n", "row 3 has 1 cells under 3 headers"),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_a_broken_file_gets_its_own_message(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "run7.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=message) as caught:
        read_log(path)
    assert caught.value.message.startswith("run7.csv: ")


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16"])
@pytest.mark.parametrize("ending", [".csv", ".csv.gz"])
def test_a_file_of_other_letters_than_utf_8_is_read(tmp_path: Path, ending: str, encoding: str) -> None:
    """Before, a logger's degree sign was refused as no UTF-8."""
    text = "time [s];T [°C];d [µm]\n0;21,5;3\n1;22,5;4\n".encode(encoding)
    path = tmp_path / f"run{ending}"
    path.write_bytes(gzip.compress(text) if ending == ".csv.gz" else text)
    log = read_log(path)
    assert [(one.name, one.unit) for one in log.channels.values()] == [("T", "°C"), ("d", "µm")]
    np.testing.assert_array_equal(log.channel("T").numbers, [21.5, 22.5])


def test_files_that_are_no_logs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        read_log(tmp_path / "absent.csv")
    with pytest.raises(DataError, match=r"this kind of file is not read - give one of \.csv"):
        read_log(tmp_path / "log.docx")
    (tmp_path / "latin.csv").write_bytes(b"time [s],v [m/s]\n0,1\x81\n")  # no letter of Windows-1252 either
    with pytest.raises(DataError, match="not a readable CSV file"):
        read_log(tmp_path / "latin.csv")
    (tmp_path / "a.csv.gz").write_bytes(b"time [s]\n")
    with pytest.raises(DataError, match="not a readable CSV file"):
        read_log(tmp_path / "a.csv.gz")
    (tmp_path / "a.parquet").write_bytes(b"not parquet")
    with pytest.raises(DataError, match="not a readable Parquet file"):
        read_log(tmp_path / "a.parquet")
    with pytest.raises(DataError, match="this kind of file is not written"):
        write_log(tmp_path / "a.xlsx", example())


def test_matlab_file_without_units_is_refused(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"time": [0.0, 1.0], "v": [1.0, 2.0]})
    with pytest.raises(DataError, match="variable 'units' is missing"):
        read_log(tmp_path / "a.mat")
    scipy.io.savemat(tmp_path / "b.mat", {"time": [0.0, 1.0], "v": [1.0, 2.0], "units": {"time": "s"}})
    with pytest.raises(DataError, match="struct 'units' has no field 'v'"):
        read_log(tmp_path / "b.mat")


def test_the_shared_logs_of_the_vehicle_read_cleanly(shared_data: Path) -> None:
    path = shared_data / "ranger_logs" / "coast_down_1.csv"
    log = read_log(path)
    assert log.channel("gear").is_text and set(log.channel("gear").values) == {"N"}
    assert log.channel("engine_speed").unit == "rad/s"
    assert np.diff(log.time) == pytest.approx(0.025)


def test_gzip_of_a_csv_reads_the_same(tmp_path: Path) -> None:
    (tmp_path / "run7.csv.gz").write_bytes(gzip.compress(TEXT.encode()))
    same(read_log(tmp_path / "run7.csv.gz"), example())
