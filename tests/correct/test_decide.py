"""The scatter of coefficients: how many blocks of time tell it, and what a test makes of few."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.correct.constants import BLOCKS
from bondgraph.correct.evidence.decide import channel_shares, effective_blocks, robust_p_value
from bondgraph.data.log import MatchedLog
from tests.correct.sled import fitted, pull, sled

LOG = pull(sled(), 4)
#: Measured in the first tenth of its time, and the last sample.
SHORT = replace(LOG, y=np.where((LOG.time < 0.1 * LOG.time[-1]) | (LOG.time == LOG.time[-1]), LOG.y, np.nan))


def test_a_coefficient_that_few_blocks_show_rests_on_few() -> None:
    assert 0.3 * BLOCKS < effective_blocks(fitted([LOG]), ["c_guide"]) <= BLOCKS
    assert 1.0 <= effective_blocks(fitted([SHORT]), ["c_guide"]) <= 5.0


def test_what_is_held_rests_on_all_blocks_and_is_told_by_no_channel() -> None:
    base = fitted([pull(sled(), 3)])
    assert base.held[base.problem.names.index("process(v_sled)")]
    assert effective_blocks(base, ["process(v_sled)"]) == BLOCKS + 1  # the last sample begins one of its own
    assert channel_shares(base, ["process(v_sled)"]) == {"speed": 0.0, "force": 0.0}


def test_the_channels_that_tell_of_a_coefficient_share_it() -> None:
    shares = channel_shares(fitted([LOG]), ["c_guide"])
    assert sum(shares.values()) == pytest.approx(1.0)
    deaf = replace(LOG, y=np.where([[True], [False]], LOG.y, np.nan))
    assert channel_shares(fitted([deaf]), ["c_guide"])["speed"] == pytest.approx(1.0)


@pytest.mark.parametrize(("log", "least"), [(LOG, 0.0), (SHORT, 1e-9)], ids=["whole", "short"])
def test_fewer_blocks_make_a_test_more_careful(log: MatchedLog, least: float) -> None:
    base = fitted([log])
    even, uneven = (robust_p_value(base, ["c_guide"], uneven=one) for one in (False, True))
    assert even < uneven
    assert least <= uneven < least + 1e-6
