"""Machine code of printed modules: compiled for this processor, kept between runs, loaded once a process.

LLVM finds little to improve in printed text, whose expressions are shared and whose loops are vectors already. Two
passes tidy it up. Steps of a vehicle took within 5 % of what they took after all passes of numba, and compiling them a
quarter of the time.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import hashlib
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bondgraph.compile.cache import keep, kept
from bondgraph.compile.lanes.compiler import entry_name, lane_module
from bondgraph.compile.lanes.instructions import LIBRARY, LIBRARY_PLACE
from bondgraph.compile.numba_internals import binding, llvm_version, processor, sigutils
from bondgraph.compile.pointer import CompiledFunction

#: Effort that LLVM spends on machine code, of 0 to 3: with 3 no step of a vehicle was faster.
_EFFORT = 2

_lock = threading.Lock()
#: Functions by the digest of their text; their code stays as long as the process.
_loaded: dict[str, dict[str, CompiledFunction]] = {}
_engines: list[Any] = []


def load_functions(source: str, exports: Mapping[str, str]) -> dict[str, CompiledFunction]:
    """Functions of a printed module that other compiled functions can call.

    Parameters
    ----------
    source
        The text of the module.
    exports
        Signatures, in numba's notation, by the names of the functions that are wanted.

    Raises
    ------
    ModelError
        If the text has statements that are never printed.

    Examples
    --------
    >>> import numba, numpy as np
    >>> text = '''
    ... def double(w, n):
    ...     for l in range(n):
    ...         w[8 + l] = 2.0*w[0 + l]
    ... '''
    >>> double = load_functions(text, {"double": "void(float64[::1], int64)"})["double"]
    >>> w = np.arange(16.0)
    >>> numba.njit(lambda call, w: call(w, 8))(double, w)
    >>> w[8:]
    array([ 0.,  2.,  4.,  6.,  8., 10., 12., 14.])
    """
    name = f"lanes_{_digest(source, exports)}"
    with _lock:
        if name not in _loaded:
            engine = _engine(name, source, exports)
            _engines.append(engine)
            _loaded[name] = {
                function: CompiledFunction(
                    engine.get_function_address(entry_name(function)), sigutils.normalize_signature(signature)
                )
                for function, signature in exports.items()
            }
        return _loaded[name]


def _digest(source: str, exports: Mapping[str, str]) -> str:
    """Digest of all that machine code depends on: text, signatures, compiler of the text, LLVM, processor."""
    parts = [source, repr(sorted(exports.items())), _compiler(), llvm_version(), *processor()]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]


@functools.cache
def _compiler() -> str:
    """Digest of the sources of the compiler."""
    here = Path(__file__)
    sources = [here.with_name(name).read_bytes() for name in ("compiler.py", "instructions.py", here.name)]
    return hashlib.sha256(b"\0".join(sources)).hexdigest()


def _engine(name: str, source: str, exports: Mapping[str, str]) -> Any:
    """The loaded code of a module, taken from the cache folder or compiled."""
    machine = _machine()
    # an engine begins with a module; the code itself comes beside it. All of its sections are mapped as one piece: code
    # reaches its numbers and tables by addresses of 32 bits
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), machine, use_lmm=True)
    code = kept(f"{name}.o")
    if code is None:
        code = _compiled(lane_module(source, exports), machine)
        keep(f"{name}.o", code)
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    place = ctypes.CFUNCTYPE(ctypes.c_void_p)(engine.get_function_address(LIBRARY_PLACE))()
    table = (ctypes.c_void_p * len(LIBRARY)).from_address(place)
    for position, address in enumerate(_library()):
        table[position] = address
    return engine


def _compiled(instructions: str, machine: Any) -> bytes:
    module = binding.parse_assembly(instructions)
    builder = binding.create_pass_builder(machine, binding.create_pipeline_tuning_options(0))
    passes = binding.create_new_module_pass_manager()
    passes.add_sroa_pass()  # what loops change stands in registers
    passes.add_instruction_combine_pass()
    passes.run(module, builder)
    return bytes(machine.emit_object(module))


def _machine() -> Any:
    name, features = processor()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(cpu=name, features=features, opt=_EFFORT, reloc="pic", codemodel="small")


@functools.cache
def _library() -> list[int]:
    """Addresses of the functions of the mathematical library."""
    library = ctypes.CDLL(ctypes.util.find_library("m") or ctypes.util.find_library("ucrtbase"))
    return [ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0 for name in LIBRARY]
