"""What of ours stands in a control is told from its channel, its words and the programs ever sent there."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.sinumerik.ncprogram.words import COUNT, Phase, Word, program_path
from drivers.sinumerik.opcua.program_dialogue import StatusSnapshot
from drivers.sinumerik.opcua.stale_programs import find_stale_program
from drivers.stale_programs import Sent
from drivers.types.machine import ChannelStatus

MEAS, PUSH, OTHER = program_path("MEAS", "X1"), program_path("PUSH", "X1"), "/_N_MPF_DIR/_N_GEAR_MPF"
BEFORE = (0.0,) * COUNT
OLDER = Sent(111111, MEAS, 80, BEFORE, open=False)
LAST = Sent(123456, MEAS, 80, BEFORE)


def seen(channel: ChannelStatus, **words: float) -> StatusSnapshot:
    values = [0.0] * COUNT
    for name, value in words.items():
        values[Word[name]] = value
    return StatusSnapshot(channel, "TRUEFLANK", tuple(values), (), True, True)


RESET, ACTIVE, STANDS = ChannelStatus.RESET, ChannelStatus.ACTIVE, ChannelStatus.INTERRUPTED
AT_STOP = {"TRANSACTION": 123456.0, "PHASE": float(Phase.MEASURING), "COUNTER": 3.0, "ECHO": 2.0}


@pytest.mark.parametrize(
    ("glance", "selected", "kind", "number"),
    [
        (seen(ACTIVE, **AT_STOP), MEAS, "waiting", 123456),
        (seen(ACTIVE, **{**AT_STOP, "ECHO": 3.0}), MEAS, "moving", 123456),
        (seen(ACTIVE, TRANSACTION=123456.0, PHASE=float(Phase.GRINDING), COUNTER=4.0), MEAS, "moving", 123456),
        (seen(ACTIVE, TRANSACTION=123456.0, PHASE=float(Phase.WAITING)), MEAS, "waiting", 123456),
        (seen(ACTIVE, TRANSACTION=123456.0, PHASE=float(Phase.WAITING), RELEASE=123456.0), MEAS, "moving", 123456),
        (seen(STANDS, **AT_STOP), MEAS, "stopped", 123456),
        (seen(ACTIVE), MEAS, "moving", 123456),
        (seen(RESET, **AT_STOP), MEAS, "words", 123456),
        (seen(RESET, **AT_STOP), OTHER, "words", 123456),
        (seen(ACTIVE, **AT_STOP), OTHER, "words", 123456),
        (seen(RESET, RELEASE=123456.0), MEAS, "selected", 123456),
        (seen(RESET), MEAS, "selected", 123456),
        (seen(RESET), OTHER, "nothing", 0),
        (seen(RESET, ABORT=1.0), OTHER, "words", 123456),
        (seen(RESET, TRANSACTION=999999.0, PHASE=6.0), OTHER, "nothing", 0),
        (seen(ACTIVE), OTHER, "nothing", 0),
        (seen(STANDS, TRANSACTION=999999.0), OTHER, "nothing", 0),
        (seen(RESET, TRANSACTION=111111.0), OTHER, "words", 111111),
    ],
)
def test_what_is_ours_by_number_or_name(glance: StatusSnapshot, selected: str, kind: str, number: int) -> None:
    left, sent = find_stale_program(glance, selected, (OLDER, LAST))
    assert (left.kind, left.number) == (kind, number)
    assert (sent is None) == (kind == "nothing")
    assert left.said.hint or left.clear


def test_after_all_was_given_back_a_selected_program_is_nobodys_left_over() -> None:
    left, _sent = find_stale_program(seen(RESET), MEAS, (OLDER, replace(LAST, open=False)))
    assert left.kind == "nothing"


def test_words_that_others_put_there_since_are_not_ours() -> None:
    left, _sent = find_stale_program(seen(RESET, LABEL=4.0, TARGET=1.5), OTHER, (LAST,))
    assert left.kind == "nothing"


def test_a_started_program_is_ours_by_its_name_though_all_was_given_back() -> None:
    left, sent = find_stale_program(seen(ACTIVE), PUSH, (LAST, replace(LAST, number=7, program=PUSH, open=False)))
    assert (left.kind, left.number) == ("moving", 7)
    assert sent is not None
