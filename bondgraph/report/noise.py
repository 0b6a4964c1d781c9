"""What a report says of the noise that drives a model."""

from __future__ import annotations

from collections.abc import Collection

from bondgraph.filter.filter_model import FilterModel
from bondgraph.text import inflected


def noise_sentence(filter_model: FilterModel, idle: Collection[str] = ()) -> str:
    """Sentence on the states that process noise drives; ``idle`` are those whose noise rests on its least.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> noise_sentence(FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {}))
    'Process noise drives rate'
    >>> noise_sentence(FilterModel(pendulum(), {}, {"deflection": 0.05}, {}))
    'Process noise drives no state: the model is taken as exact'
    >>> noise_sentence(FilterModel(pendulum(), {"rate": 1e-9}, {"deflection": 0.05}, {}), ["rate"])
    'Process noise drives no state noticeably: rate has its noise on the lower bound'
    """
    driven = ", ".join(name for name in filter_model.process_noise if name not in idle)
    if idle:
        rests = f"{', '.join(idle)} {inflected(idle, 'has its', 'have their')} noise on the lower bound"
        return f"Process noise drives {driven + '; ' if driven else 'no state noticeably: '}{rests}"
    return f"Process noise drives {driven or 'no state: the model is taken as exact'}"
