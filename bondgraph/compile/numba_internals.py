"""Everything of numba and llvmlite that is used beyond their public interfaces, in one place (imports numba).

numba's own interfaces have neither a cache that can be checked, nor functions written as LLVM instructions, nor
kernels without reference counts. What is taken from inside is named here and nowhere else; ``missing`` tells what a
version does not have.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import llvmlite
import numba
import numba.experimental.function_type  # which tells numba the type of functions that are handed over
from llvmlite import binding as _binding
from llvmlite import ir as _ir
from numba.core import caching as _caching
from numba.core import cgutils as _cgutils
from numba.core import sigutils as _sigutils
from numba.core import types as _types
from numba.core.base import BaseContext as _BaseContext
from numba.core.codegen import JITCPUCodegen as _JITCPUCodegen
from numba.core.cpu import CPUContext as _CPUContext
from numba.core.options import DefaultOptions as _DefaultOptions
from numba.core.registry import cpu_target as _cpu_target

# Typed in part only, and not as what stands inside is used here.
caching: Any = _caching
cgutils: Any = _cgutils
binding: Any = _binding
ir: Any = _ir
sigutils: Any = _sigutils
types: Any = _types

#: Option of ``njit`` that leaves out counts of references to arrays.
UNCOUNTED = {"_nrt": False}

#: Methods and attributes by the class or module that has them.
_NEEDED: dict[Any, tuple[str, ...]] = {
    caching: ("NullCache", "CompileResultCacheImpl", "InTreeCacheLocator", "FunctionCache", "IndexDataCacheFile"),
    caching.FunctionCache: ("save_overload", "load_overload"),
    caching.IndexDataCacheFile: ("_open_for_write", "_load_index", "_load_data", "_data_path"),
    caching.CompileResultCacheImpl: ("filename_base", "locator"),
    caching.InTreeCacheLocator: ("get_source_stamp",),
    cgutils: ("for_range", "alloca_once", "unpack_tuple", "pack_array"),
    binding: (
        "Target",
        "ObjectFileRef",
        "parse_assembly",
        "create_mcjit_compiler",
        "create_new_module_pass_manager",
        "create_pass_builder",
        "create_pipeline_tuning_options",
        "add_symbol",
    ),
    _JITCPUCodegen: ("_get_host_cpu_name", "_get_host_cpu_features"),
    sigutils: ("normalize_signature",),
    types: ("WrapperAddressProtocol", "Array", "float64", "void"),
    _BaseContext: ("make_array", "get_value_type"),
    _CPUContext: ("codegen",),
    _DefaultOptions: ("_nrt", "nopython", "nogil", "no_cpython_wrapper", "no_cfunc_wrapper", "error_model", "fastmath"),
    ir: ("IRBuilder", "Function", "FunctionType", "GlobalVariable", "Constant"),
    ir.IRBuilder: ("gep", "load", "store", "select", "if_then", "if_else", "fcmp_unordered", "call", "shuffle_vector"),
}


def llvm_version() -> str:
    """Versions of llvmlite and of its LLVM."""
    return f"llvmlite {llvmlite.__version__}, LLVM {'.'.join(map(str, binding.llvm_version_info))}"


def processor() -> tuple[str, str]:
    """Name and features of the processor for which numba compiles."""
    codegen: Any = _cpu_target.target_context.codegen()
    return codegen._get_host_cpu_name(), codegen._get_host_cpu_features()


def value_type(kind: Any) -> Any:
    """The LLVM type by which numba hands a value of this type to a C callback."""
    return _cpu_target.target_context.get_value_type(kind)


def array_of(kind: Any, builder: Any, value: Any) -> tuple[Any, tuple[Any, ...]]:
    """Where the numbers of an array begin and its lengths, as LLVM values; None and nothing for what is no array."""
    if not isinstance(kind, types.Array):
        return None, ()
    context: Any = _cpu_target.target_context
    array = context.make_array(kind)(context, builder, value)
    return array.data, tuple(cgutils.unpack_tuple(builder, array.shape))


def callback_array(kind: Any, builder: Any, data: Any, lengths: Sequence[Any]) -> Any:
    """An array as numba hands it to C callbacks, with what those of this package read: its place and lengths."""
    context: Any = _cpu_target.target_context
    array = context.make_array(kind)(context, builder)
    array.data, array.shape = data, cgutils.pack_array(builder, lengths)
    return array._getvalue()


def missing() -> tuple[str, ...]:
    """Internals that the installed versions do not have, each with the version; empty where all is well.

    Examples
    --------
    >>> missing()
    ()
    """
    versions = f"numba {numba.__version__}, llvmlite {llvmlite.__version__}"
    return tuple(f"{name} ({versions})" for name in _missing_names())


def _missing_names() -> Iterator[str]:
    for owner, names in _NEEDED.items():
        called = owner.__name__
        yield from (f"{called}.{name}" for name in names if not hasattr(owner, name))
