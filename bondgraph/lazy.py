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

On the package index another distribution holds an import package ``bondgraph`` too. Installed over ours, it replaces
``bondgraph/__init__.py`` and leaves the rest: the rooms say so instead of failing somewhere.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from types import ModuleType

from bondgraph.errors import suggest

_DISTRIBUTION = "bondloop"


class _Package(ModuleType):
    """A package in which no module takes the place of an exported name."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (isinstance(value, ModuleType) and name in vars(self).get("__all__", ())):
            super().__setattr__(name, value)


def overwritten() -> str:
    """What has happened to the front door of this package and what to do; empty where it is our own.

    Examples
    --------
    >>> overwritten()
    ''
    """
    package = sys.modules["bondgraph"]
    if isinstance(package, _Package):
        return ""
    from importlib.metadata import packages_distributions  # costs more than all other imports of `import bondgraph`

    others = sorted({*packages_distributions().get("bondgraph", ())} - {_DISTRIBUTION})
    file = getattr(package, "__file__", None)
    found = f"{file} is not the one of {_DISTRIBUTION}" if file else f"{list(package.__path__)} lacks its __init__.py"
    cause = (
        f"the distribution {' and '.join(others)} has an import package of the same name and was installed over it"
        if others
        else "another distribution was installed over it, or was removed again"
    )
    removal = f"python -m pip uninstall {' '.join(others)}, then " if others else ""
    return (
        f"{found}: {cause} - {removal}python -m pip install --force-reinstall --no-deps {_DISTRIBUTION}; where both "
        "are needed, each in a virtual environment of its own"
    )


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

    Raises
    ------
    ImportError
        If the package belongs to a ``bondgraph`` whose front door another distribution has overwritten.

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
    if package != "bondgraph" and (problem := overwritten()):
        raise ImportError(problem, name="bondgraph")
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
