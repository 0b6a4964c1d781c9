"""Logs from data frames of pandas, and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bondgraph.data.log import Log, LogChannel
from bondgraph.errors import DataError

pandas = pytest.importorskip("pandas")

TABLE = {"speed [km/h]": [36.0, None, 18.0], "gear [text]": ["H", None, "L"]}


def test_headers_are_those_of_files_and_missing_cells_are_missing() -> None:
    log = Log.from_dataframe(pandas.DataFrame(TABLE, index=[0.0, 0.1, 0.2]), "run7")
    assert (log.name, log.time.tolist()) == ("run7", [0.0, 0.1, 0.2])
    assert log.channel("speed").unit == "km/h"
    assert log.channel("speed").missing.tolist() == [False, True, False] == log.channel("gear").missing.tolist()
    assert log.channel("gear").values.tolist() == ["H", "", "L"]


@pytest.mark.parametrize(
    ("index", "options"),
    [
        (pandas.Index([0.0, 100.0, 200.0], name="time [ms]"), {}),
        (pandas.Index([0.0, 100.0, 200.0]), {"units": {"time": "ms"}}),
        (pandas.Index([0.0, 100.0, 200.0], name="t"), {"units": {"t": "ms"}}),
        (pandas.date_range("2024-05-01 10:00", periods=3, freq="100ms"), {}),
        (pandas.date_range("2024-05-01 10:00", periods=3, freq="100ms", tz="Europe/Berlin"), {}),
        (pandas.timedelta_range("5s", periods=3, freq="100ms"), {}),
    ],
)
def test_an_index_is_the_time(index: object, options: dict[str, object]) -> None:
    log = Log.from_dataframe(pandas.DataFrame(TABLE, index=index), **options)
    np.testing.assert_allclose(log.time, [0.0, 0.1, 0.2], atol=1e-12)


@pytest.mark.parametrize(
    ("column", "values", "options"),
    [
        ("time [ms]", [0.0, 100.0, 200.0], {}),
        ("time", [0.0, 0.1, 0.2], {}),
        ("time", pandas.date_range("2024-05-01", periods=3, freq="100ms"), {}),
        ("time", ["2024-05-01T10:00:00", "2024-05-01T10:00:00.1", "2024-05-01T10:00:00.2"], {}),
        ("clock", [0, 100, 200], {"time": "clock", "units": {"clock": "ms"}}),
        ("t [ms]", [0.0, 100.0, 200.0], {"time": "t"}),
        ("Zeit", ["2024-05-01T10:00:00", "2024-05-01T10:00:00.1", "2024-05-01T10:00:00.2"], {"time": "Zeit"}),
        ("Zeit", pandas.date_range("2024-05-01", periods=3, freq="100ms"), {"time": "Zeit"}),
    ],
)
def test_a_column_is_the_time(column: str, values: object, options: dict[str, object]) -> None:
    log = Log.from_dataframe(pandas.DataFrame({**TABLE, column: values}), **options)
    np.testing.assert_allclose(log.time, [0.0, 0.1, 0.2], atol=1e-12)
    assert list(log.channels) == ["speed", "gear"]


def test_units_may_be_given_beside_the_columns() -> None:
    table = pandas.DataFrame({"speed": pandas.array([36, None], dtype="Int64"), "on": [True, False]}, index=[0.0, 1.0])
    log = Log.from_dataframe(table, units={"speed": "km/h", "on": "1"})
    assert log.channel("speed").missing.tolist() == [False, True]
    assert log.channel("on").numbers.tolist() == [1.0, 0.0]
    codes = Log.from_dataframe(table, units={"speed": "text", "on": "1"}).channel("speed")
    assert codes.values.tolist() == ["36", ""]


@pytest.mark.parametrize(
    ("table", "index", "options", "message"),
    [
        ({"speed": [1.0, 2.0]}, [0.0, 1.0], {}, "column 'speed' has no unit - call it 'speed [unit]' or give units="),
        ({"speed [km/q]": [1.0, 2.0]}, [0.0, 1.0], {}, "column 'speed' has unit 'km/q'"),
        ({"speed [m/s]": [1.0, 2.0]}, None, {}, "no column is called 'time', and the index counts rows"),
        ({"speed [m/s]": [1.0, 2.0]}, None, {"time": "sped"}, "no column 'sped'; did you mean 'speed'"),
        ({"speed [m/s]": [1.0, 2.0]}, [0.0, 1.0], {"units": {"sped": "m"}}, "units names 'sped', which is no column"),
        ({"speed [m/s]": ["a", "b"]}, [0.0, 1.0], {}, "where numbers in m/s are needed"),
        ({"speed [m/s]": [1.0, 2.0], "speed [km/h]": [1.0, 2.0]}, [0.0, 1.0], {}, "column 'speed' stands twice"),
        ({"speed [m/s]": [1.0, 2.0]}, [1.0, 0.0], {}, "time does not increase in row 3"),
        ({"speed [m/s]": [1.0, 2.0]}, ["a", "b"], {}, "neither numbers nor dates"),
        ({"speed [m/s]": []}, pandas.DatetimeIndex([]), {}, "the log has no samples"),
    ],
)
def test_what_cannot_be_a_log_is_told(
    table: dict[str, object], index: object, options: dict[str, object], message: str
) -> None:
    with pytest.raises(DataError) as error:
        Log.from_dataframe(pandas.DataFrame(table, index=index), "run7", **options)  # type: ignore[arg-type]
    assert "run7: " in str(error.value) and message in str(error.value)


@given(
    st.lists(
        st.tuples(st.floats(0.001, 10.0), st.one_of(st.just(float("nan")), st.floats(-1e6, 1e6))),
        min_size=1,
        max_size=20,
    )
)
def test_a_log_comes_back_from_its_data_frame(rows: list[tuple[float, float]]) -> None:
    time = np.cumsum([step for step, _ in rows])
    values = np.array([value for _, value in rows])
    gears = np.array(["H" if np.isfinite(value) else "" for value in values])
    log = Log("run", time, {"v": LogChannel("v", "m/s", values), "gear": LogChannel("gear", "text", gears)})
    again = Log.from_dataframe(log.to_dataframe(), "run")
    np.testing.assert_array_equal(again.time, log.time)
    for name, channel in log.channels.items():
        assert again.channel(name).unit == channel.unit
        np.testing.assert_array_equal(again.channel(name).values, channel.values)
