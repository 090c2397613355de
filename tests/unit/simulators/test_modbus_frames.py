"""The double's own Modbus framing against frames and CRCs printed in the Modbus specifications and handbooks."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
import pytest

from simulators.modbus.frames import BrokenFrame, Mbap, ModbusFrame, PduRefused, Rtu, answer_pdu, crc16, has_valid_crc


class Block:
    """100 registers with what the specification's examples hold; the last ten cannot be written."""

    def __init__(self) -> None:
        self.words = dict.fromkeys(range(120), 0)
        self.words |= {0x6B: 0x022B, 0x6C: 0, 0x6D: 0x0064}

    def read(self, address: int, count: int) -> list[int]:
        if any(place not in self.words for place in range(address, address + count)):
            raise PduRefused(2)
        return [self.words[place] for place in range(address, address + count)]

    def write(self, address: int, values: Sequence[int]) -> None:
        if any(place not in range(110) for place in range(address, address + len(values))):
            raise PduRefused(2)
        self.words |= dict(enumerate(values, start=address))


def asked(text: str, block: Block | None = None) -> str:
    return answer_pdu(bytes.fromhex(text), block or Block()).hex(" ").upper()


# MODBUS Application Protocol V1.1b3: the examples of 6.3, 6.6 and 6.12.
@pytest.mark.parametrize(
    ("request_", "response"),
    [
        ("03 00 6B 00 03", "03 06 02 2B 00 00 00 64"),
        ("06 00 01 00 03", "06 00 01 00 03"),
        ("10 00 01 00 02 04 00 0A 01 02", "10 00 01 00 02"),
    ],
)
def test_the_examples_of_the_specification_are_answered_as_printed(request_: str, response: str) -> None:
    assert asked(request_) == response


def test_what_is_written_is_there() -> None:
    block = Block()
    asked("10 00 01 00 02 04 00 0A 01 02", block)
    asked("06 00 14 BE EF", block)
    assert [block.words[place] for place in (1, 2, 0x14)] == [10, 0x102, 0xBEEF]


@pytest.mark.parametrize(
    ("request_", "response"),
    [
        ("01 00 00 00 01", "81 01"),  # coils: not here
        ("2B 0E 01 00", "AB 01"),
        ("08 00 00 A5 37", "88 01"),
        ("03 00 78 00 01", "83 02"),  # beyond the last register
        ("03 00 77 00 02", "83 02"),
        ("03 FF FF 00 02", "83 02"),
        ("06 00 6E 00 01", "86 02"),  # read only
        ("10 00 6D 00 02 04 00 01 00 02", "90 02"),
        ("17 00 03 00 06 00 0E 00 03 06 00 FF 00 FF 00 FF", "97 01"),  # read/write together: not used
        ("03 00 00 00 00", "83 03"),  # quantity 0
        ("03 00 00 00 7E", "83 03"),  # 126
        ("03 00 00 00", "83 03"),  # too short
        ("03 00 00 00 01 00", "83 03"),  # too long
        ("06 00 01 00", "86 03"),
        ("10 00 01 00 00 00", "90 03"),
        ("10 00 01 00 02 03 00 0A 01", "90 03"),  # byte count against quantity
        ("10 00 01 00 02 04 00 0A 01", "90 03"),  # one byte missing
        ("10 00 01 00 02 04 00 0A 01 02 03", "90 03"),
        ("10 00 01", "90 03"),
        ("10 00 00 00 7C F8" + " 00" * 248, "90 03"),  # 124
    ],
)
def test_exceptions_are_those_of_the_standard(request_: str, response: str) -> None:
    block = Block()
    before = dict(block.words)
    assert asked(request_, block) == response
    assert block.words == before


def test_the_greatest_quantities_are_taken() -> None:
    class Wide(Block):
        def __init__(self) -> None:
            self.words = dict.fromkeys(range(200), 7)

        def write(self, address: int, values: Sequence[int]) -> None:
            self.words |= dict(enumerate(values, start=address))

    block = Wide()
    assert len(answer_pdu(bytes.fromhex("03 00 00 00 7D"), block)) == 2 + 250
    wide = struct.pack(">BHHB", 0x10, 0, 123, 246) + b"\x00\x09" * 123
    assert answer_pdu(wide, block) == bytes.fromhex("10 00 00 00 7B")
    assert {block.words[place] for place in range(123)} == {9}


# MODBUS over Serial Line V1.02, 6.2.2: 02 07 -> CRC 1241, sent 41 12; the others stand in most handbooks.
RTU_FRAMES = (
    "02 07 41 12",
    "01 03 00 00 00 0A C5 CD",
    "11 03 00 6B 00 03 76 87",
    "11 03 06 AE 41 56 52 43 40 49 AD",
    "11 06 00 01 00 03 9A 9B",
    "11 10 00 01 00 02 04 00 0A 01 02 C6 F0",
    "11 10 00 01 00 02 12 98",
    "0A 81 02 B0 53",
)


@pytest.mark.parametrize("text", RTU_FRAMES)
def test_crc_of_known_frames(text: str) -> None:
    frame = bytes.fromhex(text)
    assert crc16(frame[:-2]) == int.from_bytes(frame[-2:], "little")
    assert has_valid_crc(frame)
    for bit in range(8 * len(frame)):
        bent = bytearray(frame)
        bent[bit // 8] ^= 1 << bit % 8
        assert not has_valid_crc(bytes(bent))


def test_crc_of_the_usual_check_word() -> None:
    assert crc16(b"123456789") == 0x4B37


def test_an_rtu_answer_as_printed() -> None:
    assert Rtu().wrap(ModbusFrame(0x11, bytes.fromhex("10 00 01 00 02"))).hex(" ").upper() == "11 10 00 01 00 02 12 98"
    assert Rtu().wrap(ModbusFrame(0x0A, bytes.fromhex("81 02"))).hex(" ").upper() == "0A 81 02 B0 53"


REQUESTS = (
    bytes.fromhex("11 03 00 6B 00 03 76 87"),
    bytes.fromhex("11 10 00 01 00 02 04 00 0A 01 02 C6 F0"),
    bytes.fromhex("11 06 00 01 00 03 9A 9B"),
)


@pytest.mark.parametrize("seed", range(8))
def test_rtu_requests_are_found_however_they_are_cut_and_dirtied(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stream = b"".join(REQUESTS) * 3
    cuts = np.unique(rng.integers(1, len(stream), 12)).tolist()
    framing, found = Rtu(), []
    for first, last in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += framing.feed(stream[first:last], 0.0)
    assert [frame.pdu for frame in found] == [request[1:-2] for request in REQUESTS] * 3
    assert {frame.unit for frame in found} == {0x11}


def test_rtu_answers_no_bent_frame_and_finds_the_next() -> None:
    framing = Rtu()
    bent = bytearray(REQUESTS[0])
    bent[3] ^= 4
    assert framing.feed(bytes(bent) + REQUESTS[2], 0.0) == [ModbusFrame(0x11, REQUESTS[2][1:-2])]
    assert framing.feed(b"\xff\x00\x99" + REQUESTS[0], 0.1) == [ModbusFrame(0x11, REQUESTS[0][1:-2])]


def test_rtu_forgets_what_stays_incomplete() -> None:
    framing = Rtu(gap_s=0.5)
    assert framing.feed(bytes.fromhex("11 10 00 01 00 7B F6 00"), 0.0) == []
    assert framing.feed(REQUESTS[0], 0.4) == []  # still taken for its data
    assert framing.feed(REQUESTS[0], 2.0) == [ModbusFrame(0x11, REQUESTS[0][1:-2])]


def test_rtu_takes_a_foreign_function_for_what_it_is() -> None:
    diagnosis = bytes.fromhex("11 08 00 00 A5 37")
    whole = diagnosis + crc16(diagnosis).to_bytes(2, "little")
    (frame,) = Rtu().feed(whole, 0.0)
    assert asked(frame.pdu.hex()) == "88 01"


def test_mbap_frames_as_the_guide_lays_them_out() -> None:
    first = bytes.fromhex("15 01 00 00 00 06 FF 03 00 04 00 01")
    second = bytes.fromhex("15 02 00 00 00 06 01 06 00 01 00 03")
    framing, found = Mbap(), []
    for byte in first + second:
        found += framing.feed(bytes((byte,)), 0.0)
    assert found == [ModbusFrame(0xFF, first[7:], 0x1501), ModbusFrame(1, second[7:], 0x1502)]
    assert framing.wrap(ModbusFrame(0xFF, bytes.fromhex("03 02 00 05"), 0x1501)) == bytes.fromhex(
        "15 01 00 00 00 05 FF 03 02 00 05"
    )


@pytest.mark.parametrize("header", ["00 01 00 01 00 06 01 03", "00 01 00 00 00 01 01 03", "00 01 00 00 01 00 01 03"])
def test_mbap_gives_a_useless_stream_up(header: str) -> None:
    with pytest.raises(BrokenFrame):
        Mbap().feed(bytes.fromhex(header), 0.0)
