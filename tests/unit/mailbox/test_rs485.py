"""What an RS-485 adapter adds to a line: our own question, glued to the answer or not, and zero bytes before it."""

from __future__ import annotations

from typing import Any

import pytest
from pymodbus.framer import FramerRTU

from drivers.clock import run_virtual
from drivers.errors import TrueflankError, catalogue
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.sinumerik.mailbox.wire import READ, WRITE, WRITE_ONE, Adapter, ModbusCodec, ModbusReply, Question
from tests.contract.modbus_stage import on_stage

PLAIN = Adapter()
BOTH = Adapter(local_echo=True, leading_zeros=True)
ASKED = Question(READ, 4, 3)


def framed(*body: int) -> bytes:
    data = bytes(body)
    return data + FramerRTU.compute_CRC(data).to_bytes(2, "big")


ANSWERS = {
    ASKED: framed(1, 3, 6, 0, 7, 0, 8, 0, 9),
    Question(WRITE_ONE, 4, 1, (9,)): framed(1, 6, 0, 4, 0, 9),
    Question(WRITE, 4, 2, (9, 10)): framed(1, 16, 0, 4, 0, 2),
}


def replies(question: Question, adapter: Adapter, *pieces: bytes) -> list[ModbusReply]:
    """What a fresh codec makes of pieces; "own" stands for its own question."""
    codec = ModbusCodec(1, "rtu", adapter)
    own = codec.send(question)
    return [reply for piece in pieces for reply in codec.receive(piece.replace(b"own", own))]


@pytest.mark.parametrize("question", ANSWERS)
@pytest.mark.parametrize("cut", range(0, 9, 2))
def test_echo_and_zeros_are_passed_over_where_the_settings_say_so(question: Question, cut: int) -> None:
    answer = ANSWERS[question]
    own = ModbusCodec(1, "rtu").send(question)
    line = own + b"\0\0" + answer
    found = replies(question, BOTH, line[:cut], line[cut:])
    assert [(reply.problem, reply.exception) for reply in found] == [("", None)]
    assert found[0].registers == ((7, 8, 9) if question is ASKED else ())
    bytewise = replies(question, BOTH, *(line[place : place + 1] for place in range(len(line))))
    assert [reply.problem for reply in bytewise] == [""]


@pytest.mark.parametrize("question", [ASKED, Question(WRITE, 4, 2, (9, 10))])
@pytest.mark.parametrize("pieces", [(b"own",), (b"own", b"answer")])
def test_an_echo_that_nobody_expects_is_recognised_as_our_own_question(
    question: Question, pieces: tuple[bytes, ...]
) -> None:
    found = replies(question, PLAIN, *(piece.replace(b"answer", ANSWERS[question]) for piece in pieces))
    assert found[0].problem == "E-MODBUS-LOCAL-ECHO"


def test_echo_and_answer_glued_and_one_that_comes_byte_by_byte_are_told_too() -> None:
    assert replies(ASKED, PLAIN, b"own" + ANSWERS[ASKED])[0].problem == "E-MODBUS-LOCAL-ECHO"
    own = ModbusCodec(1, "rtu").send(ASKED)
    assert replies(ASKED, PLAIN, *(own[at : at + 1] for at in range(len(own))))[0].problem == "E-MODBUS-LOCAL-ECHO"
    one = Question(WRITE_ONE, 4, 1, (9,))
    assert replies(one, PLAIN, b"own" + ANSWERS[one])[0].problem == "E-MODBUS-LOCAL-ECHO"


@pytest.mark.parametrize("adapter", [PLAIN, BOTH])
@pytest.mark.parametrize("lost", [1, 2, 3])
def test_an_echo_without_its_first_or_last_bytes_is_no_other_device(adapter: Adapter, lost: int) -> None:
    """As of an adapter that switches over too late or early: the words name it, no other unit and no wrong length."""
    own, answer = ModbusCodec(1, "rtu").send(ASKED), ANSWERS[ASKED]
    for line in (own[1:], own[1:] + answer, own[:-lost] + answer):
        assert replies(ASKED, adapter, line)[0].problem == "E-MODBUS-LOCAL-ECHO"


def test_an_honest_line_is_read_as_before() -> None:
    for question, answer in ANSWERS.items():
        for cut in range(len(answer)):
            assert [one.problem for one in replies(question, PLAIN, answer[:cut], answer[cut:])] == [""]


def test_zero_bytes_are_the_adapters() -> None:
    assert replies(ASKED, PLAIN, b"\0\0" + ANSWERS[ASKED])[0].problem == "E-MODBUS-ZEROS"
    for code in ("E-MODBUS-ZEROS", "E-MODBUS-LOCAL-ECHO"):
        text = catalogue()[code]
        assert "adapter" in text["what"]
        assert "[controller.settings]" in text["do"]


@pytest.mark.parametrize("adapter", [PLAIN, Adapter(leading_zeros=True)])
@pytest.mark.parametrize("question", ANSWERS)
def test_a_whole_frame_of_unit_0_is_another_units(question: Question, adapter: Adapter) -> None:
    for frame in (framed(0, *ANSWERS[question][1:-2]), framed(0, 0x80 | question.function, 2)):
        for cut in range(len(frame)):
            assert [one.problem for one in replies(question, adapter, frame[:cut], frame[cut:])] == ["E-MODBUS-UNIT"]


@pytest.mark.parametrize("question", ANSWERS)
def test_one_zero_byte_before_an_answer_is_the_adapters_however_it_comes(question: Question) -> None:
    line = b"\0" + ANSWERS[question]
    for cut in range(len(line)):
        assert replies(question, PLAIN, line[:cut], line[cut:])[0].problem == "E-MODBUS-ZEROS"
        passed = replies(question, Adapter(leading_zeros=True), line[:cut], line[cut:])
        assert [one.problem for one in passed] == [""]


def test_the_settings_are_of_serial_lines() -> None:
    assert ModbusSettings.faults({"local_echo": True, "leading_zeros": True}) == ()
    assert [fault.key for fault in ModbusSettings.faults({"local_echo": True, "framer": "tcp"})] == ["local_echo"]


ADAPTER = {"local_echo": True, "leading_zeros": True}
LINES: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({"local_echo": True}, {}, "E-MODBUS-LOCAL-ECHO"),
    ({"local_echo": True, "leading_zeros": 2}, {}, "E-MODBUS-LOCAL-ECHO"),
    ({"leading_zeros": 2}, {}, "E-MODBUS-ZEROS"),
    ({"leading_zeros": 2}, {"local_echo": True}, "E-MODBUS-ZEROS"),
    ({"local_echo": True}, {"local_echo": True}, ""),
    ({"local_echo": True, "leading_zeros": 2}, ADAPTER, ""),
    ({"leading_zeros": 1}, {"leading_zeros": True}, ""),
    ({}, {"leading_zeros": True}, ""),
]


@pytest.mark.parametrize(("line", "settings", "code"), LINES)
def test_an_adapter_is_met_over_a_wire(line: dict[str, Any], settings: dict[str, Any], code: str) -> None:
    """The double's adapter against the driver, from the first question to a table: recognised, or passed over."""

    async def met() -> str:
        async with on_stage(opened=False, driver={"framer": "rtu", **settings}, framer="rtu", **line) as on:
            try:
                await on.device.open(5.0)
                assert (await on.device.identify()).axis_names == ("X1", "C1")
                assert (await on.device.saved_tables("X1")).own.table.output_axis == "X1"
            except TrueflankError as error:
                return error.code
            return ""

    assert run_virtual(met) == code
