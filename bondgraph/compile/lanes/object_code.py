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
from collections.abc import Callable, Mapping, Sequence
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
_entries: dict[str, int] = {}
_engines: list[Any] = []
#: Sources of what compiles printed modules.
_COMPILER = tuple(Path(__file__).with_name(name) for name in ("compiler.py", "instructions.py"))


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
    name = f"lanes_{_digest(_COMPILER, source, repr(sorted(exports.items())))}"
    with _lock:
        if name not in _loaded:
            engine = _engine(
                name, lambda: lane_module(source, exports), _tidy, _machine("pic", "small"), one_piece=True
            )
            _fill_library(engine)
            _loaded[name] = {
                function: CompiledFunction(
                    engine.get_function_address(entry_name(function)), sigutils.normalize_signature(signature)
                )
                for function, signature in exports.items()
            }
        return _loaded[name]


def load_entry(compiler: Sequence[Path], parts: Sequence[str], instructions: Callable[[], str]) -> int:
    """Address of the function ``entry`` of a module of instructions, which LLVM improves as far as it can.

    Parameters
    ----------
    compiler
        Sources of what writes the instructions.
    parts
        Texts from which it writes them.
    instructions
        What writes them, if they are not kept.
    """
    name = f"kernel_{_digest(compiler, *parts)}"
    with _lock:
        if name not in _entries:
            _library()
            engine = _engine(name, instructions, _improve, _machine("static", "large"), one_piece=False)
            _entries[name] = engine.get_function_address("entry")
        return _entries[name]


def _digest(compiler: Sequence[Path], *parts: str) -> str:
    """Digest of all that machine code depends on: texts, their compiler, LLVM, processor."""
    every = [*parts, _sources(tuple(compiler)), llvm_version(), *processor()]
    return hashlib.sha256("\0".join(every).encode()).hexdigest()[:24]


@functools.cache
def _sources(paths: Sequence[Path]) -> str:
    """Digest of sources, and of this one."""
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in (*paths, Path(__file__)))).hexdigest()


def _engine(
    name: str, instructions: Callable[[], str], improve: Callable[[Any, Any], None], machine: Any, *, one_piece: bool
) -> Any:
    """The loaded code of a module, taken from the cache folder or compiled.

    Lanes reach their numbers and tables by addresses of 32 bits, so that all of their sections are mapped as
    ``one_piece``. Kernels, which LLVM lets call what it likes, have addresses of 64 bits and lie anywhere.
    """
    # an engine begins with a module; the code itself comes beside it
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), machine, use_lmm=one_piece or None)
    code = kept(f"{name}.o")
    if code is None:
        module = binding.parse_assembly(instructions())
        improve(module, machine)
        code = bytes(machine.emit_object(module))
        keep(f"{name}.o", code)
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return engine


def _tidy(module: Any, machine: Any) -> None:
    builder = binding.create_pass_builder(machine, binding.create_pipeline_tuning_options(0))
    passes = binding.create_new_module_pass_manager()
    passes.add_sroa_pass()  # what loops change stands in registers
    passes.add_instruction_combine_pass()
    passes.run(module, builder)


def _improve(module: Any, machine: Any) -> None:
    options = binding.create_pipeline_tuning_options(2)
    options.loop_vectorization = True
    builder = binding.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)


def _machine(addresses: str, distance: str) -> Any:
    name, features = processor()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(cpu=name, features=features, opt=_EFFORT, reloc=addresses, codemodel=distance)


def _fill_library(engine: Any) -> None:
    """Write the addresses of the functions of the mathematical library into the table that a module has for them."""
    place = ctypes.CFUNCTYPE(ctypes.c_void_p)(engine.get_function_address(LIBRARY_PLACE))()
    table = (ctypes.c_void_p * len(LIBRARY)).from_address(place)
    for position, address in enumerate(_library()):
        table[position] = address


@functools.cache
def _library() -> list[int]:
    """Addresses of the functions of the mathematical library, which modules may call by their names from then on."""
    library = ctypes.CDLL(ctypes.util.find_library("m") or ctypes.util.find_library("ucrtbase"))
    addresses = [ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0 for name in LIBRARY]
    for name, address in zip(LIBRARY, addresses, strict=True):
        binding.add_symbol(name, address)
    return addresses
