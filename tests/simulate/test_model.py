"""Generated modules as values: names, vectors, batches, and what is refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from bondgraph.errors import ModelError
from bondgraph.simulate.model import Model
from tests.simulate.samples import NAMES, random_point, sample, text_of


def test_a_model_holds_what_its_module_declares() -> None:
    model = sample("driveline")
    assert model.name == "driveline"
    assert model.names("state") == ("omega_engine", "omega_wheel", "q_shaft", "v_body")
    assert model.names("output") == ("engine_speed", "wheel_speed", "acceleration")
    gear = model.inputs[model.index("input", "gear")]
    assert (gear.interpolation, gear.default, dict(gear.letters or {})) == ("hold", 10.0, {"H": 10, "L": 20, "N": 0})
    inertia = model.parameters[0]
    assert (inertia.name, inertia.unit, inertia.value, inertia.lower, inertia.upper) == (
        "J_engine", "kg m^2", 0.02, 0.005, 0.1
    )  # fmt: skip
    assert model.parameters[5].lower is None
    assert model.doc.startswith("Driveline:")


def test_vectors_take_overrides_by_name_and_letters() -> None:
    model = sample("driveline")
    assert model.theta(tau_grip=7.0).tolist()[3] == 7.0
    assert model.theta().tolist()[3] == 40.0
    assert model.x0(v_body=9.0).tolist() == [100.0, 10.0, 0.0, 9.0]
    assert model.u0(gear="L", throttle=1).tolist() == [1.0, 20.0, 0.0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: m.theta(tau_gripp=1.0), "no parameter 'tau_gripp'; did you mean 'tau_grip'"),
        (lambda m: m.x0(v_bdy=1.0), "no state 'v_bdy'; did you mean 'v_body'"),
        (lambda m: m.u0(gear="X"), "input 'gear' has no letter 'X' - it knows H, L, N"),
        (lambda m: m.u0(throttle="H"), "input 'throttle' has no letter 'H' - it knows none"),
        (lambda m: m.index("output", "speed"), "no output 'speed'; did you mean 'wheel_speed'"),
    ],
)
def test_unknown_names_are_told_with_the_closest_known_one(call, message: str) -> None:
    with pytest.raises(ModelError, match="driveline: ") as error:
        call(sample("driveline"))
    assert message in str(error.value)


@pytest.mark.parametrize("name", NAMES)
def test_a_batch_equals_a_loop_of_single_calls(name: str) -> None:
    model = sample(name)
    x, u, theta = random_point(model, np.random.default_rng(3), 4, 3)
    dx, y = model.rhs(0.5, x, u, theta), model.output(0.5, x, u, theta)
    assert dx.shape == x.shape
    for i in range(4):
        for j in range(3):
            one = (x[:, i, j], u[:, i, j], theta[:, i, j])
            np.testing.assert_allclose(dx[:, i, j], model.rhs(0.5, *one), rtol=1e-13, atol=1e-13)
            np.testing.assert_allclose(y[:, i, j], model.output(0.5, *one), rtol=1e-13, atol=1e-13)


def test_parameters_of_one_set_serve_a_whole_batch() -> None:
    model = sample("driveline")
    x, _, _ = random_point(model, np.random.default_rng(4), 6)
    shared = model.rhs(0.0, x, model.u0(), model.theta())
    spread = model.rhs(0.0, x, np.repeat(model.u0()[:, None], 6, 1), np.repeat(model.theta()[:, None], 6, 1))
    np.testing.assert_array_equal(shared, spread)


def test_models_are_equal_by_text_and_survive_pickling() -> None:
    model = sample("rlc")
    again = pickle.loads(pickle.dumps(model))
    assert again == model
    assert again.digest == model.digest
    assert again != sample("driveline")
    np.testing.assert_array_equal(
        again.rhs(0.0, [1.0, 2.0], [3.0], again.theta()), model.rhs(0.0, [1.0, 2.0], [3.0], model.theta())
    )


def test_a_model_is_read_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "rlc.py"
    path.write_text(text_of("rlc"), encoding="utf-8")
    assert Model.from_file(path) == sample("rlc")
    with pytest.raises(ModelError, match=r"absent\.py: cannot be read"):
        Model.from_file(tmp_path / "absent.py")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("dx1 = i_coil/C_store", "dx1 = i_coil/", "is not valid Python"),
        ("import numpy as np", "import os", "'import os') does not belong in a generated module"),
        ("import numpy as np", "import numpy as np\nprint('x')", "does not belong in a generated module"),
        ("import numpy as np", "import numpy as np\nfile = open('x')", "running the module failed: NameError"),
        ('NAME = "rlc"', 'TITLE = "rlc"', "the module has no NAME"),
        ("bondgraph-module/1", "bondgraph-module/9", "is of format 'bondgraph-module/9', this version reads"),
        ("def rhs(t, x, u, theta)", "def rhs(x, u)", "rhs must be a function of (t, x, u, theta), not of (x, u)"),
        ("_stack(x, (dx0, dx1))", "_stack(x, (dx0,))", "rhs gives shape (1,) for a state of shape (2,), not (2,)"),
        ("dx1 = i_coil/C_store", "dx1 = i_coil/missing", "rhs fails at the declared values: NameError"),
        ('"V", 0.0, "linear", None', '"V", 0.0, "cubic", None', "interpolation 'cubic' is neither"),
        ('"ohm", 0.5, 0.01, 10.0', '"ohm", 0.5, 10.0, 0.01', "bounds (10.0, 0.01) are not in order"),
        ('"ohm", 0.5, 0.01, 10.0', '"ohm", 0.5, None, 10.0', "must be two numbers or both None"),
        ('"ohm", 0.5,', '"ohm", np.nan,', "value nan is not a finite number"),
        ('("L_coil", "H", 0.1', '("R_wire", "H", 0.1', "names two parameters"),
        ('("current", "A", "ammeter")', '(" ", "A", "ammeter")', "cannot be the name of the output"),
        ('("current", "A", "ammeter")', '("current", "A")', "a row of OUTPUTS does not have the columns (name, unit"),
    ],
)  # fmt: skip
def test_what_is_no_generated_module_is_refused(old: str, new: str, message: str) -> None:
    text = text_of("rlc")
    assert old in text
    with pytest.raises(ModelError) as error:
        Model.from_text(text.replace(old, new), source="rlc.py")
    assert str(error.value).startswith("rlc.py: ")
    assert message in str(error.value)
    assert "regenerate" in str(error.value)


def test_branches_not_taken_do_not_warn() -> None:
    model = sample("vocabulary")
    y = model.output(0.0, np.array([4.0, 1.0]), model.u0(), model.theta())
    assert y[model.index("output", "neither")] == 0.5
