"""Move what depends on parameters only out of the equations: it is computed once per set of parameters.

What depends on inputs only has no level of its own: inputs run as straight lines between samples, so that it changes in
every stage, and it is little (of the vehicle 11 operations in 246, none of them a function or a division).
A division by what is fixed becomes a product with its inverse, and several divisions by one quantity share one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from bondgraph.compile.ir.tape import Tape, reachable
from bondgraph.compile.passes.quick import LoopCalls

#: Vectors whose elements stay the same for a set of parameters.
_FIXED = ("theta", "hoisted")


class Hoister:
    """Rewrites nodes so that they read what depends on parameters only from the vector ``hoisted``.

    Examples
    --------
    >>> tape = Tape()
    >>> hoister = Hoister(tape)
    >>> slope = tape.div(tape.leaf("x", 0), tape.leaf("theta", 0))
    >>> program = tape.program(hoister.rewrite([slope]))
    >>> [operation.kind for operation in program.operations], len(hoister.nodes)
    (['leaf', 'leaf', 'mul'], 1)
    """

    def __init__(self, tape: Tape, calls: LoopCalls | None = None) -> None:
        self._tape = tape
        self._calls = calls
        self._levels: dict[int, int] = {}
        #: What is hoisted, in the order of its vector.
        self.nodes: list[int] = []

    def rewrite(self, results: Sequence[int]) -> list[int]:
        """The same nodes in terms of states, inputs, time, parameters and the vector ``hoisted``."""
        tape = self._tape
        if self._calls is not None:
            results = self._calls.widen(results)
        needed = reachable(tape.operations, results)
        divisors = Counter(tape.operations[n].arguments[1] for n in needed if tape.operations[n].kind == "div")
        new: dict[int, int] = {}
        for node in needed:
            operation = tape.operations[node]
            if operation.kind in ("constant", "leaf"):
                new[node] = node
            elif self._is_fixed(node):
                continue  # hoisted where something else uses it
            else:
                arguments = [self._argument(argument, new) for argument in operation.arguments]
                divisor = operation.arguments[-1]
                if operation.kind == "div" and (self._is_fixed(divisor) or divisors[divisor] > 1):
                    inverse = tape.div(1.0, divisor)
                    shared = self._hoisted(inverse) if self._is_fixed(divisor) else tape.div(1.0, arguments[1])
                    new[node] = tape.mul(arguments[0], shared)
                else:
                    new[node] = tape.emit(operation, arguments)
                if node in tape.names:
                    tape.names.setdefault(new[node], tape.names[node])
        return [self._argument(node, new) for node in results]

    def _argument(self, node: int, new: dict[int, int]) -> int:
        return new[node] if node in new else self._hoisted(node)

    def _hoisted(self, node: int) -> int:
        if self._tape.operations[node].kind in ("constant", "leaf"):
            return node
        number = self._tape.as_number(node)
        if number not in self.nodes:
            self.nodes.append(number)
        return self._tape.as_kept(node, self._tape.leaf("hoisted", self.nodes.index(number)))

    def _is_fixed(self, node: int) -> bool:
        """Whether a node depends on parameters and constants only."""
        for later in reachable(self._tape.operations, [node], stop=self._levels):
            if later not in self._levels:
                operation = self._tape.operations[later]
                moves = operation.kind == "leaf" and operation.value[0] not in _FIXED
                self._levels[later] = max([int(moves), *(self._levels[a] for a in operation.arguments)])
        return self._levels[node] == 0
