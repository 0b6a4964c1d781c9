"""Random bond graphs of every element kind, declared through the builder, the same for the same seed."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

from sympy import Expr, Symbol, sin, tanh

from bondgraph.declare.elements import Node
from bondgraph.declare.graph import BondGraph, ElementType, Handle
from bondgraph.declare.quantities import symbol

LINEAR = ("R", "C", "I", "Se", "Sf")


class RandomGraph:
    """Grows a graph: a tree of junctions (some joined through two-ports), extra bonds, elements, signals."""

    def __init__(self, seed: int, *, linear: bool = True, mesh: float = 0.1, sizes: tuple[int, int] = (2, 7)) -> None:
        self.rng = random.Random(seed)
        self.linear = linear
        self.mesh = mesh
        self.graph = BondGraph(f"random_{seed}")
        self.junctions: list[Handle] = []
        self.storages: list[Handle] = []
        self.count = 0
        self.input = self.graph.input("u_0", "")
        self.readings: list[Symbol] = []
        for _ in range(self.rng.randint(*sizes)):
            self._junction()
        for junction in list(self.junctions):
            for _ in range(self.rng.choice((0, 1, 1, 2))):
                self._element(junction)
        for _ in range(len(self.junctions)):
            if len(self.junctions) > 1 and self.rng.random() < mesh:
                a, b = self.rng.sample(self.junctions, 2)
                self._join(a, b)
        for junction in list(self.junctions):
            if not any(junction.name in (bond.source, bond.target) for bond in self.graph.bonds):
                self._element(junction)

    # ------------------------------------------------------------------ names and laws

    def name(self, stem: str) -> str:
        self.count += 1
        return f"{stem}{self.count}"

    def parameter(self) -> Symbol:
        return self.graph.parameter(self.name("p"), round(self.rng.uniform(0.5, 2.0), 3), "")

    def one_of(self, *choices: Callable[[], Expr]) -> Expr:
        return self.rng.choice(choices)()

    def source_law(self) -> Expr:
        a, t = self.parameter(), symbol("t")
        if self.linear:
            return self.one_of(lambda: a, lambda: self.input, lambda: a * self.input)
        return self.one_of(lambda: a * self.input**2, lambda: a * sin(t), lambda: self.input + a, self._of_state)

    def _of_state(self) -> Expr:
        """A bounded expression of a storage, of an integral of a junction's variable, or of a named signal of it."""
        a = self.parameter()
        if self.junctions and self.rng.random() < 0.3:
            return a * sin(self._reading()) / 4
        if not self.storages:
            return a
        storage = self.rng.choice(self.storages)
        variable = storage.displacement if storage.kind == "C" else storage.momentum
        return a * sin(variable)

    def _reading(self) -> Symbol:
        if self.readings and self.rng.random() < 0.5:
            return self.rng.choice(self.readings)
        junction = self.rng.choice(self.junctions)
        variable = junction.effort if junction.kind == "0" else junction.flow
        name = self.name("w")
        if self.rng.random() < 0.7:
            reading = self.graph.integral(name, lambda w: variable - w / 3, "")
        else:
            reading = self.graph.signal(name, variable + self.parameter(), "")
        self.readings.append(reading)
        return reading

    def modulus(self) -> Expr:
        a = self.parameter()
        if self.linear or self.rng.random() < 0.5:
            return a
        return 2 * a + self._of_state() / 3

    def monotone(self, own: Symbol) -> Expr:
        a, b = self.parameter(), self.parameter()
        return self.one_of(
            lambda: a * own,
            lambda: a * own + b * own**3,
            lambda: a * own + b * tanh(own),
            lambda: a * own + self._table()(own),
        )

    def _table(self) -> Callable[[Expr], Expr]:
        rise = [self.rng.uniform(0.2, 1.5) for _ in range(4)]
        return self.graph.table(self.name("T"), [-4.0, -1.0, 0.5, 4.0], [sum(rise[: i + 1]) - 1.5 for i in range(4)])

    # ------------------------------------------------------------------ parts

    def _junction(self) -> None:
        name = self.name("j")
        kind = self.rng.choice("01")
        new = self.graph.zero_junction(name) if kind == "0" else self.graph.one_junction(name)
        if self.junctions:
            self._join(self.rng.choice(self.junctions), new)
        self.junctions.append(new)

    def _join(self, a: Handle, b: Handle) -> None:
        if self.rng.random() < 0.5:
            a, b = b, a
        draw = self.rng.random()
        if draw < 0.6:
            self.graph.bond(a, b)
        elif draw < 0.8:
            self.graph.transformer(self.name("tf"), self.modulus(), a, b)
        else:
            self.graph.gyrator(self.name("gy"), self.modulus(), a, b)

    def _element(self, at: Handle) -> None:
        kind = self.rng.choice(LINEAR) if self.rng.random() < 0.85 else self.rng.choice(("Cn", "In", "Rn", "Xn"))
        if len(kind) == 2 and kind.endswith("n"):
            self._field(kind[0], at)
            return
        name = self.name(kind.lower())
        handle = self.graph.add_node(Node(name, kind, laws=self._laws(kind), initial=(0.0,) if kind in "CI" else ()))
        ends = (handle, at) if (kind in ("Se", "Sf")) != (self.rng.random() < 0.2) else (at, handle)
        self.graph.bond(*ends)
        if kind in "CI":
            self.storages.append(handle)

    def _laws(self, kind: str) -> tuple[tuple[str, Expr], ...]:
        effort, flow = symbol("effort"), symbol("flow")
        if kind == "Se":
            return (("effort", self.source_law()),)
        if kind == "Sf":
            return (("flow", self.source_law()),)
        if kind == "C":
            q = symbol("displacement")
            return (("effort", self.parameter() * q if self.linear else self.monotone(q)),)
        if kind == "I":
            p = symbol("momentum")
            return (("flow", p / self.parameter() if self.linear else self.monotone(p)),)
        if self.linear:
            return (("effort", self.parameter() * flow),)
        law = self.rng.choice(("effort", "flow", "residual", "linear", "linear"))
        if law == "linear":
            a = self.parameter()
            return (("effort", a * flow), ("flow", effort / a))
        if law == "residual":
            return (("residual", self.monotone(effort) - self.monotone(flow)),)
        return ((law, self.monotone(flow if law == "effort" else effort)),)

    def _own_kind(self, at: Sequence[Handle]) -> None:
        """A coupling that may be used with any strokes: e1 = a f1 + c f2, e2 = b f2 - c f1, in all its forms."""
        a, b, c = self.parameter() + 1, self.parameter(), self.parameter()
        whole = a * b + c**2
        forms = {
            ("effort", "effort"): lambda f, g: (a * f + c * g, b * g - c * f),
            ("flow", "flow"): lambda e, d: ((b * e - c * d) / whole, (c * e + a * d) / whole),
            ("flow", "effort"): lambda e, g: ((e - c * g) / a, b * g - c * (e - c * g) / a),
            ("effort", "flow"): lambda f, d: (a * f + c * (d + c * f) / b, (d + c * f) / b),
        }
        self.graph.element(self.name("x"), ElementType(forms), at=at)

    def _field(self, kind: str, at: Handle) -> None:
        other = self.rng.choice(self.junctions)
        ports = [at, other]
        if kind == "X":
            self._own_kind(ports)
            return
        variable = {"C": "displacement", "I": "momentum", "R": "flow"}[kind]
        own = [symbol(f"{variable}{port}") for port in (1, 2)]
        a, b, c = self.parameter() + 1, self.parameter() + 1, self.parameter() / 3
        name = self.name(kind.lower() + "f")
        if kind == "R":
            laws: Sequence[Expr] = (a * own[0] + c * own[1], b * own[1] + c * own[0])
            self.graph.field("R", name, laws, at=ports)
            return
        energy = a * own[0] ** 2 / 2 + b * own[1] ** 2 / 2 + c * own[0] * own[1]
        if not self.linear:
            energy += self.parameter() * (own[0] + own[1]) ** 4 / 20
        self.graph.field(kind, name, energy=energy, at=ports)


def nested(seed: int, *, linear: bool = True) -> BondGraph:
    """A random graph with another one as a part of it, bonded at a junction of each."""
    rng = random.Random(seed)
    outer, inner = RandomGraph(seed, linear=linear, sizes=(2, 4)), RandomGraph(seed + 1, linear=linear, sizes=(1, 3))
    port = rng.choice(inner.junctions)
    outer.graph.include("part", inner.graph, {"port": port.name}, {"u_0": 2 * outer.input})
    middle = rng.choice((outer.graph.zero_junction, outer.graph.one_junction))("between")
    outer.graph.bond(rng.choice(outer.junctions), middle)
    outer.graph.bond(middle, "part.port")
    outer.graph.resistance("bridge", 1.5, at=middle)
    return outer.graph
