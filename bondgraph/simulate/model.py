"""A generated module as a value: names, units, defaults, bounds and its equations.

text of a generated module  ->  Model  ->  model.rhs(t, x, u, theta), model.output(...)   (numpy, any batch)
                                       ->  model.compiled.rhs_into(...)                   (numba, one state)
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray
from bondgraph.compile.loader import parse_module, require_function, run_module
from bondgraph.errors import ModelError, require_kind, suggest
from bondgraph.simulate.model_checks import check_rows, check_shapes
from bondgraph.simulate.quantities import InputInfo, OutputInfo, ParameterInfo, StartInfo, StateInfo
from bondgraph.simulate.rows import EventInfo, ModeInfo, events_of, input_rows, parameter_rows, rows, shown_rows
from bondgraph.text import count

if TYPE_CHECKING:
    from bondgraph.compile.front.model_program import Equations, ModelProgram
    from bondgraph.compile.machine_code import CompiledModel

Kind = Literal["state", "input", "parameter", "output"]


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """State equations of one generated module: ``dx/dt = rhs(t, x, u, theta)``, ``y = output(t, x, u, theta)``.

    Load one with :func:`load`, or make one from a graph with :func:`bondgraph.build.build`. Two models are equal when
    their texts are. All numbers are in the ``unit`` of their quantity, coherent SI in what is generated; what is shown
    is in its ``display_unit``.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> model = pendulum()
    >>> model.names("state"), model.names("parameter")
    (('angle', 'rate'), ('length', 'damping', 'gravity'))
    >>> model.rhs(0.0, model.x0(angle=0.1), model.u0(), model.theta(length=2.0)).shape
    (2,)
    """

    name: str
    text: str
    doc: str = field(compare=False, repr=False)
    states: tuple[StateInfo, ...] = field(compare=False, repr=False)
    inputs: tuple[InputInfo, ...] = field(compare=False, repr=False)
    parameters: tuple[ParameterInfo, ...] = field(compare=False, repr=False)
    outputs: tuple[OutputInfo, ...] = field(compare=False, repr=False)
    _rhs: Callable[..., Any] = field(compare=False, repr=False)
    _output: Callable[..., Any] = field(compare=False, repr=False)
    modes: tuple[ModeInfo, ...] = field(default=(), compare=False, repr=False)
    event_rows: tuple[EventInfo, ...] = field(default=(), compare=False, repr=False)
    _events: Callable[..., Any] | None = field(default=None, compare=False, repr=False)
    _resets: Mapping[str, Callable[..., Any]] = field(default_factory=dict, compare=False, repr=False)
    starts: tuple[StartInfo, ...] = field(default=(), compare=False, repr=False)
    parameter_starts: tuple[str, ...] = field(default=(), compare=False, repr=False)
    _start: Callable[..., Any] | None = field(default=None, compare=False, repr=False)

    @classmethod
    def from_text(cls, text: str, source: str = "generated module", *, own: bool = False) -> Model:
        """Load the text of a generated module; ``own`` text, just rendered, need not be looked at before it is run.

        Raises
        ------
        ModelError
            If it is not a generated module of the format this version reads.
        """
        names = run_module(text if own else parse_module(text, source), source)
        model = cls(
            name=str(names["NAME"]),
            text=text,
            doc=str(names.get("__doc__") or ""),
            states=shown_rows(names, "STATES", StateInfo, source),
            inputs=input_rows(names, InputInfo, source),
            parameters=parameter_rows(names, ParameterInfo, source),
            outputs=shown_rows(names, "OUTPUTS", OutputInfo, source),
            _rhs=require_function(names, "rhs", source),
            _output=require_function(names, "output", source),
            starts=rows(names, "STARTS", StartInfo, source) if "STARTS" in names else (),
            parameter_starts=names.get("PARAMETER_STARTS", ()),
            _start=require_function(names, "start", source) if "PARAMETER_STARTS" in names else None,
            **events_of(names, source),
        )
        check_rows(model, source)
        check_shapes(model, source)
        return model

    @classmethod
    def from_file(cls, path: str | Path) -> Model:
        """Load a generated module.

        Raises
        ------
        ModelError
            If the file cannot be read or is not a generated module.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ModelError(f"{path}: cannot be read as a generated module: {error}", where=(str(path),)) from None
        return cls.from_text(text, source=Path(path).name)

    def __eq__(self, other: object) -> bool:
        return self.text == other.text if isinstance(other, Model) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.text)

    def __repr__(self) -> str:
        sizes = ", ".join(count(len(self._infos(kind)), kind) for kind in get_args(Kind))
        return f"<{type(self).__name__} {self.name}: {sizes}>"

    def __reduce__(self) -> tuple[Callable[[str], Model], tuple[str]]:
        return Model.from_text, (self.text,)

    @functools.cached_property
    def digest(self) -> str:
        """Digest of the text; the key of everything that is cached for this model."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:16]

    @functools.cached_property
    def compiled(self) -> CompiledModel:
        """Scalar in-place functions, compiled with numba where it is installed; cached between runs."""
        from bondgraph.compile.machine_code import compile_model  # here: numba is imported only by those who need it

        return compile_model(self.text, self.name, self.rhs, self.output)

    @functools.cached_property
    def program(self) -> ModelProgram:
        """The equations as a list of operations, which can be differentiated and printed in other forms."""
        from bondgraph.compile.front.model_program import ModelProgram  # here: read by those who need it

        return ModelProgram(
            self.text, self.name, {"x": len(self.states), "u": len(self.inputs), "theta": len(self.parameters)}
        )

    def rhs(self, t: float | FloatArray, x: npt.ArrayLike, u: npt.ArrayLike, theta: npt.ArrayLike) -> FloatArray:
        """Time derivatives of the states.

        Parameters
        ----------
        t
            Time, s; one for all, or one per member of the batch.
        x
            States, shape (n_x, *batch).
        u, theta
            Inputs and parameters, shapes (n_u,) or (n_u, *batch) and (n_theta,) or (n_theta, *batch).

        Returns
        -------
        FloatArray
            dx/dt, shape (n_x, *batch).
        """
        result: FloatArray = self._rhs(t, np.asarray(x, np.float64), np.asarray(u), np.asarray(theta))
        return result

    def output(self, t: float | FloatArray, x: npt.ArrayLike, u: npt.ArrayLike, theta: npt.ArrayLike) -> FloatArray:
        """Measured quantities, shape (n_y, *batch); arguments as for :meth:`rhs`."""
        result: FloatArray = self._output(t, np.asarray(x, np.float64), np.asarray(u), np.asarray(theta))
        return result

    def events(self, t: float | FloatArray, x: npt.ArrayLike, u: npt.ArrayLike, theta: npt.ArrayLike) -> FloatArray:
        """Zero functions of the modes, shape (n_events, *batch), a row for each of ``event_rows``; none without modes.

        Arguments as for :meth:`rhs`.
        """
        states = np.asarray(x, np.float64)
        if self._events is None:
            return np.empty((0, *states.shape[1:]))
        result: FloatArray = self._events(t, states, np.asarray(u), np.asarray(theta))
        return result

    def reset(self, mode: str, t: float, x: npt.ArrayLike, u: npt.ArrayLike, theta: npt.ArrayLike) -> FloatArray:
        """The states after an impact on the element of a mode, or after it has locked, shape (n_x, *batch).

        Raises
        ------
        ModelError
            If there is no such mode, or it is one of a switch.
        """
        if mode not in self._resets:
            known = ", ".join(self._resets) or "none"
            raise ModelError(
                f"{self.name}: mode {mode!r} does not change the states{suggest(mode, self._resets)} - those that do:"
                f" {known}",
                where=(self.name, mode),
            )
        result: FloatArray = self._resets[mode](t, np.asarray(x, np.float64), np.asarray(u), np.asarray(theta))
        return result

    def jacobian_x(
        self, t: float | FloatArray, x: npt.ArrayLike, u: npt.ArrayLike, theta: npt.ArrayLike, of: Equations = "rhs"
    ) -> FloatArray:
        """Derivatives of ``rhs`` (or ``output``) with respect to the states, exact; arguments as for :meth:`rhs`.

        Returns
        -------
        FloatArray
            Shape (rows of ``of``, n_x, *batch). ``program.jacobian(of, "x")`` tells which entries are always zero.

        Examples
        --------
        >>> from bondgraph.simulate.example import pendulum
        >>> model = pendulum()
        >>> model.jacobian_x(0.0, model.x0(angle=0.0), model.u0(), model.theta()).round(6).tolist()
        [[0.0, 1.0], [-9.81, -0.1]]
        """
        return self.program.dense_jacobian(of, "x", t, *map(np.asarray, (x, u, theta)))

    def jacobian_u(
        self, t: float | FloatArray, x: npt.ArrayLike, u: npt.ArrayLike, theta: npt.ArrayLike, of: Equations = "rhs"
    ) -> FloatArray:
        """Derivatives with respect to the inputs, (rows, n_u, *batch), as :meth:`jacobian_x`."""
        return self.program.dense_jacobian(of, "u", t, *map(np.asarray, (x, u, theta)))

    def jacobian_theta(
        self, t: float | FloatArray, x: npt.ArrayLike, u: npt.ArrayLike, theta: npt.ArrayLike, of: Equations = "rhs"
    ) -> FloatArray:
        """Derivatives with respect to the parameters, (rows, n_theta, *batch), as :meth:`jacobian_x`."""
        return self.program.dense_jacobian(of, "theta", t, *map(np.asarray, (x, u, theta)))

    @property
    def model(self) -> Model:
        """The run-time half alone: of a loaded model, itself."""
        return self

    @property
    def driven(self) -> tuple[str, ...]:
        """States that process noise may drive where nothing else is said; a module alone tells of none it may not."""
        return self.names("state")

    def names(self, kind: Kind) -> tuple[str, ...]:
        """Names of the states, inputs, parameters or outputs, in the order of their vector."""
        return tuple(info.name for info in self._infos(kind))

    def index(self, kind: Kind, name: str) -> int:
        """Position of a name in its vector.

        Raises
        ------
        ModelError
            If there is no such name, with the closest one there is.
        """
        names = self.names(kind)
        if name not in names:
            raise ModelError(
                f"{self.name}: no {kind} {name!r}{suggest(name, names)} - there are {', '.join(names) or 'none'}",
                where=(self.name, name),
            )
        return names.index(name)

    def theta(self, **overrides: float) -> FloatArray:
        """Parameter vector (n_theta,): declared values, with those given by name in their place."""
        return self._vector("parameter", [info.value for info in self.parameters], overrides)

    def x0(self, theta: npt.ArrayLike | None = None, /, **overrides: float) -> FloatArray:
        """Initial state (n_x,): declared values, with those given by name in their place.

        Where states start at an expression of parameters it is that at ``theta`` (n_theta,), or of shape (n_x, members)
        at (n_theta, members); None: at the declared parameters.
        """
        declared = self._vector("state", [info.initial for info in self.states], overrides)
        if theta is None or self._start is None:
            return declared
        values = np.asarray(theta, dtype=np.float64)
        batch = (1,) * (values.ndim - 1)
        x = np.broadcast_to(declared.reshape(-1, *batch), (declared.size, *values.shape[1:]))
        found: FloatArray = self._start(0.0, x, self.u0(), values)
        for name, value in overrides.items():
            found[self.index("state", name)] = value
        return found

    def u0(self, **overrides: float | str) -> FloatArray:
        """Input vector (n_u,): defaults, with those given by name in their place; codes may be given as letters."""
        numbers = {name: self.input_value(name, value) for name, value in overrides.items()}
        return self._vector("input", [info.default for info in self.inputs], numbers)

    def input_value(self, name: str, value: float | str) -> float:
        """The number an input takes for a value or a letter.

        Raises
        ------
        ModelError
            If the input is unknown or does not know the letter.
        """
        info = self.inputs[self.index("input", name)]
        if not isinstance(value, str):
            return float(value)
        letters = info.letters or {}
        if value not in letters:
            known = ", ".join(letters) or f"none: it takes a number alone, in {info.display_unit}"
            raise ModelError(
                f"{self.name}: input {name!r} has no letter {value!r} - it knows {known}", where=(self.name, name)
            )
        return letters[value]

    def _infos(self, kind: Kind) -> tuple[StateInfo | InputInfo | ParameterInfo | OutputInfo, ...]:
        groups: dict[str, tuple[StateInfo | InputInfo | ParameterInfo | OutputInfo, ...]] = {
            "state": self.states,
            "input": self.inputs,
            "parameter": self.parameters,
            "output": self.outputs,
        }
        return groups[kind]

    def _vector(self, kind: Kind, defaults: list[float], overrides: Mapping[str, float]) -> FloatArray:
        vector = np.array(defaults, dtype=np.float64)
        for name, value in overrides.items():
            vector[self.index(kind, name)] = value
        return vector


def load(path: str | Path) -> Model:
    """The model in a generated module.

    Parameters
    ----------
    path
        A file that ``bondgraph generate`` wrote.

    Raises
    ------
    ModelError
        If the file cannot be read or is not a generated module.

    Examples
    --------
    >>> import tempfile
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "pendulum.py").write_text(pendulum().text)
    ...     bg.load(f"{folder}/pendulum.py")
    <Model pendulum: 2 states, 1 input, 3 parameters, 1 output>
    """
    require_kind("load", path, (str, Path), "file")
    return Model.from_file(path)
