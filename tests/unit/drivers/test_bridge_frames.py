"""Binary frames of the bridge: exact bytes, every split, and damage that costs a gap and never a value."""

from __future__ import annotations

import random
import struct
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest

from drivers.bridge.codec import (
    HEADER_BYTES,
    MAGIC,
    PAYLOAD_BYTES,
    BridgeCodec,
    Damaged,
    Message,
    Notification,
    Reply,
    SampleFrame,
    encode_frame,
)
from drivers.bridge.device import BridgeStream
from drivers.bridge.records import BridgeIdentity, Event
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.types.sensing import SampleBlock
from tests.sizes import few

# Written by hand from docs/instrument-bridge.md section 5, not by the codec.
GOLDEN_HEAD = bytes.fromhex(
    "fa544653" "01" "00" "0100" "0500000000000000" "02000000" "03000000" "000000000000f83f" "000000000000e03f"
)  # fmt: skip
GOLDEN_PAYLOAD = bytes.fromhex("000000000000f03f00000000000000c0")
LINE = b'{"jsonrpc":"2.0","id":1,"result":{}}\n'


def golden() -> bytes:
    head = GOLDEN_HEAD + struct.pack("<I", crc32(GOLDEN_PAYLOAD))
    return head + struct.pack("<I", crc32(head)) + GOLDEN_PAYLOAD


def read(pieces: list[bytes]) -> list[Message]:
    codec = BridgeCodec("client")
    return [message for piece in pieces for message in codec.receive(piece)]


def stream_bytes(count: int = 6, samples: int = 5, channels: int = 2, *, lines: bool = True, start: int = 0) -> bytes:
    """Frames with known values, lines between them."""
    out = []
    for number in range(count):
        first = start + number * samples
        at = first + np.arange(samples)
        values = np.column_stack([at * 0.5 + channel for channel in range(channels)])
        out.append(encode_frame(SampleFrame(first, first * 0.01, 0.01, values)))
        if lines and number % 2:
            out.append(LINE)
    return b"".join(out)


def samples_of(messages: list[Message], channels: int = 2) -> tuple[np.ndarray, np.ndarray, int, int]:
    """(numbers, values, lost, damaged bytes) as a stream makes them of these messages."""
    names = tuple(f"c{channel}_um" for channel in range(channels))
    stream = BridgeStream(names, "x")
    blocks: list[SampleBlock] = []
    for message in messages:
        if isinstance(message, SampleFrame):
            block = stream.take_frame(message)
            if block is not None:
                blocks.append(block)
        elif isinstance(message, Damaged):
            stream.spoil(message.skipped)
    if not blocks:
        return np.empty(0), np.empty((0, channels)), 0, stream.damaged_bytes
    time_s = np.concatenate([block.time_s for block in blocks])
    values = np.concatenate([block.values for block in blocks])
    return np.rint(time_s * 100), values, sum(block.lost for block in blocks), stream.damaged_bytes


def test_the_bytes_are_those_of_the_page() -> None:
    (frame,) = read([golden()])
    assert isinstance(frame, SampleFrame)
    assert (frame.sequence, frame.t0_s, frame.dt_s, frame.lost, frame.valid) == (5, 1.5, 0.5, 3, True)
    assert frame.values.tolist() == [[1.0], [-2.0]]
    assert BridgeCodec("server").send(frame) == golden()
    assert len(golden()) == HEADER_BYTES + 16


def test_the_example_of_the_page_is_this_frame() -> None:
    page = (Path(__file__).parents[3] / "docs" / "instrument-bridge.md").read_text(encoding="utf-8")
    example = page.split("An example, one channel")[1].split("```")[1]
    assert bytes.fromhex("".join(example.split())) == golden()
    assert crc32(b"123456789") == 0xCBF43926


def test_a_frame_begins_with_a_byte_that_no_text_holds() -> None:
    with pytest.raises(UnicodeDecodeError):
        MAGIC[:1].decode("utf-8")
    assert MAGIC[0] >= 0xF5


def test_every_single_cut_and_single_bytes_give_the_same() -> None:
    data = stream_bytes()
    numbers, values, lost, damaged = samples_of(read([data]))
    assert numbers.tolist() == list(range(30))
    assert (lost, damaged) == (0, 0)
    others = [message for message in read([data]) if isinstance(message, Reply)]
    for cut in range(len(data) + 1):
        found = read([data[:cut], data[cut:]])
        assert np.array_equal(samples_of(found)[1], values)
        assert [message for message in found if isinstance(message, Reply)] == others
    drip = read([data[at : at + 1] for at in range(len(data))])
    assert np.array_equal(samples_of(drip)[1], values)


def test_neighbours_are_joined_and_others_are_not() -> None:
    assert len(read([stream_bytes(lines=False)])) == 1
    frames = [
        SampleFrame(0, 0.0, 0.01, np.zeros((4, 1))),
        SampleFrame(4, 0.04, 0.01, np.ones((4, 1))),
        SampleFrame(8, 0.08, 0.01, np.ones((4, 1)), valid=False),
        SampleFrame(13, 0.13, 0.01, np.ones((4, 1)), lost=1),
        SampleFrame(17, 0.18, 0.01, np.ones((4, 1))),
        SampleFrame(21, 0.22, 0.01, np.ones((3, 1))),
    ]
    found = read([b"".join(encode_frame(frame) for frame in frames)])
    assert [len(frame) for frame in found if isinstance(frame, SampleFrame)] == [8, 4, 4, 4, 3]


@pytest.mark.parametrize("seed", range(4))
def test_one_flipped_bit_anywhere_costs_its_frame_and_nothing_else(seed: int) -> None:
    chance = random.Random(seed)
    data = stream_bytes(lines=False)
    size = len(data) // 6
    _numbers, clean, _lost, _damaged = samples_of(read([data]))
    for _ in range(300):
        bent = bytearray(data)
        at = chance.randrange(len(data))
        bent[at] ^= 1 << chance.randrange(8)
        numbers, values, lost, damaged = samples_of(read([bytes(bent)]))
        kept = [number for number in range(30) if number // 5 != at // size]
        assert numbers.tolist() == kept
        assert np.array_equal(values, clean[kept])
        assert damaged == size
        assert lost == (5 if at // size < 5 else 0)


def test_missing_bytes_cost_their_frame_and_the_line_after_it_is_read() -> None:
    data = stream_bytes()
    for at in range(60, 120):
        found = read([data[:at] + data[at + 3 :]])
        assert samples_of(found)[0].tolist() == [n for n in range(30) if n // 5 != at // 128]
        assert sum(isinstance(message, Reply) for message in found) == 3


def test_values_that_are_not_finite_are_no_samples() -> None:
    payload = struct.pack("<dd", 1.0, float("nan"))
    head = GOLDEN_HEAD + struct.pack("<I", crc32(payload))
    bad = head + struct.pack("<I", crc32(head)) + payload
    found = read([bad + golden()])
    assert [type(message) for message in found] == [Damaged, SampleFrame]
    joined = stream_bytes(2, lines=False)
    assert len(read([joined + bad])) == 2


@pytest.mark.parametrize(
    ("offset", "value"), [(4, b"\x02"), (5, b"\x82"), (6, b"\x00\x00"), (16, b"\0\0\0\0"), (16, b"\xff\xff\xff\x7f")]
)
def test_a_header_that_no_bridge_of_this_page_writes_is_passed_over(offset: int, value: bytes) -> None:
    head = bytearray(golden()[: HEADER_BYTES - 4])
    head[offset : offset + len(value)] = value
    bad = bytes(head) + struct.pack("<I", crc32(head)) + GOLDEN_PAYLOAD
    assert [type(message) for message in read([bad + golden() + LINE])] == [Damaged, SampleFrame, Reply]


def test_what_no_frame_may_hold_is_not_written() -> None:
    for values in (np.empty((0, 1)), np.zeros(4), np.array([[np.inf]]), np.zeros((PAYLOAD_BYTES // 8 + 1, 1))):
        with pytest.raises(LocalProtocolError, match="E-BRIDGE-MESSAGE"):
            encode_frame(SampleFrame(0, 0.0, 0.1, values))
    for sequence, step in ((-1, 0.1), (0, 0.0), (0, float("nan"))):
        with pytest.raises(LocalProtocolError, match="E-BRIDGE-MESSAGE"):
            encode_frame(SampleFrame(sequence, 0.0, step, np.zeros((1, 1))))


def test_a_server_takes_no_frames() -> None:
    assert all(isinstance(message, Damaged) for message in BridgeCodec("server").receive(golden() + b"\n"))


def test_columns_come_in_the_order_of_the_port() -> None:
    who = BridgeIdentity(
        "rotary_calibrator", "E", "M", "1", "", ("device_deg", "laser_deg"), 10.0, sent=("laser_deg", "device_deg")
    )
    assert BridgeIdentity.read(who.as_object(), "x").order == (1, 0)
    stream = BridgeStream(who.channels, "x", who.order)
    block = stream.take_frame(SampleFrame(0, 0.0, 0.1, np.array([[1.0, 2.0]])))
    assert block is not None
    assert block.values.tolist() == [[2.0, 1.0]]


def test_another_number_of_channels_is_an_error() -> None:
    with pytest.raises(RemoteProtocolError, match="channels"):
        BridgeStream(("a_um",), "x").take_frame(SampleFrame(0, 0.0, 0.1, np.zeros((1, 2))))


def test_loss_is_the_larger_of_what_is_said_and_what_is_missing_and_damage_is_told() -> None:
    stream = BridgeStream(("a_um",), "x")
    late = stream.take_frame(SampleFrame(7, 0.7, 0.1, np.zeros((1, 1))))
    assert late is not None
    assert late.lost == 7
    stream.spoil(30)
    stream.note((Event("beam_obstructed", 1.05),))
    broken = stream.take_frame(SampleFrame(10, 1.0, 0.1, np.zeros((3, 1)), lost=4))
    assert broken is not None
    assert broken.lost == 4
    assert broken.valid.tolist() == [True, False, False]
    assert [*map(str, broken.events)] == ["30 damaged bytes", "beam_obstructed at 1.050000 s"]
    dark = stream.take_frame(SampleFrame(13, 1.3, 0.1, np.zeros((1, 1)), valid=False))
    assert dark is not None
    assert not dark.valid.any()
    assert dark.events == ()


def mutated(chance: random.Random, data: bytes) -> bytes:
    bent = bytearray(data)
    for _ in range(chance.randrange(1, 4)):
        at = chance.randrange(len(bent))
        match chance.randrange(5):
            case 0:
                del bent[at : at + chance.randrange(1, 30)]
            case 1:
                bent[at:at] = chance.choice([b"\n", MAGIC, b"{", b'{"', b"\xff", LINE, golden(), b"\0" * 9])
            case 2:
                bent[at] ^= 1 << chance.randrange(8)
            case 3:
                bent[at:at] = bent[at : at + 50]
            case _:
                bent[at : at + 8] = bent[-8:]
        bent = bent or bytearray(b"\n")
    return bytes(bent)


def try_mutations(count: int, seed: int) -> None:
    """Every sample that comes is one that was sent, at its own number; the rest is counted as damage or gap."""
    chance = random.Random(seed)
    data = stream_bytes(2, 2, 1, lines=False, start=10) + LINE
    sent = {number: number * 0.5 for number in range(10, 14)} | {5: 1.0, 6: -2.0}
    damaged = good = 0
    for _ in range(count // 20):
        for message in read([b"".join(mutated(chance, data) for _ in range(20))]):
            if isinstance(message, SampleFrame):
                good += 1
                assert message.values[:, 0].tolist() == [sent[message.sequence + at] for at in range(len(message))]
            elif isinstance(message, Damaged):
                damaged += 1
            else:
                assert isinstance(message, Reply | Notification)
    assert damaged > count // 4
    assert good > count // 4


@pytest.mark.parametrize("count", few([10_000, 100_000]))
def test_mutated_frames_never_give_a_value_that_was_not_sent(count: int) -> None:
    try_mutations(count, 11)


@pytest.mark.soak
def test_mutated_frames_never_give_a_value_that_was_not_sent_ten_times() -> None:
    for seed in range(10):
        try_mutations(100_000, 100 + seed)
