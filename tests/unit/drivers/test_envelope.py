"""The live picture of a long stream: bounded, and nothing high or low is left out of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.envelope import Envelope


@given(st.lists(st.integers(0, 700), min_size=1, max_size=12), st.integers(1, 5), st.integers(0, 2**32 - 1))
@settings(max_examples=80, deadline=None)
def test_the_picture_does_not_depend_on_how_the_stream_was_cut(sizes: list[int], width: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=sum(sizes))
    time_s = np.arange(len(values)) * 0.5
    whole, cut, at = Envelope(16, width), Envelope(16, width), 0
    whole.take(time_s, values)
    for size in sizes:
        cut.take(time_s[at : at + size], values[at : at + size])
        at += size
    for one, other in zip(whole.picture(), cut.picture(), strict=True):
        assert np.array_equal(one, other)
    begin, low, high = cut.picture()
    assert len(begin) <= 17
    assert cut.count == len(values)
    if len(values):
        assert (low.min(), high.max()) == (values.min(), values.max())
        edges = [*np.searchsorted(time_s, begin).tolist(), len(values)]
        assert all(high[k] == values[edges[k] : edges[k + 1]].max() for k in range(len(begin)))


def test_an_hour_keeps_its_size() -> None:
    picture = Envelope(64)
    for number in range(1000):
        picture.take(np.arange(1000) + 1000.0 * number, np.full(1000, float(number == 500)))
    assert len(picture.picture()[0]) <= 65
    assert picture.picture()[2].max() == 1.0
    assert picture.width == 16384


@pytest.mark.parametrize(("pieces", "width"), [(1, 1), (3, 1), (4, 0)])
def test_an_envelope_without_pieces_is_refused(pieces: int, width: int) -> None:
    with pytest.raises(ValueError, match="even"):
        Envelope(pieces, width)
