"""The same chain of masses, springs and dampers derived by other tools, each in an environment of its own.

A peer is installed by pip into a virtual environment in a temporary folder, since one of them has the import name of
this package, and each run is a process of its own with a limit of time. Its clock starts after its imports and stops
when it has state equations. pyBondGraph needs Python 3.13 and is left out below that.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

INSTALL_LIMIT, RUN_LIMIT = 300.0, 120.0


@dataclass(frozen=True)
class Peer:
    """A tool: what pip installs, and a program that prints the seconds it took for ``sys.argv[1]`` stages."""

    package: str
    program: str


PEERS = {
    "BondGraphTools": Peer(
        "BondGraphTools",
        """
import sys, time
import BondGraphTools as bgt
n = int(sys.argv[1]); start = time.perf_counter()
model = bgt.new(name="chain"); before = None
for i in range(n):
    body, joint, stretch = bgt.new("1", name=f"b{i}"), bgt.new("0", name=f"j{i}"), bgt.new("1", name=f"s{i}")
    mass, spring = bgt.new("I", name=f"m{i}", value=1.0 + i), bgt.new("C", name=f"k{i}", value=0.01)
    damper = bgt.new("R", name=f"d{i}", value=1.0)
    bgt.add(model, body, joint, stretch, mass, spring, damper)
    bgt.connect(body, mass); bgt.connect(joint, stretch); bgt.connect(stretch, spring); bgt.connect(stretch, damper)
    if before is None:
        bgt.connect(body, joint)
    else:
        bgt.connect(before, joint); bgt.connect(joint, body)
    before = body
model.constitutive_relations
print(time.perf_counter() - start)
""",
    ),
    "bondgraph (PyPI)": Peer(
        "bondgraph",
        """
import sys, time
from sympy import Symbol
from bondgraph.core import Bond, BondGraph
from bondgraph.elements import Element_C, Element_I, Element_R, Source_effort
from bondgraph.junctions import JunctionEqualEffort, JunctionEqualFlow
n = int(sys.argv[1]); start = time.perf_counter()
graph = BondGraph(); before = None
for i in range(n):
    body, joint, stretch = JunctionEqualFlow(f"b{i}"), JunctionEqualEffort(f"j{i}"), JunctionEqualFlow(f"s{i}")
    graph.add(Bond(body, Element_I(f"m{i}", Symbol(f"m{i}"), Symbol(f"p{i}"))))
    graph.add(Bond(joint, stretch))
    graph.add(Bond(stretch, Element_C(f"k{i}", Symbol(f"k{i}"), Symbol(f"q{i}"))))
    graph.add(Bond(stretch, Element_R(f"d{i}", Symbol(f"d{i}"))))
    if before is None:
        graph.add(Bond(body, joint))
    else:
        graph.add(Bond(before, joint)); graph.add(Bond(joint, body))
    before = body
graph.add(Bond(Source_effort("push", Symbol("F")), before))
graph.get_state_equations()
print(time.perf_counter() - start)
""",
    ),
    "sympy Kane": Peer(
        "sympy",
        """
import sys, time
from sympy import symbols
from sympy.physics.mechanics import KanesMethod, Particle, Point, ReferenceFrame, dynamicsymbols
n = int(sys.argv[1]); start = time.perf_counter()
frame = ReferenceFrame("N"); origin = Point("O"); origin.set_vel(frame, 0)
q, u = dynamicsymbols(f"q:{n}"), dynamicsymbols(f"u:{n}")
m, k, d = symbols(f"m:{n}"), symbols(f"k:{n}"), symbols(f"d:{n}")
bodies, loads = [], []
for i in range(n):
    point = origin.locatenew(f"P{i}", q[i] * frame.x); point.set_vel(frame, u[i] * frame.x)
    below = (q[i - 1], u[i - 1]) if i else (0, 0)
    force = -k[i] * (q[i] - below[0]) - d[i] * (u[i] - below[1])
    if i + 1 < n:
        force += k[i + 1] * (q[i + 1] - q[i]) + d[i + 1] * (u[i + 1] - u[i])
    bodies.append(Particle(f"M{i}", point, m[i])); loads.append((point, force * frame.x))
kane = KanesMethod(frame, q, u, kd_eqs=[a.diff() - b for a, b in zip(q, u)])
kane.kanes_equations(bodies, loads); kane.rhs()
print(time.perf_counter() - start)
""",
    ),
}


def peer_seconds(peer: Peer, sizes: Sequence[int]) -> dict[int, float | str]:
    """Seconds for each size, or in words why there are none; larger sizes than one that failed are not tried."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            python = _installed(peer.package, Path(folder))
        except (subprocess.SubprocessError, OSError) as error:
            return {size: f"cannot be installed ({type(error).__name__})" for size in sizes[:1]}
        found: dict[int, float | str] = {}
        for size in sizes:
            found[size] = _run(python, peer.program, size)
            if isinstance(found[size], str):
                break
        return found


def _installed(package: str, folder: Path) -> Path:
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    command = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package]
    subprocess.run(command, check=True, capture_output=True, timeout=INSTALL_LIMIT)
    return python


def _run(python: Path, program: str, size: int) -> float | str:
    command = [str(python), "-I", "-W", "ignore", "-c", program, str(size)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=RUN_LIMIT, check=False)
    except subprocess.TimeoutExpired:
        return f"not done within {RUN_LIMIT:.0f} s"
    if done.returncode:
        return f"fails: {(done.stderr.strip().splitlines() or ['?'])[-1][:80]}"
    return float(done.stdout.split()[-1])
