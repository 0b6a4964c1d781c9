"""The compiled form equals the numpy form, is kept between runs, and has a substitute where numba is missing."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from bondgraph.errors import ModelError, OptionError
from bondgraph.simulate import batch, batch_kernel, cache, compile
from bondgraph.simulate.model import Model
from bondgraph.simulate.scalar import scalar_source
from tests.simulate.samples import NAMES, random_point, sample, text_of


@pytest.mark.parametrize("name", NAMES)
def test_compiled_equals_numpy_at_random_points(name: str) -> None:
    model = sample(name)
    functions = model.compiled
    assert functions.backend == "numba"
    dx, y = np.empty(len(model.states)), np.empty(len(model.outputs))
    rng = np.random.default_rng(11)
    for _ in range(200):
        t = float(rng.uniform(0.0, 2.0))
        x, u, theta = random_point(model, rng)
        functions.rhs_into(t, x, u, theta, dx)
        functions.output_into(t, x, u, theta, y)
        np.testing.assert_allclose(dx, model.rhs(t, x, u, theta), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(y, model.output(t, x, u, theta), rtol=1e-12, atol=1e-12)


def test_a_failed_loop_is_nan_in_both_forms() -> None:
    model = sample("orifices")
    dx = np.empty(1)
    x = np.array([np.nan])
    model.compiled.rhs_into(0.0, x, model.u0(), model.theta(), dx)
    assert np.isnan(dx[0])
    assert np.isnan(model.rhs(0.0, x, model.u0(), model.theta())[0])


def test_division_by_zero_follows_numpy() -> None:
    model = sample("rlc")
    dx = np.empty(2)
    x, u, theta = np.array([1.0, 0.0]), model.u0(), model.theta(C_store=0.0)
    model.compiled.rhs_into(0.0, x, u, theta, dx)
    assert dx[1] == np.inf == model.rhs(0.0, x, u, theta)[1]


def test_a_return_without_rows_is_refused() -> None:
    with pytest.raises(ModelError, match="rhs: must end in 'return _stack"):
        scalar_source(ast.parse("def rhs(t, x, u, theta):\n    return x"))


def test_without_numba_numpy_serves_and_says_so_once(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "numba" else found(name, *rest)
    )
    compile._say_fallback.cache_clear()
    model = sample("driveline")
    with pytest.warns(UserWarning, match="numba is not installed"):
        functions = compile.compile_model(model.text, model.name, model.rhs, model.output)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compile.compile_model(model.text, model.name, model.rhs, model.output)
        assert not compile.has_numba()
    assert functions.backend == "numpy"
    x, u, theta = random_point(model, np.random.default_rng(1))
    dx, y = np.empty(4), np.empty(3)
    functions.rhs_into(0.0, x, u, theta, dx)
    functions.output_into(0.0, x, u, theta, y)
    np.testing.assert_array_equal(dx, model.rhs(0.0, x, u, theta))
    np.testing.assert_array_equal(y, model.output(0.0, x, u, theta))


def test_the_cache_keeps_equal_files_and_replaces_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path / "made"))
    path = cache.store("a.py", "x = 1\n")
    os.utime(path, ns=(1, 1))
    assert cache.store("a.py", "x = 1\n").stat().st_mtime_ns == 1
    path.write_text("damaged", encoding="utf-8")
    assert cache.store("a.py", "x = 1\n").read_text(encoding="utf-8") == "x = 1\n"
    assert [file.name for file in path.parent.iterdir() if file.is_file()] == ["a.py"]


def test_a_cache_folder_that_cannot_be_used_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(blocked / "folder"))
    with pytest.raises(OptionError, match=r"BONDGRAPH_CACHE_DIR=.*cannot be written"):
        cache.cache_folder()


_COUNTED = """
import sys
from pathlib import Path
import numpy
from bondgraph.simulate.model import Model
model = Model.from_text(Path(sys.argv[1]).read_text())
dx = numpy.empty(len(model.states))
model.compiled.rhs_into(0.0, model.x0(), model.u0(), model.theta(), dx)
statistics = model.compiled.rhs_into.stats
print(sum(statistics.cache_hits.values()), sum(statistics.cache_misses.values()))
"""


def test_a_second_process_loads_what_the_first_compiled(tmp_path: Path) -> None:
    module = tmp_path / "rlc.py"
    module.write_text(text_of("rlc"), encoding="utf-8")
    environment = {**os.environ, cache.CACHE_VARIABLE: str(tmp_path / "cache")}

    def hits_and_misses() -> list[bytes]:
        command = [sys.executable, "-c", _COUNTED, str(module)]
        root = Path(__file__).resolve().parents[2]
        return subprocess.run(command, env=environment, cwd=root, capture_output=True, check=True).stdout.split()

    assert hits_and_misses() == [b"0", b"1"]
    assert hits_and_misses() == [b"1", b"0"]


def test_models_that_differ_in_a_number_do_not_share_code() -> None:
    model = sample("pendulum")
    other = Model.from_text(model.text.replace("gravity/length*np.sin(angle)", "2.0*gravity/length*np.sin(angle)"))
    one, two = np.empty(2), np.empty(2)
    arguments = (0.0, model.x0(), model.u0(), model.theta(damping=0.0))
    model.compiled.rhs_into(*arguments, one)
    other.compiled.rhs_into(*arguments, two)
    np.testing.assert_allclose(two[1], 2.0 * one[1], rtol=1e-14)


def test_a_model_loaded_again_shares_its_compiled_functions() -> None:
    model = sample("rlc")
    assert Model.from_text(model.text).compiled.rhs_into is model.compiled.rhs_into


def doubled(numbers: np.ndarray) -> np.ndarray:
    return 2.0 * numbers


def test_functions_in_place_allocate_nothing() -> None:
    numba = pytest.importorskip("numba")
    kept = importlib.import_module("bondgraph.simulate.kept")
    assert numba.njit(**kept._OPTIONS)(doubled)(np.ones(2)).tolist() == [2.0, 2.0]
    with pytest.raises(numba.core.errors.TypingError):
        numba.njit(**kept._IN_PLACE)(doubled)(np.ones(2))


def test_only_kernels_that_make_no_arrays_do_without_the_runtime(monkeypatch: pytest.MonkeyPatch) -> None:
    sources: list[str] = []
    monkeypatch.setattr(compile, "load_compiled", sources.append)
    monkeypatch.setattr(compile, "has_numba", lambda: True)
    compile.load_kernel.__wrapped__(batch_kernel)
    compile.load_kernel.__wrapped__(batch)
    assert "@_jit_in_place" in sources[0]
    assert "@_jit_in_place" not in sources[1]
