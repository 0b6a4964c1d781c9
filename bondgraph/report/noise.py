"""What a report says of the noise that drives a model."""

from __future__ import annotations

from bondgraph.filter.filter_model import FilterModel


def noise_sentence(filter_model: FilterModel) -> str:
    """Which states process noise drives, as a sentence.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> noise_sentence(FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {}))
    'Process noise drives rate'
    >>> noise_sentence(FilterModel(pendulum(), {}, {"deflection": 0.05}, {}))
    'Process noise drives no state: the model is taken as exact'
    """
    driven = ", ".join(filter_model.process_noise)
    return f"Process noise drives {driven or 'no state: the model is taken as exact'}"
