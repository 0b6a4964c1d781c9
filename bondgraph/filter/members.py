"""The numbers that differ between the members of a batch: parameters, noises, initial states."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TypedDict

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray, count_members, member_columns
from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.kernel_types import Members
from bondgraph.filter.samples import Samples
from bondgraph.filter.ukf import Member, scaled
from bondgraph.simulate.model import Model
from bondgraph.simulate.starts import starts_in


class MemberValues(TypedDict, total=False):
    """What may be given for a batch in place of the filter model's own numbers.

    Each is one vector for all members, or has one column per member: ``noise_std`` (n_y, members), ``process_std`` and
    ``initial_std`` (n_s, members), ``x0`` (n_x, members). ``x0`` and ``initial_std`` may be a list with one such array
    per log, or None in it for the declared values. ``noise_correlation`` (n_y, n_y, members), ``process_correlation``
    and ``initial_correlation`` (n_s, n_s, members), or one matrix for all.
    """

    noise_std: npt.ArrayLike | None
    process_std: npt.ArrayLike | None
    initial_std: npt.ArrayLike | list[npt.ArrayLike | None] | None
    x0: npt.ArrayLike | list[npt.ArrayLike | None] | None
    noise_correlation: npt.ArrayLike | None
    process_correlation: npt.ArrayLike | None
    initial_correlation: npt.ArrayLike | None


@dataclass(frozen=True)
class MemberBatch:
    """Members of one log, the last axis: the numbers of a :class:`bondgraph.filter.ukf.Member` of each."""

    theta: FloatArray
    x0: FloatArray
    initial_std: FloatArray
    process_std: FloatArray
    noise_std: FloatArray
    initial_correlation: FloatArray
    process_correlation: FloatArray
    noise_correlation: FloatArray

    @property
    def size(self) -> int:
        """Number of members."""
        return int(self.theta.shape[1])

    def chosen(self, members: npt.NDArray[np.intp]) -> MemberBatch:
        """Some of the members."""
        return MemberBatch(*(np.ascontiguousarray(getattr(self, own.name)[..., members]) for own in fields(self)))

    def member(self, m: int) -> Member:
        """The numbers of one member."""
        return Member(*(getattr(self, own.name)[..., m] for own in fields(self)))

    @functools.cached_property
    def for_kernels(self) -> Members:
        """The members as kernels read them, made once for all blocks of them and all parts of a log."""
        arrays = (
            self.theta, self.x0, self._initial_lower(), scaled(self.process_correlation, self.process_std),
            scaled(self.noise_correlation, np.nan_to_num(self.noise_std)),
        )  # fmt: skip
        return Members(*map(np.ascontiguousarray, arrays))

    def _initial_lower(self) -> FloatArray:
        """Lower factors of the initial covariances, (n_s, n_s, members)."""
        factors = np.array([_cholesky(matrix) for matrix in np.moveaxis(self.initial_correlation, 2, 0)])
        factors = factors.reshape(self.size, *self.initial_correlation.shape[:2])
        lower: FloatArray = np.moveaxis(factors, 0, 2) * self.initial_std[:, np.newaxis]
        return lower


def _cholesky(matrix: FloatArray) -> FloatArray:
    """Lower factor; NaN, with which a member diverges, where correlations contradict each other."""
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full(matrix.shape, np.nan)


def member_batches(
    filter_model: FilterModel, logs: Sequence[Samples], theta: npt.ArrayLike | None, values: MemberValues
) -> tuple[MemberBatch, ...]:
    """The members of each log, with the parameters that the log knows in their place.

    Raises
    ------
    FilterError, ModelError
        If a shape does not fit, or a list does not have one entry per log.
    """
    x0 = per_log("x0", values.get("x0"), len(logs))
    initial_std = per_log("initial_std", values.get("initial_std"), len(logs))
    noise_std, process_std = values.get("noise_std"), values.get("process_std")
    members = count_members((theta, noise_std, process_std, *x0, *initial_std))
    model = filter_model.model

    def columns(name: str, given: npt.ArrayLike | None, declared: FloatArray) -> FloatArray:
        return member_columns(name, declared if given is None else given, declared.shape[0], members)

    parameters = columns("theta", theta, model.theta())
    noise = columns("noise_std", noise_std, filter_model.noise_std)
    process = columns("process_std", process_std, filter_model.process_std)
    if np.any(process) and not filter_model.is_driven:
        raise FilterError(
            f"{filter_model.model.name}: process_std drives states, but process_noise names none - name those that may "
            "be driven, with a level of zero if need be",
            where=(filter_model.model.name, "process_std"),
        )

    def matrices(name: str, declared: FloatArray) -> FloatArray:
        given: npt.ArrayLike | None = values.get(name)  # type: ignore[assignment]
        array = declared if given is None else np.asarray(given, dtype=np.float64)
        if array.shape[:2] != declared.shape or array.shape[2:] not in ((), (members,)):
            raise FilterError(f"{name} has shape {array.shape}, not {(*declared.shape, members)}", where=(name,))
        return np.array(np.broadcast_to(array.reshape(*declared.shape, -1), (*declared.shape, members)))

    correlations = (
        matrices("initial_correlation", filter_model.start_correlations),
        matrices("process_correlation", filter_model.process_correlations),
        matrices("noise_correlation", filter_model.noise_correlations),
    )
    _check_independent(filter_model, correlations[2])
    return tuple(
        MemberBatch(
            samples.theta(filter_model, parameters),
            columns("x0", x0[i], _begun(model, samples, samples.theta(filter_model, parameters))),
            columns("initial_std", initial_std[i], filter_model.start_std),
            process,
            noise,
            *correlations,
        )
        for i, samples in enumerate(logs)
    )


def _begun(model: Model, samples: Samples, theta: FloatArray) -> FloatArray:
    """Where a log begins that nobody gave an initial state, (n_x,) or (n_x, members), at theta (n_theta, members)."""
    return starts_in(model, samples.time, samples.u, samples.y, model.x0(theta))[0]


def _check_independent(filter_model: FilterModel, correlation: FloatArray) -> None:
    """Refuse correlated sensors (n_y, n_y, members) where outliers are judged channel by channel."""
    name, robust = filter_model.model.name, filter_model.robust
    if robust and np.any(correlation != filter_model.noise_correlations[:, :, np.newaxis]):
        raise FilterError(
            f"{name}: noise_correlation with robust={robust.kind!r} - outliers are judged channel by channel, so"
            " sensors must be independent: leave one of both out",
            where=(name, "noise_correlation"),
        )


def per_log(
    name: str, given: npt.ArrayLike | list[npt.ArrayLike | None] | None, logs: int
) -> list[npt.ArrayLike | None]:
    """One entry per log; a list of plain numbers is one vector for all logs."""
    if isinstance(given, list) and not all(isinstance(entry, int | float) for entry in given):
        if len(given) != logs:
            raise FilterError(f"{name} has {len(given)} entries for {logs} logs - give one per log", where=(name,))
        return list(given)
    shared: npt.ArrayLike | None = given  # type: ignore[assignment]
    return [shared] * logs
