"""Identifiers of generated text: declared names where they can stay, escaped names where they cannot.

Names that begin with an underscore belong to the generator (tables, solvers, temporaries); no declared name becomes
one, so a temporary cannot shadow a quantity.
"""

from __future__ import annotations

import keyword
import re
import unicodedata
from collections.abc import Iterable

#: Names that the generated text uses itself.
RESERVED = frozenset(
    {"np", "math", "t", "x", "u", "theta", "dx", "y", "rhs", "output", "range", "len", "enumerate", "out_"}
    | {"NAME", "FORMAT", "STATES", "INPUTS", "PARAMETERS", "OUTPUTS", "SHOWN_UNITS", "ZERO_DEFAULTS", "TOLERANCES"}
)
_ROWS = re.compile(r"(dx|y)\d+\Z")


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """One identifier for each name, no two alike, the name itself wherever it can be one.

    Names that are identifiers are given first, so what another quantity is called never changes them; the others follow
    in their order, with a number where the identifier is taken.

    Parameters
    ----------
    names
        Declared names, in order of declaration.

    Examples
    --------
    >>> identifiers(["motor.k_m", "J", "lambda", "theta"])
    {'motor.k_m': 'motor_k_m', 'J': 'J', 'lambda': 'lambda_', 'theta': 'theta_'}
    >>> identifiers(["motor.k_m", "motor_k_m"])
    {'motor.k_m': 'motor_k_m_2', 'motor_k_m': 'motor_k_m'}
    """
    ordered = list(dict.fromkeys(names))
    given = {name: name for name in ordered if _is_free(name)}
    taken = set(given)
    for name in ordered:
        if name not in given:
            given[name] = unused(_escaped(name), taken)
            taken.add(given[name])
    return {name: given[name] for name in ordered}


def stems(names: Iterable[str], prefix: str, endings: Iterable[str]) -> dict[str, str]:
    """One stem ``<prefix><identifier>`` for each name, such that all stems with all endings are different.

    Examples
    --------
    >>> stems(["torque", "torque_x"], "_table_", ["", "_x"])
    {'torque': '_table_torque', 'torque_x': '_table_torque_x_2'}
    """
    found: dict[str, str] = {}
    taken: set[str] = set()
    variants = tuple(endings)
    for name, identifier in identifiers(names).items():
        count, stem = 1, prefix + identifier
        while any(stem + ending in taken for ending in variants):
            count += 1
            stem = f"{prefix}{identifier}_{count}"
        found[name] = stem
        taken.update(stem + ending for ending in variants)
    return found


def _is_free(name: str) -> bool:
    usable = name.isidentifier() and not name.startswith("_") and unicodedata.normalize("NFKC", name) == name
    return usable and not (keyword.iskeyword(name) or name in RESERVED or _ROWS.match(name))


def _escaped(name: str) -> str:
    letters = (c if f"a{c}".isidentifier() else " " for c in unicodedata.normalize("NFKC", name))
    plain = "_".join("".join(letters).split()).strip("_")
    if not plain.isidentifier():
        plain = f"n_{plain}"
    return plain if _is_free(plain) else f"{plain}_"


def unused(identifier: str, taken: set[str]) -> str:
    """The identifier, with a number behind it where it is taken.

    Examples
    --------
    >>> unused("slip", {"slip", "slip_2"})
    'slip_3'
    """
    count, candidate = 1, identifier
    while candidate in taken:
        count += 1
        candidate = f"{identifier}_{count}"
    return candidate
