"""The uMD codec against hand-written transcripts, cut and damaged in every way."""

from __future__ import annotations

import json
import random
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import LocalProtocolError
from drivers.umd.codec import SEQUENCE, UmdCodec, UmdLines, encode_rows, read_table

GOLDEN = json.loads((Path(__file__).parents[2] / "golden/umd/transcripts.json").read_text(encoding="utf-8"))
NAMES = sorted(GOLDEN)


def wire_of(name: str) -> bytes:
    return "".join(line + "\r\n" for line in GOLDEN[name]["wire"]).encode("ascii")


def received(pieces: list[bytes], *, join_late: bool = False) -> tuple[list[list[int]], list[str], int, int]:
    codec = UmdCodec("client", join_late=join_late)
    found = [lines for piece in pieces for lines in codec.receive(piece)]
    rows = [row for lines in found for row in lines.rows.tolist()]
    text = [line for lines in found for line in lines.text]
    return rows, text, sum(lines.damaged for lines in found), sum(lines.damaged_bytes for lines in found)


@pytest.mark.parametrize("name", NAMES)
def test_bytes_to_message(name: str) -> None:
    assert received([wire_of(name)]) == (GOLDEN[name]["rows"], GOLDEN[name]["text"], 0, 0)


@pytest.mark.parametrize("name", [name for name in NAMES if not GOLDEN[name]["text"]])
def test_message_to_bytes(name: str) -> None:
    rows = np.array(GOLDEN[name]["rows"], np.int64)
    assert UmdCodec("server").send(UmdLines(rows)) == wire_of(name)


def test_text_goes_before_the_rows() -> None:
    rows = np.array(GOLDEN["umd0 from switching on"]["rows"], np.int64)
    sent = UmdCodec("server").send(UmdLines(rows, ("", "Minimalist Homodyne Test:")))
    assert sent == wire_of("umd0 from switching on")


@pytest.mark.parametrize("name", NAMES)
def test_fault_01_every_single_and_double_cut_gives_the_same(name: str) -> None:
    wire = wire_of(name)
    whole = received([wire])
    for first in range(len(wire) + 1):
        assert received([wire[:first], wire[first:]]) == whole
        for second in range(first, len(wire) + 1, 7):
            assert received([wire[:first], wire[first:second], wire[second:]]) == whole


@pytest.mark.parametrize("ending", [b"\n", b"\r", b"\r\n", b"\r\r\n", b"\n\r", b"\r\r", b"\r\n\r\n"])
def test_fault_04_all_line_ends_mean_the_same(ending: bytes) -> None:
    wire = wire_of("umd2 one axis").replace(b"\r\n", ending)
    assert received([wire])[0] == GOLDEN["umd2 one axis"]["rows"]
    assert received([wire[at : at + 1] for at in range(len(wire))])[0] == GOLDEN["umd2 one axis"]["rows"]


@pytest.mark.parametrize(
    "line",
    [
        "0 0 1 0 0 7 0",
        "0 0 1 0 0 7 0 0 0",
        "0 0 +1 0 0 7 0 0",
        "0 0 1.0 0 0 7 0 0",
        "0 0 1,5 0 0 7 0 0",
        "0 0 1e3 0 0 7 0 0",
        "0 0 -0 0 0 7 0 0",
        "0 0 01 0 0 7 0 0",
        "0 0 --1 0 0 7 0 0",
        "0 0 1-1 0 0 7 0 0",
        "0 0 - 0 0 7 0 0",
        "0 0 nan 0 0 7 0 0",
        "0 0 inf 0 0 7 0 0",
        "0 0 4294967296 0 0 7 0 0",
        "0 0 " + "9" * 40 + " 0 0 7 0 0",
        "0 0 1 0 0 7 0 0\x00",
        "0 0 1\xff 0 0 7 0 0",
        "0 0 ١ 0 0 7 0 0",
        "banner in the middle",
    ],
)
def test_fault_17_what_is_no_line_is_counted_and_never_a_value(line: str) -> None:
    good = "0 0 1 0 0 6 0 0\r\n"
    raw = line.encode("utf-8") if not line.isascii() and "\xff" not in line else line.encode("latin-1")
    rows, text, damaged, size = received([good.encode() * 3 + raw + b"\r\n" + good.encode() * 3])
    assert len(rows) == 6
    assert all(row == [0, 0, 1, 0, 0, 6, 0, 0] for row in rows)
    assert (text, damaged, size) == ([], 1, len(raw))


def test_fault_15_a_client_that_joins_late_throws_the_torn_first_line_away() -> None:
    wire = wire_of("umd2 three axes")
    torn = wire[18:]
    assert received([torn])[2] + len(received([torn])[0]) == 2
    assert received([torn], join_late=True) == (GOLDEN["umd2 three axes"]["rows"][1:], [], 0, 0)


def test_fault_08_an_endless_line_is_bounded_and_counted_once() -> None:
    codec = UmdCodec("client")
    for _ in range(1000):
        assert codec.receive(b"7" * 10_000) == ()
    (lines,) = codec.receive(b"\r\n0 0 1 0 0 6 0 0\r\n")
    assert (lines.damaged, lines.damaged_bytes) == (1, 10_000_000)
    assert lines.rows.tolist() == [[0, 0, 1, 0, 0, 6, 0, 0]]
    assert len(codec._pending) == 0


def test_a_counter_that_is_exchanged_for_one_with_more_axes_is_read_again() -> None:
    wide = wire_of("umd2 three axes") * 10
    rows, _text, damaged, _size = received([wire_of("umd2 one axis") + wide])
    assert damaged == 8
    assert len(rows) == 5 + 20 - 8
    assert received([(wire_of("umd2 one axis") + wide)[at : at + 5] for at in range(0, 2000, 5)])[2] == 8


def clean_stream(count: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rows = np.zeros((count, 8), np.int64)
    rows[:, 3] = rng.integers(-50, 50, count)
    rows[:, 2] = np.cumsum(rows[:, 3])
    rows[:, SEQUENCE] = np.arange(count) + 4_000_000
    return rows


@given(st.integers(1, 200), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_fault_01_any_split_gives_the_same_samples_even_with_damage(count: int, chance: random.Random) -> None:
    wire = bytearray(encode_rows(clean_stream(count)))
    for _ in range(chance.randrange(8)):
        wire[chance.randrange(len(wire))] = chance.randrange(256)
    data = bytes(wire)
    whole = received([data])
    pieces, at = [], 0
    while at < len(data):
        step = chance.choice([1, 2, 3, 17, 200, 4096])
        pieces.append(data[at : at + step])
        at += step
    assert received(pieces) == whole


def test_fuzz_from_the_transcripts() -> None:
    """Mutated transcripts: every row that comes out is as a counter could have printed it, nothing raises."""
    chance = random.Random(20)
    base = b"".join(wire_of(name) for name in NAMES)
    for _ in range(3000):
        wire = bytearray(base)
        for _ in range(chance.randrange(1, 12)):
            at = chance.randrange(len(wire))
            match chance.randrange(4):
                case 0:
                    del wire[at : at + chance.randrange(1, 6)]
                case 1:
                    wire[at:at] = bytes(chance.choice(b"0123456789- \r\n\x00\xff!ab") for _ in range(3))
                case 2:
                    wire[at] ^= 1 << chance.randrange(8)
                case _:
                    wire[at:at] = wire[at : at + 40]
        rows, text, damaged, _size = received([bytes(wire)])
        assert all(len(row) in (8, 16) for row in rows)
        assert damaged >= 0
        assert all(line.isprintable() for line in text)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5])
def test_fault_03_noise_between_lines_never_becomes_a_value(share: float) -> None:
    chance = random.Random(3)
    rows = clean_stream(500)
    lines = encode_rows(rows).splitlines(keepends=True)
    noisy = []
    for line in lines:
        if chance.random() < share:
            # Bytes a counter never prints: what a wrong baud rate or a break leaves behind.
            noisy.append(bytes(chance.randrange(128, 256) for _ in range(chance.randrange(1, 30))) + b"\r\n")
        noisy.append(line)
    found, _text, damaged, _size = received([b"".join(noisy)])
    assert found == rows.tolist()
    assert damaged == len(noisy) - len(lines)


def test_clean_lines_need_every_rule() -> None:
    assert read_table(b"0 0 1 0 0 6 0 0\n", 8, SEQUENCE) is not None
    for text in (b"0 0 1 0 0 6 0\n0 0 1 0 0 6 0 0 0\n", b"0 0 1 0 0 6 0 0 ", b" 0 0 1 0 0 6 0\n", b"0  1 0 0 6 0 0\n"):
        assert read_table(text, 8, SEQUENCE) is None


def test_it_is_fast_enough_for_a_cell_at_a_hundred_times_the_speed() -> None:
    """Limits are about ten times what an idle core needs: 100 000 lines are one second of such a cell."""
    rows = clean_stream(100_000)
    start = perf_counter()
    wire = encode_rows(rows)
    encoded = perf_counter()
    (lines,) = UmdCodec("client").receive(wire)
    decoded = perf_counter()
    assert np.array_equal(lines.rows, rows)
    assert encoded - start < 1.0
    assert decoded - encoded < 1.0


def test_a_client_sends_nothing_and_a_server_nothing_illegal() -> None:
    with pytest.raises(LocalProtocolError, match="E-UMD-ROLE"):
        UmdCodec("client").send(UmdLines())
    for rows in (np.zeros((2, 9), np.int64), np.zeros((2, 8)), np.full((1, 8), 1 << 40, np.int64)):
        with pytest.raises(LocalProtocolError, match="E-UMD-ROWS"):
            UmdCodec("server").send(UmdLines(rows))  # type: ignore[arg-type]
    assert encode_rows(np.zeros((0, 8), np.int64)) == b""
