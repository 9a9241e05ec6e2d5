"""Malformed packets: a frame that was sent, or an error; never another frame, another exception, or no end."""

import numpy as np
import pytest
from phasespace_fuzz import FRAMES_A_STREAM, fuzz_driver


def test_a_few_thousand_frames_a_fifth_of_them_spoilt():
    sent, spoiled, read, refused = fuzz_driver(np.random.default_rng(14), 4000)

    assert sent >= 4000
    assert spoiled == pytest.approx(sent / 5, rel=0.2)
    assert refused > sent / FRAMES_A_STREAM / 4
    assert read > 0.2 * sent
