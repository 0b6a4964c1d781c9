"""Graphs that no tool should answer: why each is impossible, the type of the refusal, and words it must contain."""

from __future__ import annotations

from typing import Any

from tests.derive.textbook.case import graph_file

VALUES = "b=2 m=1 k=3"
LOAD = "\nR R effort: b*flow"

_GRAPHS: dict[str, tuple[str, str, str, str, dict[str, Any]]] = {
    # name: type, words ("|" between them), nodes, bonds, the rest of the file
    "two sources of effort in parallel": (
        "CausalityError", "bond b -> z|source b|a -> z already imposes the effort|remove one of a, b",
        "a Se effort: 1\nb Se effort: 2\nz 0" + LOAD, "a>z b>z z>R", {},
    ),
    "two sources of flow in series": (
        "CausalityError", "bond b -> z|flow of 1-junction z|remove one of a, b",
        "a Sf flow: 1\nb Sf flow: 2\nz 1" + LOAD, "a>z b>z z>R", {},
    ),
    "two sources of flow in parallel and nothing else": (
        "CausalityError", "only this bond is left to impose the effort of 0-junction z|remove one of a, b",
        "a Sf flow: 1\nz 0\nb Sf flow: 2", "a>z b>z", {},
    ),
    "two sources of effort through a transformer": (
        "CausalityError", "carried through the transformer t|source a imposes the effort|remove one of a, b",
        "a Se effort: 1\nz 0\nt TF modulus: 2\ny 0\nb Se effort: 2" + LOAD, "a>z z>t t>y y>R b>y", {},
    ),
    "a law of one form on a capacitor": (
        "CausalityError", "law of R gives an effort|c already imposes the effort of 0-junction z|law as flow(effort)",
        "c C effort: k*displacement\nz 0\nR R effort: b*flow**3", "z>c z>R", {},
    ),
    "a law of two branches between two pressures": (
        "CausalityError", "law of R gives the effort|remove one of c, d",
        "c Se effort: k\nj 1\nR R effort: b*flow**2\nd Se effort: 1", "c>j j>R j>d", {},
    ),
    "a ring of junctions": (
        "CausalityError", "bond c -> a closes a ring of 0-junctions",
        "a 0\nb 0\nc 0\nC C effort: k*displacement", "a>b b>c c>a a>C", {},
    ),
    "positive feedback of gain one": (
        "DerivationError", "gain is exactly one|e_z",
        "u Se effort: 1 + effort(z)\nz 0\nR R flow: effort/b", "u>z z>R", {},
    ),
    "a mass driven with its own speed": (
        "DerivationError", "gain is exactly one|m", "s Sf flow: flow(m)\nj 1\nm I flow: momentum/m", "s>j j>m", {},
    ),
    "signals that define each other": (
        "DerivationError", "signal s1, signal s2", "u Se effort: s1\nR R flow: effort/b", "u>R",
        {"signals": [{"name": "s1", "is": "s2 + 1"}, {"name": "s2", "is": "s1 + 1"}]},
    ),
    "a residual that says nothing about the flow": (
        "DerivationError", "R|u -> R", "u Se effort: 1\nR R residual: effort - b", "u>R", {},
    ),
    "an ideal amplifier without feedback": (
        "DerivationError", "nullor",
        "u Se effort: 1\nnullor R ports: 2; residuals: [\"effort1\", \"flow1\"]\nz 0" + LOAD,
        "u>nullor z>nullor z>R", {},
    ),
    "two forms of a law that contradict each other": (
        "DeclarationError", "two laws contradict each other|correct one of them",
        "u Se effort: 1\nR R effort: b*flow; flow: effort/(2*b)", "u>R", {},
    ),
    "a junction without bonds": (
        "DeclarationError", "z: 0-junction without bonds", "c Se effort: k\nj 1\nz 0" + LOAD, "c>j j>R", {},
    ),
    "a storage without a bond": (
        "DeclarationError", "the I storage has 1 port(s) but 0 bond(s)",
        "c Se effort: k\nj 1\nm I flow: momentum/m" + LOAD, "c>j j>R", {},
    ),
    "an element with two bonds": (
        "DeclarationError", "the R element has 1 port(s) but 2 bond(s)",
        "c Se effort: k\nj 1\nm I flow: momentum/m\ny 1" + LOAD, "c>j j>R y>R y>m", {},
    ),
    "a transformer with an open side": (
        "DeclarationError", "one incoming and one outgoing bond, this one has 1 in and 0 out",
        "c Se effort: k\nj 1\nt TF modulus: 2" + LOAD, "c>j j>R j>t", {},
    ),
    "a transformer with both bonds inward": (
        "DeclarationError", "2 in and 0 out",
        "c Se effort: k\nj 1\nt TF modulus: 2\nm I flow: momentum/m\ny 1" + LOAD, "c>j j>R j>t y>t y>m", {},
    ),
    "a storage without a law": (
        "DeclarationError", "a C needs a law", "c C\nj 1" + LOAD, "j>c j>R", {},
    ),
    "a law in the variable of another element": (
        "DeclarationError", "'flow' is not declared", "c C effort: k*flow\nj 1" + LOAD, "j>c j>R", {},
    ),
    "a parameter that is not declared": (
        "DeclarationError", "'kk' is not declared|did you mean 'k'",
        "c C effort: kk*displacement\nj 1" + LOAD, "j>c j>R", {},
    ),
    "two domains without a transducer": (
        "DeclarationError", "joins electrical and rotation|transformer or gyrator",
        "c Se effort: k\nj 1 domain: electrical\nz 0 domain: rotation" + LOAD, "c>j j>z z>R", {},
    ),
    "a wrong unit": (
        "DimensionError", "R: effort must be kg m s^-2",
        "u Se effort: F\nj 1 domain: translation\nm I flow: momentum/m" + LOAD, "u>j j>m j>R",
        {
            "inputs": [{"name": "F", "unit": "N"}],
            "parameters": [{"name": "m", "value": 1, "unit": "kg"}, {"name": "b", "value": 1, "unit": "N/m"}],
        },
    ),
    "the effort of a junction of common flow as an output": (
        "DeclarationError", "differ in effort|read the effort of one element",
        "u Se effort: 1\nj 1" + LOAD, "u>j j>R", {"outputs": [{"name": "y", "variable": "effort", "at": "j"}]},
    ),
    "a program in the place of a law": (
        "DeclarationError", "only names may have dots",
        "u Se effort: __import__('os').system('true')" + LOAD, "u>R", {},
    ),
}  # fmt: skip


def files() -> dict[str, tuple[str, list[str], dict[str, Any]]]:
    """Name of each: type of the refusal, words, graph file."""
    found = {}
    for name, (kind, words, nodes, bonds, head) in _GRAPHS.items():
        parameters = "" if "parameters" in head else VALUES
        found[name] = (kind, words.split("|"), graph_file("g", nodes, bonds, parameters, head=head))
    return found
