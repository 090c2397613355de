"""How a table is cut into the chunks that read it, twice."""

from __future__ import annotations

import pytest

from drivers.sinumerik.mailbox.codec.registers import CHUNK_POINTS
from drivers.sinumerik.mailbox.reader import chunk_spans


@pytest.mark.parametrize("reserved", [0, 1, 2, 49, 50, 51, 75, 76, 100, 121, 801, 5000])
@pytest.mark.parametrize("cut", [False, True])
def test_chunks_cover_every_point_once(reserved: int, cut: bool) -> None:
    chunks = chunk_spans(reserved, cut=cut)
    assert [point for first, count in chunks for point in range(first, first + count)] == list(range(reserved))
    assert all(1 <= count <= CHUNK_POINTS for _first, count in chunks)


@pytest.mark.parametrize("reserved", [51, 75, 76, 100, 121, 801])
def test_the_second_reading_begins_its_chunks_elsewhere(reserved: int) -> None:
    plain, cut = (dict(chunk_spans(reserved, cut=one)) for one in (False, True))
    assert set(plain) & set(cut) == {0}
