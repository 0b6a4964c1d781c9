"""The compiler of generated modules: text -> tape -> passes -> lanes.

A generated module is text (``loader`` reads it). ``front`` puts its equations on a tape of elementary operations
(``ir``), ``passes`` derive new operations from them: derivatives, factors, what parameters fix. ``lanes`` prints loops
over members and sigma points, and compiles them into vector instructions. Beside that way stand the form for one state
(``scalar``) and the cache of machine code (``machine_code``, ``kept``, ``cache``). A pendulum goes through:

>>> from bondgraph.compile.example import PENDULUM
>>> from bondgraph.compile.front.model_program import ModelProgram
>>> program = ModelProgram(PENDULUM, "pendulum", {"x": 2, "u": 1, "theta": 3})
>>> tape = program.tape
>>> [tape.operations[row].kind for row in program.rows["rhs"]]  # dx/dt: a state, and a difference
['leaf', 'sub']
>>> sorted(program.jacobian_nodes("rhs", "x"))  # a pass: which derivatives are not zero
[(0, 1), (1, 0), (1, 1)]
>>> from bondgraph.compile.passes.hoist import Hoister
>>> hoister = Hoister(tape)
>>> _ = hoister.rewrite(program.rows["rhs"])  # another: gravity/length is worked out once
>>> [tape.operations[node].kind for node in hoister.nodes]
['div']
>>> from bondgraph.compile.lanes.writer import lane_text
>>> print(lane_text(program, stiff=False).source.partition("def rates")[2].partition("def measure")[0].strip())
(clock, inputs, w, n):
    inputs_0 = inputs[0]
    for l in range(n):
        v_4 = _lane_sin(w[80 + l])
        dx1_9 = (inputs_0 - (w[96 + l] * w[16 + l])) - (v_4 * w[208 + l])
        w[112 + l] = w[96 + l]
        w[128 + l] = dx1_9

``lanes.load.load_lanes`` hands such text to ``lanes.compiler``, which writes LLVM instructions for it;
``lanes.object_code`` makes machine code of them and keeps it between runs.
"""
