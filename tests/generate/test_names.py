"""Identifiers: declared names stay where they can, escaped ones never collide."""

from __future__ import annotations

import keyword

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.generate.names import RESERVED, identifiers, stems
from bondgraph.generate.tables import ENDINGS


@pytest.mark.parametrize(
    ("name", "identifier"),
    [
        ("J_primary", "J_primary"),
        ("ω", "ω"),
        ("motor.k_m", "motor_k_m"),
        ("lambda", "lambda_"),
        ("np", "np_"),
        ("t", "t_"),
        ("x", "x_"),
        ("theta", "theta_"),
        ("dx3", "dx3_"),
        ("y0", "y0_"),
        ("dx", "dx_"),
        ("_error", "error"),
        ("displacement(C1)", "displacement_C1"),
        ("2nd", "n_2nd"),
        ("..", "n_"),
        ("\u00b5", "\u03bc"),  # Python reads the micro sign as the Greek letter
    ],
)
def test_a_name_becomes_an_identifier(name: str, identifier: str) -> None:
    assert identifiers([name]) == {name: identifier}


def test_a_good_name_keeps_itself_whatever_stands_before_it() -> None:
    assert identifiers(["a.b", "a-b", "a_b", "a_b_2"]) == {
        "a.b": "a_b_3",
        "a-b": "a_b_4",
        "a_b": "a_b",
        "a_b_2": "a_b_2",
    }
    assert identifiers(["lambda", "lambda_"]) == {"lambda": "lambda__2", "lambda_": "lambda_"}


@settings(deadline=None)  # a busy machine may pause for a second
@given(st.lists(st.one_of(st.text(min_size=1), st.sampled_from([*sorted(RESERVED), *keyword.kwlist, "a.b", "a_b"]))))
def test_identifiers_are_valid_free_and_different(names: list[str]) -> None:
    given_names = identifiers(names)
    assert list(given_names) == list(dict.fromkeys(names))
    assert len(set(given_names.values())) == len(given_names)
    for identifier in given_names.values():
        assert identifier.isidentifier() and not keyword.iskeyword(identifier)
        assert identifier not in RESERVED and not identifier.startswith("_")


@settings(deadline=None)  # a busy machine may pause for a second
@given(st.lists(st.sampled_from(["a", "a_x", "a_d1", "a_d", "a_x_2", "a_d1_x", "a.x"]), unique=True))
def test_no_two_tables_share_a_name_of_an_array_or_function(names: list[str]) -> None:
    made = stems(names, "_table_", ENDINGS)
    all_names = [stem + ending for stem in made.values() for ending in ENDINGS]
    assert len(set(all_names)) == len(all_names)
