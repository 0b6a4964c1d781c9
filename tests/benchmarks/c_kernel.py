"""The same steps compiled by gcc from the same printed equations, to see what numba leaves on the table.

The printed loops over lanes are simple enough to be read as C line by line. gcc is needed, on the machine of who runs
the benchmark only.
"""

from __future__ import annotations

import ast
import ctypes
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bondgraph.compile.lanes.load import load_lanes
from bondgraph.compile.lanes.text import LANES
from bondgraph.simulate.model import Model

_HEAD = """
#include <math.h>
static inline double _lane_tanh(double x) {
    double y = x < 20.0 ? x : 20.0; y = y > -20.0 ? y : -20.0; y *= 0.0625;
    double s = y*y, a = y*(34459425.0 + s*(4729725.0 + s*(135135.0 + s*(990.0 + s))));
    double b = 34459425.0 + s*(16216200.0 + s*(945945.0 + s*(13860.0 + s*45.0)));
    for (int i = 0; i < 4; i++) { double c = 2*a*b; b = a*a + b*b; a = c; }
    return a/b;
}
"""

_STEPS = """
void rk4(double h, long steps, long size, const double *inputs, double *w, long n) {
    double *x = w + X*L, *stage = w + STAGE*L, *slope = w + SLOPE*L, *total = w + TOTAL*L;
    static const double weight[4] = {1, 2, 2, 1}, reach[4] = {0.5, 0.5, 1, 1};
    for (long k = 0; k < steps; k++) {
        for (long q = 0; q < size; q++) { stage[q] = x[q]; total[q] = 0; }
        for (int s = 0; s < 4; s++) {
            rates(inputs, inputs, w, n);
            for (long q = 0; q < size; q++) {
                total[q] += h*weight[s]/6*slope[q]; stage[q] = x[q] + h*reach[s]*slope[q];
            }
        }
        for (long q = 0; q < size; q++) x[q] += total[q];
    }
}
"""


def has_compiler() -> bool:
    """Whether gcc is there."""
    return shutil.which("gcc") is not None


def c_steps(model: Model) -> Callable[[np.ndarray, float, int, np.ndarray], None]:
    """A function ``(w, h, steps, inputs)`` that takes Runge-Kutta steps of all lanes in a work buffer, inputs held."""
    text = load_lanes(model, stiff=False).text
    tree = ast.parse(text)
    rates = next(node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "rates")
    rows = dict(re.findall(r"^(LANES|N_X|X|STAGE|SLOPE|TOTAL) = (\d+)$", text, flags=re.M))
    defines = "\n".join(f"#define {name} {value}" for name, value in rows.items()) + f"\n#define L {LANES}"
    source = "\n".join([_HEAD, defines, _function(rates), _STEPS])
    folder = Path(tempfile.mkdtemp(prefix="bondgraph-c-"))
    (folder / "k.c").write_text(source)
    command = ["gcc", "-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math",
               "-shared", "-fPIC", "-o", "k.so", "k.c", "-lm"]  # fmt: skip
    subprocess.run(command, cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "k.so"))
    pointer = np.ctypeslib.ndpointer(np.float64, flags="C")
    library.rk4.argtypes = [ctypes.c_double, ctypes.c_long, ctypes.c_long, pointer, pointer, ctypes.c_long]
    size = int(rows["N_X"]) * LANES
    return lambda w, h, steps, inputs: library.rk4(h, steps, size, inputs, w, LANES)


def _function(node: ast.FunctionDef) -> str:
    lines = ["static void rates(const double *clock, const double *inputs, double *restrict w, long n) {"]
    for statement in node.body:
        if isinstance(statement, ast.For):
            lines.append("#pragma GCC ivdep\nfor (long l = 0; l < n; l++) {")
            lines += [_assignment(inner) for inner in statement.body]
            lines.append("}")
        else:
            lines.append(_assignment(statement))
    return "\n".join([*lines, "}"])


def _assignment(statement: ast.stmt) -> str:
    if not isinstance(statement, ast.Assign):
        raise ValueError(f"{ast.unparse(statement)} has no form in C here: choose a model without loops and tables")
    target = ast.unparse(statement.targets[0])
    declared = "" if "[" in target else "double "
    return f"{declared}{target} = {_expression(statement.value)};"


def _expression(node: ast.expr) -> str:
    if isinstance(node, ast.IfExp):
        return f"({_expression(node.test)}) ? {_expression(node.body)} : {_expression(node.orelse)}"
    text = ast.unparse(node)
    return text.replace("abs(", "fabs(").replace("math.sqrt(", "sqrt(").replace("np.", "").replace("nan", "NAN")
