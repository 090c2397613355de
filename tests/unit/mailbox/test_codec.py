"""The mailbox codec: numbers, CRC, both word orders, chunks, and the worked exchange of the document."""

from __future__ import annotations

import re
import struct
import zlib
from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import Gap, RemoteProtocolError, TableError, UnsupportedDevice, ValueOutOfRange
from drivers.sinumerik.mailbox.codec import frames, grids, registers
from drivers.sinumerik.mailbox.codec.frames import MailboxOrder, check_map, encode_command
from drivers.sinumerik.mailbox.codec.grids import MailboxAxis
from drivers.sinumerik.mailbox.codec.registers import ADDRESS, Command, Kind, StatusBit
from drivers.sinumerik.mailbox.wire import ModbusCodec, Question
from drivers.types.tables import CompensationTable

ROOT = Path(__file__).parents[3]
DOCUMENT = (ROOT / "docs" / "plc-mailbox-reference.md").read_text(encoding="utf-8")
ORDERS = ("high-first", "low-first")
DINT = st.integers(-(2**31), 2**31 - 1)
WORD = st.integers(0, 0xFFFF)
AXES = {"X1": MailboxAxis(1, "X1", "mm", False), "C1": MailboxAxis(4, "C1", "deg", True)}


# ---- numbers -------------------------------------------------------------------------------------------


@given(DINT, st.sampled_from(ORDERS))
def test_a_number_survives_its_registers(value: int, order: registers.WordOrder) -> None:
    assert registers.unpack_dint(registers.pack_dint(value, order), order) == value
    assert struct.unpack(">i", registers.wire_bytes(registers.pack_dint(value, "high-first")))[0] == value
    assert registers.pack_dint(value, "low-first") == registers.pack_dint(value, "high-first")[::-1]


@pytest.mark.parametrize("value", [2**31, -(2**31) - 1, 10**12])
def test_a_number_that_does_not_fit_is_refused(value: int) -> None:
    with pytest.raises(OverflowError):
        registers.pack_dint(value, "high-first")


@given(st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=16))
def test_text_survives(text: str) -> None:
    assert registers.unpack_text(registers.pack_text(text, 8)) == text


def test_text_that_is_no_ascii_is_none() -> None:
    assert registers.unpack_text([0x4142, 0x0741]) is None
    assert registers.unpack_text([0x41FF]) is None


def test_the_crc_is_the_one_of_the_document() -> None:
    assert zlib.crc32(b"123456789") == 0xCBF43926
    sent = struct.unpack(">4H", b"12345678")
    assert registers.crc32(sent[:1], sent[1:]) == zlib.crc32(b"12345678")


# ---- commands ------------------------------------------------------------------------------------------

ORDER = st.builds(
    MailboxOrder,
    st.sampled_from(Command),
    st.sampled_from(Kind),
    *[WORD] * 3,
    *[DINT] * 3,
    *[WORD] * 6,
)


@settings(max_examples=200)
@given(ORDER, st.integers(1, 65535), st.sampled_from(ORDERS), st.lists(WORD, max_size=100), st.lists(WORD, max_size=20))
def test_a_command_survives_and_every_flipped_bit_is_noticed(
    order: MailboxOrder, count: int, word_order: registers.WordOrder, data: list[int], whole: list[int]
) -> None:
    covered = whole if order.command is Command.VERIFY else []
    frame = encode_command(order, count, word_order, data, covered)
    found = frames.decode_command(frame.header, word_order, frame.data, covered)
    assert (found.order, found.count, found.sound) == (order, count, True)
    assert len(frame.header) == 20
    assert len(frame.data) == (100 if order.command in frames.WITH_DATA else 0)
    place = count % (18 + len(frame.data))
    bent = [*frame.header, *frame.data]
    at = place if place < 18 else place + 2
    bent[at] ^= 1 << count % 16
    if at not in (0, 2):  # another command or kind may not exist at all
        assert not frames.decode_command(bent[:20], word_order, bent[20:], covered).sound


def test_801_points_are_17_chunks_that_split_no_value() -> None:
    values = list(range(-400, 401))
    found = frames.value_chunks(values, "high-first")
    assert len(found) == 17
    assert [count for _, count, _ in found] == [50] * 16 + [1]
    assert [first for first, _, _ in found] == list(range(0, 801, 50))
    joined = [register for _, _, data in found for register in data]
    assert list(registers.unpack_dints(joined, "high-first")) == values


@given(st.integers(1, 300))
def test_chunks_hold_every_value_once(count: int) -> None:
    found = frames.value_chunks(list(range(count)), "low-first")
    values = [value for _, _, data in found for value in registers.unpack_dints(data, "low-first")]
    assert values == list(range(count))
    assert all(len(data) == 2 * points <= 100 for _, points, data in found)


def test_numbers_go_round_past_65535_without_zero() -> None:
    assert frames.next_number(65535) == 1
    assert frames.next_number(0) == 1


@pytest.mark.parametrize("field", ["index", "total", "multiply_by"])
def test_a_register_that_overflows_is_refused(field: str) -> None:
    with pytest.raises(OverflowError):
        encode_command(MailboxOrder(Command.BEGIN, **{field: 0x10000}), 1, "high-first")  # type: ignore[arg-type]


# ---- tables --------------------------------------------------------------------------------------------


def table(**changes: object) -> CompensationTable:
    given: dict[str, object] = {"minimum": 0.0, "maximum": 20.0, "step": 10.0, "deviations": (0.0, 3.0, -1.5)}
    return CompensationTable("axis", "X1", "X1", **{**given, **changes})  # type: ignore[arg-type]


def test_a_table_becomes_whole_numbers() -> None:
    order = grids.begin_order(table(), 3, AXES)
    assert (order.minimum, order.step, order.maximum, order.total, order.index) == (0, 100_000, 200_000, 3, 1)
    values = grids.numbers_of(table(), [Decimal("0"), Decimal("0.003"), Decimal("-0.0015")], AXES["X1"])
    assert values == (0, 3000, -1500)


@pytest.mark.parametrize("step", [10.00005, 20.0 / 3.0])
def test_a_step_the_map_cannot_say_is_refused_never_rounded(step: float) -> None:
    with pytest.raises(ValueOutOfRange) as caught:
        grids.begin_order(table(step=step, maximum=2 * step), 3, AXES)
    assert caught.value.code == "E-MBX-FRACTION"


def test_a_step_that_does_not_divide_the_range_counts_as_the_control_counts() -> None:
    assert grids.begin_order(table(maximum=25.0), 3, AXES).maximum == 250_000
    for maximum in (30.0, 19.0):
        with pytest.raises(Gap):
            grids.begin_order(table(maximum=maximum), 3, AXES)


@pytest.mark.parametrize("value", ["0.0000005", "2147.5", "-2148"])
def test_a_value_the_map_cannot_say_is_refused(value: str) -> None:
    with pytest.raises(ValueOutOfRange):
        grids.numbers_of(table(), [Decimal(value)], AXES["X1"])


def test_an_eec_table_has_neither_direction_nor_type() -> None:
    with pytest.raises(TableError) as caught:
        grids.begin_order(table(direction=1), 3, AXES)
    assert caught.value.code == "E-MBX-KIND"


@pytest.mark.parametrize(("direction", "flags"), [(0, 0), (1, 2), (-1, 4)])
def test_directions_of_cec_tables(direction: int, flags: int) -> None:
    cross = CompensationTable(
        "cross", "C1", "X1", 0.0, 360.0, 180.0, (0.0, 1.0, 0.0), True, 3, "deg", "mm", direction, 2, 1
    )  # type: ignore[arg-type]
    order = grids.begin_order(cross, 3, AXES)
    assert order.flags == flags | 1 | 8
    assert (order.kind, order.index, order.input_axis, order.output_axis) == (Kind.CEC, 3, 4, 1)
    assert (order.maximum, order.step, order.multiply_by) == (360_000_000, 180_000_000, 2)


# ---- what the PLC shows --------------------------------------------------------------------------------


def test_a_status_as_the_document_shows_it() -> None:
    registers = [0x4743, 2, 0x1234, 0x5678, 0x0319, 0x08F5, 0x30, 0, 0, 0, 0x321, 0, 0xFAA9, 0xCA40, 0x2A17]
    status = frames.decode_status(registers, "high-first")
    assert (status.number, status.reserved, status.crc, status.session) == (48, 801, 0xFAA9CA40, 0x2A17)
    assert status.has(StatusBit.DONE, StatusBit.WRITABLE, StatusBit.RELEASED)
    assert not status.has(StatusBit.BUSY)
    assert frames.decode_status([*registers[:8], 0x1111, 0x0002, *registers[10:]], "low-first").detail == 0x21111


@pytest.mark.parametrize(
    ("register", "value"), [("SELECTED_KIND", 5), ("MARKER_STATE", 4), ("LIVE_FLAGS", 6), ("AXIS_COUNT", 32)]
)
def test_a_register_the_map_does_not_allow_is_refused(register: str, value: int) -> None:
    registers = [0] * 86
    frames.decode_picture(registers, "high-first")
    registers[ADDRESS[register] - 302] = value
    with pytest.raises(RemoteProtocolError) as caught:
        frames.decode_picture(registers, "high-first", "grinder")
    assert str(ADDRESS[register]) in str(caught.value)


@pytest.mark.parametrize(
    ("registers", "order", "code", "hint"),
    [
        ((0x4743, 3, 0x5678, 0x1234), "high-first", "E-MBX-WORD-ORDER", 'word_order = "low-first"'),
        ((0x4743, 3, 0x1234, 0x5678), "low-first", "E-MBX-WORD-ORDER", 'word_order = "high-first"'),
        ((0x4347, 0x0200, 0x3412, 0x7856), "high-first", "E-MBX-MAGIC", "bytes are swapped"),
        ((0x4347, 0x0200, 0x7856, 0x3412), "high-first", "E-MBX-MAGIC", "bytes are swapped"),
        ((2, 0x1234, 0x5678, 0), "high-first", "E-MBX-MAGIC", "shifted by one register"),
        ((0, 0x4743, 2, 0x1234), "high-first", "E-MBX-MAGIC", "shifted by one register"),
        ((0x4743, 2, 0, 0), "high-first", "E-MBX-MAGIC", "no mailbox"),
        ((0, 0, 0, 0), "high-first", "E-MBX-MAGIC", "no mailbox"),
        ((0x4743, 1, 0x1234, 0x5678), "high-first", "E-MBX-OLD-MAP", "map version 1"),
        ((0x4743, 2, 0x1234, 0x5678), "high-first", "E-MBX-OLD-MAP", "can be replayed"),
        ((0x4743, 4, 0x1234, 0x5678), "high-first", "E-MBX-VERSION", "map version 4"),
    ],
)
def test_a_wrong_map_is_refused_and_says_what_would_be_right(
    registers: tuple[int, ...], order: registers.WordOrder, code: str, hint: str
) -> None:
    with pytest.raises(UnsupportedDevice) as caught:
        check_map(registers, order, "grinder")
    assert caught.value.code == code
    assert hint in str(caught.value)


# ---- the worked exchange -------------------------------------------------------------------------------


def _exchange() -> list[tuple[str, int, tuple[int, ...]]]:
    """("write" or "read", first register, registers) of section 7, line groups joined."""
    block = DOCUMENT.split("## 7. A worked exchange")[1].split("```")[1]
    found: list[tuple[str, int, tuple[int, ...]]] = []
    for line in block.splitlines():
        match = re.fullmatch(r"(write|read|)\s+(\d+): ((?:[0-9A-F]{4} ?)+)", line)
        if match is None:
            continue
        values = tuple(int(word, 16) for word in match[3].split())
        if match[1]:
            found.append((match[1], int(match[2]), values))
        else:
            way, first, before = found.pop()
            assert first + len(before) == int(match[2])
            found.append((way, first, before + values))
    return found


def _sent() -> list[tuple[str, int, tuple[int, ...]]]:
    """The same exchange from the codec."""
    x1 = grids.naming_order(table(), AXES)
    begin = grids.begin_order(table(), 3, AXES)
    values = registers.pack_dints((0, 3000, -1500), "high-first")
    orders: list[tuple[MailboxOrder, tuple[int, ...], tuple[int, ...]]] = [
        (MailboxOrder(Command.OPEN, index=0x2A17), (), ()),
        (x1, (), ()),
        (MailboxOrder(Command.MARKER), frames.marker_data("17", 1, 0x3A7BD3E2360A3D29), ()),
        (*frames.switching_command(Command.DISABLE, [x1]), ()),
        (begin, (), ()),
        (begin.as_command(Command.CHUNK, 0, 3), values, ()),
        (begin.as_command(Command.VERIFY), (), values),
        (x1.as_command(Command.READ_BACK, 0, 50), (), ()),
        (*frames.switching_command(Command.ACTIVATE, [x1]), ()),
        (MailboxOrder(Command.CLOSE), (), ()),
    ]
    out: list[tuple[str, int, tuple[int, ...]]] = []
    for count, (order, data, whole) in enumerate(orders, start=42):
        frame = encode_command(order, count, "high-first", data, whole)
        out += [("write", 36, frame.data)] if frame.data else []
        out.append(("write", 16, frame.header))
    return out


def test_the_codec_writes_the_worked_exchange_of_the_document() -> None:
    assert [step for step in _exchange() if step[0] == "write"] == _sent()


def test_the_codec_reads_the_worked_exchange_of_the_document() -> None:
    reads = {first: registers for way, first, registers in _exchange() if way == "read"}
    header = next(registers for _, first, registers in reversed(_sent()) if first == 16 and registers[0] == 7)
    values = frames.decode_read_back(reads[200], header, 50, "high-first")
    assert values is not None
    assert values[:4] == (0, 3000, -1500, 0)
    assert len(values) == 50
    bent = (*reads[200][:3], reads[200][3] ^ 1, *reads[200][4:])
    assert frames.decode_read_back(bent, header, 50, "high-first") is None
    other = (*header[:1], header[1] + 1, *header[2:])
    assert frames.decode_read_back(reads[200], other, 50, "high-first") is None


@pytest.mark.parametrize("framer", ["tcp", "rtu"])
def test_whole_frames_of_the_document(framer: str) -> None:
    block = DOCUMENT.split("## 7. A worked exchange")[1].split("```")[3]
    joined = re.sub(r"\n +", " ", block)
    lines = {line[:5]: bytes.fromhex(line[6:]) for line in joined.strip().splitlines()}
    codec = ModbusCodec(1, framer)
    codec._transaction = 6
    header = next(registers for _, first, registers in _sent() if first == 16)
    assert codec.send(Question(16, 16, 20, header)) == lines[f"{framer} >"]
    (reply,) = codec.receive(lines[f"{framer} <"])
    assert (reply.problem, reply.exception) == ("", None)
