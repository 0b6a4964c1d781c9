"""Everything of numba and llvmlite that is used beyond their public interfaces, in one place (imports numba).

numba's own interfaces have neither a cache that can be checked, nor functions written as LLVM instructions, nor
kernels without reference counts. What is taken from inside is named here and nowhere else; ``missing`` tells what a
version does not have.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import llvmlite
import numba
from llvmlite import ir as _ir
from numba.core import caching as _caching
from numba.core import ccallback as _ccallback
from numba.core import cgutils as _cgutils
from numba.core import sigutils as _sigutils
from numba.core import types as _types
from numba.core.base import BaseContext as _BaseContext
from numba.core.options import DefaultOptions as _DefaultOptions

# Typed in part only, and not as what stands inside is used here.
caching: Any = _caching
ccallback: Any = _ccallback
cgutils: Any = _cgutils
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
    ccallback.CFunc: ("compile", "address", "ctypes"),
    cgutils: ("for_range",),
    sigutils: ("normalize_signature",),
    types: ("WrapperAddressProtocol", "Array", "float64", "void"),
    _BaseContext: ("make_array", "get_function", "get_dummy_value"),
    _DefaultOptions: ("_nrt", "nopython", "nogil", "no_cpython_wrapper", "no_cfunc_wrapper", "error_model", "fastmath"),
    ir: ("IRBuilder", "Function", "FunctionType", "GlobalVariable", "Constant"),
    ir.IRBuilder: ("gep", "load", "store", "select", "if_then", "fcmp_unordered", "call"),
}


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
