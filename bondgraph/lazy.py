"""Names that a package exports and loads when they are first used (PEP 562).

A package says what it exports once for type checkers and once for the interpreter:

    if TYPE_CHECKING:
        from bondgraph.simulate.model import Model as Model
        from bondgraph.simulate.model import load as load
    else:
        __getattr__, __dir__, __all__ = exported(__name__, {"simulate.model": "Model load"})

A test compares both. Python sets ``bondgraph.simulate`` to the room of that name as soon as anything in it is imported,
so that a function of the same name would come and go with the imports of others: in a package that exports names this
way, a module never takes the place of an exported name.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from types import ModuleType

from bondgraph.errors import suggest


class _Package(ModuleType):
    """A package in which no module takes the place of an exported name."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (isinstance(value, ModuleType) and name in vars(self).get("__all__", ())):
            super().__setattr__(name, value)


def exported(
    package: str, names: Mapping[str, str]
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """The ``__getattr__``, ``__dir__`` and ``__all__`` of a package.

    Parameters
    ----------
    package
        Its full name.
    names
        What each module exports, names apart by spaces, by the module inside ``bondgraph``.

    Examples
    --------
    >>> getattribute, directory, every = exported("bondgraph", {"text": "few count"})
    >>> every, getattribute("few")(["mass"])
    (['count', 'few'], 'mass')
    >>> getattribute("cuont")
    Traceback (most recent call last):
        ...
    AttributeError: module 'bondgraph' has no attribute 'cuont'; did you mean 'count'?
    """
    homes = {name: f"bondgraph.{module}" for module, group in names.items() for name in group.split()}

    def load(name: str) -> object:
        if name not in homes:
            hint = "" if name.startswith("_") else suggest(name, homes)
            raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")
        value = getattr(importlib.import_module(homes[name]), name)
        vars(sys.modules[package])[name] = value  # the next look finds it at once
        return value

    def names_known() -> list[str]:
        return sorted({*homes, *(name for name in vars(sys.modules[package]) if name.startswith("__"))})

    sys.modules[package].__class__ = _Package
    return load, names_known, sorted(homes)
