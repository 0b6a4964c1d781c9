"""Tables of states: kinds of files, and digits that a deviation leaves without meaning."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bondgraph.cli import main
from bondgraph.data.read import read_log
from bondgraph.errors import DataError
from bondgraph.report import states_table
from bondgraph.report.filtering import filter_logs
from bondgraph.report.states_table import StatesTable, rounded_to
from bondgraph.simulate.example import pendulum
from tests.report.test_long_logs import swing


def test_values_lose_no_more_than_a_thousandth_of_their_deviation() -> None:
    chance = np.random.default_rng(1)
    std = 10.0 ** chance.uniform(-12.0, 9.0, 5000)
    values = 10.0 ** chance.uniform(-3.0, 8.0, 5000) * std * chance.choice([-1.0, 1.0], 5000)
    found = rounded_to(values, std)
    assert np.all(np.abs(found - values) <= 0.5e-3 * std * (1.0 + 1e-9))
    # a mean that is m times its deviation has the digits of m and four more
    digits = [len(f"{v:.17g}".split("e")[0].strip("-0.").replace(".", "")) for v in values]
    short = [len(repr(float(v)).split("e")[0].replace("-", "").replace(".", "").strip("0")) for v in found]
    size = np.log10(np.abs(values) / std)
    assert np.mean(digits) > 15.5 and np.all(np.asarray(short) <= np.ceil(size) + 5.0)


def test_values_without_a_deviation_stay_as_they_are() -> None:
    values = np.array([1.0 / 3.0, 2.0 / 3.0, np.nan, 1.0 / 7.0, 1e30 / 3.0, 1e-30 / 3.0])
    std = np.array([0.0, np.nan, 1.0, np.inf, 1e10, 1e-33])
    np.testing.assert_array_equal(rounded_to(values, std), values)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("form", ["csv", "csv.gz", "parquet"])
def test_states_are_written_as_asked_for(tmp_path: Path, form: str) -> None:
    log, tables = swing(2000), {}
    for rounded in (False, True):
        folder = tmp_path / f"{form}{rounded}"
        filter_logs(pendulum(), ("rate",), [log], folder, table=StatesTable(form, rounded))
        path = folder / f"swing_states.{form}"
        tables[rounded] = read_log(path), path.stat().st_size
    (whole, size), (short, smaller) = tables[False], tables[True]
    assert list(whole.channels) == list(short.channels) and smaller < 0.75 * size
    np.testing.assert_array_equal(whole.time, short.time)
    for name in ("angle", "rate"):
        std = whole.channel(f"{name}_std").values
        assert np.all(np.abs(whole.channel(name).values - short.channel(name).values) <= 0.501e-3 * std)
        np.testing.assert_allclose(short.channel(f"{name}_std").values, std, rtol=0.51e-3)


@pytest.mark.usefixtures("undrawn")
def test_a_large_table_says_how_it_becomes_smaller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(states_table, "_LARGE", 1000)
    said = filter_logs(pendulum(), ("rate",), [swing()], tmp_path).text
    assert "swing_states.csv has 0 MB: --states csv.gz --rounded makes it smaller" in said
    said = filter_logs(pendulum(), ("rate",), [swing()], tmp_path, table=StatesTable("csv.gz", True)).text
    assert "makes it smaller" not in said


def test_a_kind_of_file_without_its_package_is_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def extra(*_: object) -> None:
        raise DataError("states.parquet: needs a package")

    monkeypatch.setattr(states_table, "extra", extra)
    command = ["filter", "nothing.py", "--data", "nothing.csv", "--out", str(tmp_path / "out")]
    assert main([*command, "--states", "parquet"]) == 2
    assert "needs a package" in capsys.readouterr().err and not (tmp_path / "out").exists()
