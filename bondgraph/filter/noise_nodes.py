"""Times inside the intervals of a log at which process noise enters, so that the model carries it on.

Noise that drives the states in continuous time leaves over an interval of length h

    Q = integral over s from 0 to h of  Phi(h, s) S Phi(h, s)' ds,        Phi the transition from s to h, S = std^2,

and not S h: a state with a rate of 6/s forgets within a quarter of a second what has driven it. The integral is taken
by the rule of :mod:`bondgraph.filter.decay_rule`: at its nodes the covariance takes in its share of S, and the sigma
points, drawn anew, carry it to the next node. Whatever moves the points moves the noise, so that value and gradient
stay those of one recursion. Nodes crowd towards the end of the interval where fast states ask for it: with three of
them inside, states are followed that forget within a fiftieth of it.

Reference: Sarkka (2007), On unscented Kalman filtering for state estimation of continuous-time nonlinear systems, IEEE
Trans. Automatic Control 52(9), for the moments between samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.data.band_limited import finer_times
from bondgraph.filter.decay_rule import decay_rule

#: Nodes nearer to each other than this share of the shortest interval are the same but for rounding.
_SAME_NODE = 1e-6


@dataclass(frozen=True)
class NoiseNodes:
    """Nodes of a log: the times of its samples and those between them.

    ``time`` (m,) in s; ``sample`` (n,) are the positions of the log's samples in it; ``interval`` (m-1,) is the
    interval of the log in which each step from node to node lies, and ``share`` (m-1,) the step's part of one median
    interval. Noise enters for ``start`` (m-1,) seconds before and for ``end`` (m-1,) seconds after each step.
    """

    time: FloatArray
    sample: IntArray
    interval: IntArray
    share: FloatArray
    start: FloatArray
    end: FloatArray


def sampled_nodes(time: FloatArray) -> NoiseNodes:
    """No nodes inside: the noise of an interval enters as a whole at its end, as in filterpy.

    Examples
    --------
    >>> sampled_nodes(np.array([0.0, 0.1, 0.3])).end.round(12).tolist()
    [0.1, 0.2]
    """
    lengths = np.diff(time)
    count = np.arange(lengths.size)
    multiples = np.maximum(1.0, np.rint(lengths / _median(time)))
    return NoiseNodes(time, np.arange(time.size), count, multiples, np.zeros(lengths.size), lengths)


def continuous_nodes(time: FloatArray, inside: int, reach: float) -> NoiseNodes:
    """Nodes of the rule for what decays in every interval of a log.

    Parameters
    ----------
    time
        Times of the samples, shape (n,), s.
    inside
        Nodes inside an interval of median length; 0: its ends alone. A longer interval is cut where samples would be
        missing, in pieces that double away from its end.
    reach
        The fastest rate that decays times the median interval, see :func:`bondgraph.filter.decay_rule.decay_rule`.

    Examples
    --------
    >>> nodes = continuous_nodes(np.array([0.0, 1.0, 2.0]), 1, 0.0)
    >>> nodes.time.tolist(), nodes.sample.tolist(), nodes.end.round(3).tolist()
    ([0.0, 0.5, 1.0, 1.5, 2.0], [0, 2, 4], [0.667, 0.167, 0.667, 0.167])
    >>> continuous_nodes(np.array([0.0, 1.0, 2.0, 7.0]), 0, 0.0).time.tolist()
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    """
    lengths = np.diff(time)
    multiples = np.maximum(1, np.rint(lengths / _median(time))).astype(np.int64)
    kinds, kind = np.unique(multiples, return_inverse=True)
    tables = [interval_nodes(int(multiple), inside, reach) for multiple in kinds]
    hops = np.array([start.size for _, start, _ in tables], dtype=np.int64)
    counts = hops[kind]
    sample = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    interval = np.repeat(np.arange(counts.size), counts).astype(np.int64)
    # the row of every step in the tables of its kind of interval, laid one below the other
    row = np.arange(interval.size) - sample[interval] + (np.cumsum(hops) - hops)[kind][interval]

    def laid(parts: list[FloatArray]) -> FloatArray:
        return np.concatenate([np.zeros(0), *parts])[row]

    offset = laid([own[1:] for own, _, _ in tables])
    share = laid([np.diff(own) * multiple for multiple, (own, _, _) in zip(kinds, tables, strict=True)])
    start, end = laid([start for _, start, _ in tables]), laid([end for _, _, end in tables])
    nodes = np.concatenate([time[:1], time[interval] + offset * lengths[interval]])
    nodes[sample] = time
    return NoiseNodes(nodes, sample, interval, share, start * lengths[interval], end * lengths[interval])


def finer_nodes(nodes: NoiseNodes, time: FloatArray, pieces: int) -> NoiseNodes:
    """Nodes with further ones, at which no noise enters, where they cut every interval of a log in equal pieces.

    Examples
    --------
    >>> time = np.array([0.0, 1.0])
    >>> finer = finer_nodes(continuous_nodes(time, 1, 0.0), time, 4)
    >>> finer.time.tolist(), finer.end.round(3).tolist(), finer.share.tolist()
    ([0.0, 0.25, 0.5, 0.75, 1.0], [0.0, 0.667, 0.0, 0.167], [0.25, 0.25, 0.25, 0.25])
    """
    wanted = finer_times(time, pieces)
    own = np.clip(np.searchsorted(nodes.time, wanted), 1, nodes.time.size - 1)
    near = np.minimum(np.abs(wanted - nodes.time[own]), np.abs(wanted - nodes.time[own - 1]))
    added = wanted[near > _SAME_NODE * np.diff(time).min()]
    every = np.union1d(nodes.time, added)
    step = np.searchsorted(nodes.time, every[1:], side="left") - 1  # the step that each piece is a part of
    part = np.diff(every) / np.diff(nodes.time)[step]
    first, last = np.isin(every[:-1], nodes.time), np.isin(every[1:], nodes.time)
    return NoiseNodes(
        every, np.searchsorted(every, nodes.time[nodes.sample]), nodes.interval[step], nodes.share[step] * part,
        np.where(first, nodes.start[step], 0.0), np.where(last, nodes.end[step], 0.0),
    )  # fmt: skip


def interval_nodes(multiple: int, inside: int, reach: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes (m,) of an interval of so many medians as shares of it, and noise before and after each step (m-1,).

    Noise in shares of the interval's length; ``inside`` and ``reach`` as for :func:`continuous_nodes`. What two pieces
    leave at the node between them enters once, after the first.

    Examples
    --------
    >>> edges, before, after = interval_nodes(1, 1, 0.0)
    >>> edges.tolist(), before.round(3).tolist(), after.round(3).tolist()
    ([0.0, 0.5, 1.0], [0.167, 0.0], [0.667, 0.167])
    """
    edges, start, end = [0.0], [], []
    for piece in _pieces(multiple):
        alike = piece if reach == 0.0 and inside > 1 else 1  # what swings is followed as often as between samples
        before, weights = decay_rule(max(inside, 1 if piece > 1 else 0), reach * piece)
        length = piece / (alike * multiple)
        for _ in range(alike):
            edges += [edges[-1] + length * (1.0 - one) for one in before[-2::-1]]
            start += [weights[-1] * length] + [0.0] * (before.size - 2)
            end += [weight * length for weight in weights[-2::-1]]
    for node in range(1, len(start)):
        end[node - 1] += start[node]
        start[node] = 0.0
    return np.array(edges), np.array(start), np.array(end)


def _pieces(multiple: int) -> list[int]:
    """Lengths of the pieces of an interval of so many medians: 1, 1, 2, 4, ... from its end.

    Examples
    --------
    >>> _pieces(1), _pieces(2), _pieces(13)
    ([1], [1, 1], [5, 4, 2, 1, 1])
    """
    pieces, left, size = [1], multiple - 1, 1
    while left > 0:
        pieces.append(min(size, left))
        left -= pieces[-1]
        size *= 2
    return pieces[::-1]


def _median(time: FloatArray) -> float:
    """Length of the median interval; one where there is none."""
    return float(np.median(np.diff(time))) if time.size > 1 else 1.0
