"""Whole modules: their format, what they compute, and that they stand on their own."""

from __future__ import annotations

import ast
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import sympy
from scipy.optimize import brentq

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.functions import table_function
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.declare.quantities import Input, Parameter, Table, symbol
from bondgraph.derive.equations import Assignment, ImplicitLoop, OutputEquation, State, StateEquations
from bondgraph.errors import GenerationError
from bondgraph.generate.module import render
from bondgraph.generate.pipeline import render_graph
from bondgraph.simulate.model import Model

Load = Callable[[str], SimpleNamespace]
Equations = Callable[..., StateEquations]
a, k = symbol("a"), symbol("k")


@pytest.fixture(scope="module")
def text(machine: StateEquations) -> str:
    return render(machine)


def _function_text(text: str, name: str) -> str:
    return next(part for part in text.split("\n\n\n") if part.startswith(f"def {name}("))


def test_the_head_says_what_it_is_and_how_to_make_it_again(text: str, machine: StateEquations) -> None:
    lines = text.splitlines()
    assert lines[0] == "# Generated from vehicle_graphs/machine.py -- do not edit."
    assert lines[1] == "# Regenerate with:  bondgraph generate machine"
    assert re.fullmatch(r"# Generator: bondgraph [\w.]+, sympy [\d.]+\.  Equations: [0-9a-f]{16}", lines[2]), lines[2]
    assert lines[3] == '"""Belt drive: torque table, slipping belt, drag.'
    assert "      1  v      [m/s]  speed of the vehicle" in lines
    assert render(machine, "bondgraph generate --all").splitlines()[1] == "# Regenerate with:  bondgraph generate --all"
    assert render(machine, "bondgraph generate --all").splitlines()[2:] == lines[2:]


def test_the_tables_hold_every_declared_quantity_in_order(text: str, load: Load) -> None:
    module = load(text)
    assert (module.NAME, module.FORMAT) == ("machine", "bondgraph-module/1")
    assert module.STATES == (
        ("omega", "rad/s", 100.0, "speed of the engine"),
        ("v", "m/s", 0.0, "speed of the vehicle"),
    )
    assert module.INPUTS == (
        ("tau_in", "N m", 0.0, "linear", None, "torque of a starter"),
        ("gear", "1", 10.0, "hold", {"H": 10.0, "L": 22.0}, "ratio"),
    )
    assert module.PARAMETERS[:2] == (
        ("m", "kg", 260.0, None, None, "vehicle with driver"),
        ("J", "kg m^2", 0.02, 0.01, 0.05, "engine"),
    )
    assert [row[0] for row in module.PARAMETERS] == ["m", "J", "r", "grip", "lambda"]
    assert module.OUTPUTS == (
        ("engine_speed", "rad/s", "at the crankshaft"),
        ("slip_speed", "m/s", "as the gauge shows it"),
    )


def test_functions_hold_what_they_need_and_nothing_else(text: str) -> None:
    assert _function_text(text, "rhs").splitlines() == [
        "def rhs(t, x, u, theta):",
        '    """dx/dt, shape (n_x, *batch)."""',
        "    omega = x[0]",
        "    v = x[1]",
        "    tau_in = u[0]",
        "    m = theta[0]",
        "    J = theta[1]",
        "    r = theta[2]",
        "    grip = theta[3]",
        "    lambda_ = theta[4]",
        "    F_drag = lambda_*v*np.abs(v)  # [N] effort of aero",
        "    F_belt = _solve_belt(0.0, r, grip, omega, v)  # force the belt carries",
        "    dx0 = (tau_in + _table_torque(omega) - _table_losses(v, omega) - r*F_belt)/J  # d(omega)/dt",
        "    dx1 = (F_belt - F_drag)/m  # d(v)/dt",
        "    return _stack(x, (dx0, dx1))",
    ]
    assert _function_text(text, "output").splitlines()[-5:] == [
        "    F_belt = _solve_belt(0.0, r, grip, omega, v)  # force the belt carries",
        "    slip = r*omega - v - (1/4000)*F_belt  # [m/s] speed lost in the belt",
        "    y0 = omega  # engine_speed [rad/s]",
        "    y1 = gear*slip  # slip_speed [m/s]",
        "    return _stack(x, (y0, y1))",
    ]
    assert "unused" not in text and "spare" not in text and "lambda_" not in _function_text(text, "output")


def test_every_name_of_the_text_is_a_quantity_or_begins_with_an_underscore(text: str) -> None:
    named = {node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}
    top = {node.name for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)}
    assert {name for name in top if not name.startswith("_")} == {"rhs", "output"}
    assert {"omega", "F_belt", "np"} <= named
    imports = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert [ast.unparse(node) for node in imports] == ["import numpy as np"]


def test_the_equations_come_out(text: str, load: Load) -> None:
    module = load(text)
    x, u, theta = np.array([120.0, 11.9]), np.array([1.5, 22.0]), np.array([250.0, 0.03, 0.1, 700.0, 0.5])
    force = brentq(lambda f: f - 700.0 * math.tanh((12.0 - 11.9 - f / 4000) / 0.05), -1e3, 1e3, xtol=1e-13)
    torque = module._table_torque(120.0) - module._table_losses(11.9, 120.0)
    expected = [(1.5 + torque - 0.1 * force) / 0.03, (force - 0.5 * 11.9**2) / 250.0]
    np.testing.assert_allclose(module.rhs(0.0, x, u, theta), expected, rtol=1e-12)
    np.testing.assert_allclose(module.output(0.0, x, u, theta), [120.0, 22.0 * (0.1 - force / 4000)], rtol=1e-10)


@pytest.mark.parametrize("batch", [(), (7,), (3, 4)])
def test_a_batch_is_a_loop_of_single_calls(text: str, load: Load, batch: tuple[int, ...]) -> None:
    module, rng = load(text), np.random.default_rng(13)
    x = rng.uniform([40.0, 0.0], [400.0, 20.0], (*batch, 2)).T if batch else np.array([200.0, 3.0])
    theta = np.array([260.0, 0.02, 0.1, 900.0, 0.4])
    x = np.ascontiguousarray(x.reshape(2, *batch))
    many = theta.reshape(5, *(1,) * len(batch)) * rng.uniform(0.8, 1.2, (5, *batch))
    u = np.array([1.0, 10.0])
    for function, rows in ((module.rhs, 2), (module.output, 2)):
        shared, own = function(0.0, x, u, theta), function(0.0, x, u, many)
        assert shared.shape == own.shape == (rows, *batch)
        for index in np.ndindex(*batch):
            here = (slice(None), *index)
            np.testing.assert_allclose(shared[here], function(0.0, x[here], u, theta), rtol=1e-14)
            np.testing.assert_allclose(own[here], function(0.0, x[here], u, many[here]), rtol=1e-14)


def test_it_loads_as_a_model_and_compiles_to_the_same_numbers(text: str) -> None:
    model = Model.from_text(text)
    assert model.names("state") == ("omega", "v")
    compiled, rng = model.compiled, np.random.default_rng(14)
    dx, y = np.empty(2), np.empty(2)
    for x in rng.uniform([-50.0, -5.0], [500.0, 40.0], (20, 2)):
        compiled.rhs_into(0.0, x, model.u0(), model.theta(), dx)
        compiled.output_into(0.0, x, model.u0(), model.theta(), y)
        np.testing.assert_allclose(dx, model.rhs(0.0, x, model.u0(), model.theta()), rtol=1e-11)
        np.testing.assert_allclose(y, model.output(0.0, x, model.u0(), model.theta()), rtol=1e-9, atol=1e-12)


def test_systems_of_loops_and_all_slopes_compile(equations: Equations) -> None:
    p, q = symbol("p"), symbol("q")
    curve, surface = table_function("curve"), table_function("map", 2)
    loop = ImplicitLoop(
        name="pair",
        unknowns=(p, q),
        guesses=(sympy.S.Zero, a),
        residuals=(
            p + curve(q) - k,
            5 * q - surface(p, a) - sympy.tanh(p) + sympy.Piecewise((q, q > 0), (2 * q, True)),
        ),
        units=("1", "1"),
        body=(),
        meaning="",
    )
    slopes = curve(a).diff(a, 2) + surface(a, k).diff(a) + surface(a, k).diff(a, k) + surface(a, k).diff(k, 2)
    made = equations(
        tables=(
            Table("curve", (0.0, 1.0, 2.0, 5.0), (0.0, 1.0, 1.5, 4.0)),
            Table("map", (0.0, 1.0, 3.0), ((0.0, 1.0), (2.0, 5.0), (4.0, 11.0)), (0.0, 4.0)),
        ),
        assignments=(loop,),
        derivatives=(p + q * slopes,),
        outputs=(OutputEquation(symbol("p_out"), p, "", ""), OutputEquation(symbol("q_out"), q, "", "")),
    )
    text = render(made)
    model = Model.from_text(text)
    dx, y = np.empty(1), np.empty(2)
    for value in np.linspace(-1, 4, 11):
        x = np.array([value])
        model.compiled.rhs_into(0.0, x, model.u0(), model.theta(), dx)
        model.compiled.output_into(0.0, x, model.u0(), model.theta(), y)
        np.testing.assert_allclose(dx, model.rhs(0.0, x, model.u0(), model.theta()), rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(y, model.output(0.0, x, model.u0(), model.theta()), rtol=1e-10, atol=1e-12)
        assert np.all(np.isfinite(y))


_ALONE = """
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("bondgraph", "sympy", "scipy", "networkx", "numba"):
            raise ImportError(f"{name} is not needed to run a generated module")

sys.meta_path.insert(0, Refuse())
namespace = {}
exec(compile(open(sys.argv[1], encoding="utf-8").read(), "machine.py", "exec"), namespace)
import numpy as np
x = np.array([row[2] for row in namespace["STATES"]])
u = np.array([row[2] for row in namespace["INPUTS"]])
theta = np.array([row[2] for row in namespace["PARAMETERS"]])
print(*(float(value) for value in namespace["rhs"](0.0, x, u, theta)))
"""


def test_it_runs_in_a_fresh_interpreter_with_numpy_alone(text: str, load: Load, tmp_path: Path) -> None:
    (tmp_path / "machine.py").write_text(text, encoding="utf-8")
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", _ALONE, str(tmp_path / "machine.py")],
        check=True,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    module = load(text)
    u, theta = (np.array([row[2] for row in rows]) for rows in (module.INPUTS, module.PARAMETERS))
    expected = module.rhs(0.0, np.array([100.0, 0.0]), u, theta)
    assert [float(value) for value in run.stdout.split()] == expected.tolist()


@pytest.mark.slow
def test_the_text_is_the_same_under_every_hash_seed(text: str) -> None:
    script = (
        "import sys; from bondgraph.generate.module import render; from tests.generate.conftest import belt_drive;"
        "sys.stdout.buffer.write(render(belt_drive()).encode())"
    )
    for seed in range(4):
        run = subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
            cwd=Path(__file__).parents[2],
            check=True,
            capture_output=True,
        )
        assert run.stdout.decode() == text


def test_the_digest_is_that_of_the_equations(machine: StateEquations, text: str, equations: Equations) -> None:
    def digest(text: str) -> str:
        return text.splitlines()[2].rpartition(" ")[2]

    other_place = StateEquations(**{**vars(machine), "source": "elsewhere.json"})
    other_law = StateEquations(**{**vars(machine), "derivatives": machine.derivatives[::-1]})
    assert digest(render(other_place)) == digest(text) != digest(render(other_law))


def test_names_that_clash_are_escaped_and_still_mean_what_they_did(equations: Equations, load: Load) -> None:
    names = ["x", "u", "theta", "np", "lambda", "dx0", "_stack", "range", "motor.k", "motor_k", "y0", "a_"]
    values = [float(2 + i) for i in range(len(names))]
    total = sum((i + 1) * symbol(name) for i, name in enumerate(names))
    made = equations(
        parameters=tuple(Parameter(name, value, "1") for name, value in zip(names, values, strict=True)),
        assignments=(
            Assignment(symbol("rhs"), total, "1", ""),
            Assignment(symbol("t_"), symbol("rhs") + symbol("t"), "", ""),
        ),
        derivatives=(symbol("t_") * a,),
        outputs=(OutputEquation(symbol("x"), symbol("rhs"), "1", ""),),
    )
    module = load(render(made))
    expected = sum((i + 1) * value for i, value in enumerate(values))
    assert module.rhs(1.0, np.array([2.0]), np.array([]), np.array(values)).tolist() == [2 * (expected + 1)]
    assert module.output(1.0, np.array([2.0]), np.array([]), np.array(values)).tolist() == [expected]
    assert [row[0] for row in module.PARAMETERS] == names


def test_a_parameter_called_t_takes_the_place_of_time(equations: Equations, load: Load) -> None:
    made = equations(parameters=(Parameter("t", 3.0, "s"),), derivatives=(symbol("t") * a,))
    assert load(render(made)).rhs(100.0, np.array([2.0]), np.array([]), np.array([3.0])).tolist() == [6.0]


def test_constant_rows_and_no_rows_have_the_shape_of_the_batch(equations: Equations, load: Load) -> None:
    module = load(render(equations(derivatives=(sympy.Integer(1),))))
    assert module.rhs(0.0, np.zeros((1, 3, 2)), np.array([]), np.array([2.0])).tolist() == [[[1.0] * 2] * 3]
    assert module.output(0.0, np.zeros((1, 3)), np.array([]), np.array([2.0])).shape == (0, 3)


def test_text_of_the_declaration_cannot_break_the_module(equations: Equations, load: Load) -> None:
    wild = 'three """ quotes\nand \\ a new line, "quoted" \'twice\' at 45° #'
    made = equations(
        doc=wild,
        source="a\nb.py",
        inputs=(Input("s", "1", wild, letters=(('"', 1.0), ("\\", 2.0))),),
        parameters=(Parameter("k", 2.0, "1", wild, (-math.inf, math.inf)),),
        assignments=(Assignment(symbol("b"), k * a, "1", wild),),
        derivatives=(symbol("b"),),
    )
    module = load(render(made))
    assert list(module.PARAMETERS) == [("k", "1", 2.0, -math.inf, math.inf, wild)]
    assert module.INPUTS[0][4] == {'"': 1.0, "\\": 2.0}


def test_a_chain_of_two_hundred_states_is_rendered_quickly() -> None:
    n = 100
    v, q, f = ([symbol(f"{letter}{i}") for i in range(n)] for letter in ("v", "q", "f"))
    assignments: list[Assignment] = []
    for i in range(n):
        slip = symbol(f"slip{i}")
        assignments.append(Assignment(slip, (v[i - 1] if i else 0) - v[i], "m/s", "relative speed"))
        spring = symbol(f"k{i}") * q[i] + symbol(f"c{i}") * slip + symbol(f"k{i}") * q[i] ** 3 / 3
        assignments.append(Assignment(f[i], spring, "N", "force"))
    masses = [(f[i] - (f[i + 1] if i + 1 < n else 0)) / symbol(f"m{i}") for i in range(n)]
    chain = StateEquations(
        name="chain",
        doc="A chain.",
        source="chain.py",
        states=tuple(State(s, "", 0.0, "", "", "flow") for pair in zip(v, q, strict=True) for s in pair),
        inputs=(),
        parameters=tuple(Parameter(f"{letter}{i}", 1.0, "") for i in range(n) for letter in "mkc"),
        tables=(),
        assignments=tuple(assignments),
        derivatives=tuple(d for pair in zip(masses, (s.symbol for s in assignments[::2]), strict=True) for d in pair),
        outputs=(),
    )
    render(chain)  # sympy's caches
    start = time.process_time()
    text = render(chain)
    assert time.process_time() - start < 0.3
    assert "    f99 = k99*q99 + (1/3)*k99*q99**3 + c99*slip99  # [N] force" in text.splitlines()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"parameters": (Parameter("a", 1.0, "1"),)}, "small: 'a' is declared or computed twice"),
        ({"assignments": (Assignment(k, a, "", ""),)}, "small: 'k' is declared or computed twice"),
        (
            {"derivatives": (symbol("kk") * a,)},
            r"small: 'kk' is used but neither declared nor computed before; did you",
        ),
        (
            {"assignments": (Assignment(symbol("b"), symbol("c"), "", ""), Assignment(symbol("c"), a, "", ""))},
            "small: 'c' is used but neither declared nor computed before",
        ),
        ({"derivatives": ()}, "small: 1 states but 0 derivatives"),
        ({"parameters": (Parameter("k", math.nan, "1"),)}, "value of k is nan"),
        ({"derivatives": (table_function("f")(a),)}, "small: table 'f' is used but not declared"),
    ],
)
def test_equations_that_are_none_are_refused(equations: Equations, changes: dict[str, object], message: str) -> None:
    with pytest.raises(GenerationError, match=message):
        render(equations(**changes))


def test_two_loops_of_one_name_are_refused(equations: Equations) -> None:
    def loop(unknown: str) -> ImplicitLoop:
        s = symbol(unknown)
        return ImplicitLoop("l", (s,), (sympy.S.Zero,), (s**3 + s - a,), ("",), (), "")

    with pytest.raises(GenerationError, match="small: two loops are called 'l'"):
        render(equations(assignments=(loop("b"), loop("c"))))


def test_a_module_says_how_well_a_parameter_is_known() -> None:
    g = BondGraph("cart")
    body = g.one_junction("body", TRANSLATION)
    g.inertance("mass", g.parameter("m", 2.0, "kg", tolerance=0.04), at=body)
    weight = g.parameter("m_load", 1.0, "kg") * g.parameter("gravity", 9.81, "m/s^2", tolerance=0.0)
    g.effort_source("weight", -weight, at=body)
    assert graph_from_json(graph_to_json(g)) == g
    text = render_graph(g).text
    known = {one.name: one.tolerance for one in Model.from_text(text).parameters}
    assert known == {"m": 0.04, "m_load": None, "gravity": 0.0}


def test_a_module_says_which_defaults_of_zero_are_declared() -> None:
    g = BondGraph("cart")
    body = g.one_junction("body", TRANSLATION)
    push, wind = g.input("push", "N"), g.input("wind", "N", default=0.0)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    g.effort_source("forces", push + wind, at=body)
    text = render_graph(g).text
    assert 'ZERO_DEFAULTS = ("wind",)' in text
    assert [one.has_default for one in Model.from_text(text).inputs] == [False, True]
    older = "\n".join(line for line in text.splitlines() if not line.startswith("ZERO_DEFAULTS"))
    assert [one.has_default for one in Model.from_text(older).inputs] == [False, False]
