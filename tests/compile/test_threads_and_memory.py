"""What a large process with many threads does to the compiler: no tree breaks, no code lands far from its numbers."""

from __future__ import annotations

import ast
import gc
import inspect
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import bondgraph
from bondgraph.compile.lanes import compiler
from bondgraph.syntax import parsed


class _Garbage:
    """What lets other threads run while the collector takes it."""

    def __init__(self) -> None:
        self.me = self

    def __del__(self) -> None:
        for _ in range(50):
            pass


def test_threads_parse_text_while_garbage_is_collected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python 3.11 raises SystemError within a second here where threads parse side by side."""
    text, interval, threshold = inspect.getsource(compiler), sys.getswitchinterval(), gc.get_threshold()

    def work(_: int) -> int:
        _Garbage()
        return len(parsed(text).body)

    try:
        sys.setswitchinterval(1e-6)
        gc.set_threshold(3)
        with ThreadPoolExecutor(8) as threads:
            found = list(threads.map(work, range(100)))
    finally:
        sys.setswitchinterval(interval)
        gc.set_threshold(*threshold)
    assert set(found) == {len(parsed(text).body)}


def test_all_parsing_goes_through_one_lock() -> None:
    package = Path(bondgraph.__file__).parent
    calls = [
        f"{path.relative_to(package)}:{node.lineno}"
        for path in package.rglob("*.py")
        if path.name != "syntax.py" and "documentation" not in path.parts  # pages are built by no thread
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "ast.parse"
    ]
    assert calls == []


#: Memory in which pieces of a page, two pages and so on are free, each four gigabytes from the next.
_SCATTERED = '''
import ctypes
import numba, numpy as np
from bondgraph.compile.lanes.object_code import load_entry, load_functions

def load(k, lines):
    body = "".join(f"        w[{8*i + 8} + l] = {1.1 + i + k}*w[{8*i} + l] + {0.3 + i}\\n" for i in range(lines))
    text = f"def f{k}(w, n):\\n    for l in range(n):\\n{body}"
    call = load_functions(text, {f"f{k}": "void(float64[::1], int64)"})[f"f{k}"]
    w = np.ones(8*lines + 8)
    numba.njit(lambda call, w: call(w, 8))(call, w)
    return w[8]

load(0, 3)
c, page, far, free = ctypes.CDLL(None), 4096, 4 << 30, 48
c.mmap.restype = ctypes.c_void_p
c.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long]
c.munmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
failed = 2**64 - 1

def reserve(size):
    return c.mmap(None, size, 0, 0x4022, -1, 0)  # no access; private, anonymous, without a reserve

base = reserve(far*(free + 1))
assert base != failed
for power in range(32, 11, -1):  # nothing above it stays free
    while base < (found := reserve(1 << power)) < failed:
        pass
    if found < failed:
        c.munmap(found, 1 << power)
for i in range(free):
    c.munmap(base + far*(free + 1 - i) - page*(i + 1), page*(i + 1))
for k, lines in enumerate([10, 50, 200, 500, 800], 1):
    assert abs(load(k, lines) - (1.1 + k + 0.3)) < 1e-12
kernel = """
declare double @log(double)
define double @entry(double %x) {
  %y = call double @log(double %x)
  %z = fadd double %y, 0x3FD3333333333333
  ret double %z
}
"""
entry = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(load_entry([], [kernel], lambda: kernel))
assert abs(entry(1.0) - 0.3) < 1e-15
print("loaded")
'''


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="maps memory as Linux does")
def test_code_is_loaded_in_one_piece_where_memory_is_scattered(tmp_path: Path) -> None:
    """LLVM ended the process here: numbers lay more than two gigabytes from the code that reads them."""
    run = subprocess.run(
        [sys.executable, "-c", _SCATTERED], env={**os.environ, "BONDGRAPH_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.stdout == "loaded\n", run.stderr
