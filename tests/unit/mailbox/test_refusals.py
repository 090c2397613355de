"""Every answer of the PLC has its own words, and registers full of nonsense give an error of ours or a record."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ConfigError, RemoteProtocolError, UnsupportedDevice
from drivers.sinumerik.mailbox.codec import frames
from drivers.sinumerik.mailbox.codec.frames import MailboxOrder, Status, check_map, command_refusal
from drivers.sinumerik.mailbox.codec.registers import Command, Kind, RefusalCode, StatusBit
from drivers.sinumerik.mailbox.reader import marker_of
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.sinumerik.mailbox.wire import ModbusCodec, Question

WORDS = st.integers(0, 0xFFFF)


def status(error: int, detail: int = 77) -> Status:
    return Status(0, StatusBit.ERROR, 5, error, detail, 0, 0, 0, 1)


@pytest.mark.parametrize("code", [one for one in RefusalCode if one is not RefusalCode.NONE])
def test_every_error_code_has_its_own_words(code: RefusalCode) -> None:
    error = command_refusal(status(code), MailboxOrder(Command.VERIFY, Kind.EEC, 1), "grinder")
    assert error.code.startswith("E-MBX-")
    assert "<" not in error.what
    assert error.hint
    others = [
        command_refusal(status(one), MailboxOrder(Command.VERIFY), "x").code
        for one in RefusalCode
        if one not in (code, 0)
    ]
    assert error.code not in others


@pytest.mark.parametrize("code", [0, 15, 99, 65535])
def test_a_code_the_map_does_not_know_is_a_protocol_error(code: int) -> None:
    error = command_refusal(status(code), MailboxOrder(Command.BEGIN), "grinder")
    assert isinstance(error, RemoteProtocolError)
    assert str(code) in error.what


@given(st.lists(WORDS, min_size=15, max_size=15))
def test_any_head_of_registers_is_refused_or_read(registers: list[int]) -> None:
    with contextlib.suppress(UnsupportedDevice):
        check_map(tuple(registers), "high-first", "grinder")
    found = frames.decode_status(registers, "low-first")
    assert found.heartbeat == registers[4]


@given(st.lists(st.one_of(st.integers(0, 3), WORDS), min_size=86, max_size=86))
def test_any_picture_is_refused_or_read(registers: list[int]) -> None:
    with contextlib.suppress(RemoteProtocolError):
        picture = frames.decode_picture(registers, "high-first", "grinder")
        assert picture.mode <= 255
        assert marker_of(picture, "grinder").transaction >= 0


@given(st.sampled_from(["tcp", "rtu"]), st.lists(st.binary(max_size=40), max_size=6))
def test_any_bytes_give_replies_and_never_an_exception(framer: str, pieces: list[bytes]) -> None:
    codec = ModbusCodec(1, framer)
    codec.send(Question(3, 0, 15))
    for piece in pieces:
        for reply in codec.receive(piece):
            assert reply.problem or reply.exception is not None or len(reply.registers) == 15


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("unit", 248),
        ("framer", "ascii"),
        ("word_order", "middle"),
        ("baudrate", 300),
        ("parity", "M"),
        ("reply_s", 0.0),
        ("poll_s", 0.1),
        ("fast_poll_s", 1.0),
        ("command_s", 1.0),
        ("encoder", 2),
        ("needs_reference", "yes"),
        ("colour", "red"),
    ],
)
def test_a_wrong_setting_is_refused(key: str, value: object) -> None:
    with pytest.raises(ConfigError) as caught:
        ModbusSettings.read({key: value}, "grinder")
    assert key in str(caught.value)


@pytest.mark.parametrize(
    ("url", "framer"),
    [
        ("tcp://10.0.0.1:502", "tcp"),
        ("memory://plc", "tcp"),
        ("socket://10.0.0.1:4001", "rtu"),
        ("COM5", "rtu"),
        ("/dev/ttyUSB0", "rtu"),
    ],
)
def test_the_framing_goes_with_the_wire_unless_it_is_set(url: str, framer: str) -> None:
    assert ModbusSettings().framing(url) == framer
    assert ModbusSettings(framer="rtu").framing(url) == "rtu"


def test_the_silence_between_serial_frames() -> None:
    assert ModbusSettings(baudrate=9600).gap_s == pytest.approx(3.5 * 11 / 9600)
    assert ModbusSettings(baudrate=115_200).gap_s == 0.00175
