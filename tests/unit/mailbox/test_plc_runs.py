"""The functions of docs/plc, run: numbers and CRC as the codec has them, the checks of a command as the double's."""

from __future__ import annotations

import random
import zlib
from dataclasses import dataclass
from typing import Any

import pytest

from simulators.modbus import registers as r
from simulators.modbus.registers import (
    BACKLASH_KIND,
    CEC,
    EEC,
    RANGE,
    UNKNOWN,
    PlcCommand,
    PlcFault,
    ProcessImage,
    TableAddress,
)
from simulators.modbus.state import CommandChecks
from tests.unit.mailbox.plant import library

PLC = library()
COUNT = 1000
AXES, TABLES = (1, 2, 4), 4
AXIS_MAP = 0b1011


@dataclass
class Plant:
    """As much of a control as the checks of a command's parameters ask for."""

    tables: int = TABLES

    def axis(self, number: int) -> None:
        """Raises PlcFault (9)."""
        if number not in AXES:
            raise PlcFault(UNKNOWN)

    def check(self, target: TableAddress) -> None:
        """Raises PlcFault (9)."""
        self.axis(target.axis)
        known = range(self.tables) if target.kind == CEC else AXES
        if target.index not in known or target.encoder not in (0, 1):
            raise PlcFault(UNKNOWN)


@pytest.mark.parametrize("low_first", [False, True])
def test_double_words_and_crc(low_first: bool) -> None:
    chance = random.Random(3)
    words = [chance.randrange(0x10000) for _ in range(388)]
    assert PLC.call("TF_Crc32", {"Seed": 0, "First": 16, "Count": 18, "R": words}) == r.crc_of(words[16:34])
    begun = PLC.call("TF_Crc32", {"Seed": 0, "First": 16, "Count": 18, "R": words})
    assert PLC.call("TF_Crc32", {"Seed": begun, "First": 36, "Count": 100, "R": words}) == r.crc_of(
        [*words[16:34], *words[36:136]]
    )
    nine = [0x3132, 0x3334, 0x3536, 0x3738]
    assert PLC.call("TF_Crc32", {"Seed": 0, "First": 0, "Count": 4, "R": nine}) == zlib.crc32(b"12345678")
    for value in (0, 1, -1, 123456789, r.DINT_LOW, r.DINT_HIGH):
        unsigned = value & 0xFFFFFFFF
        PLC.call("TF_PutDouble", {"Address": 7, "Value": unsigned, "LowFirst": low_first, "R": words})
        assert tuple(words[7:9]) == r.dint_words(value, low_first)
        assert PLC.call("TF_GetDouble", {"Address": 7, "LowFirst": low_first, "R": words}) == unsigned
        assert PLC.call("TF_Signed", {"High": words[7], "Low": words[8], "LowFirst": low_first}) == value


def command_of(chance: random.Random, low_first: bool) -> tuple[list[int], PlcCommand]:
    """PlcCommand 2 with sound parameters, of which one or two are then anything."""
    image, kind = ProcessImage(low_first), chance.choice((EEC, CEC, BACKLASH_KIND))
    low, step, total = chance.randrange(-5_000_000, 5_000_000), chance.randrange(1, 200_000), chance.randrange(2, 60)
    cross = kind == CEC
    index = chance.randrange(TABLES) if cross else chance.choice(AXES)
    words = [2, 1, kind, index, chance.randrange(2), chance.choice((0, 1, 3, 5, 9) if cross else (0, 1))]
    over = chance.choice((0, 0, step - 1, step, -1, chance.randrange(step)))
    if kind == BACKLASH_KIND:
        low, step, total, over, words[5] = 0, 0, 1, 0, 0
    for value in (low, step, low + step * (total - 1) + over):
        words += r.dint_words(value, low_first)
    words += [total, 0, 0, *((1, chance.choice(AXES), chance.randrange(TABLES + 1)) if cross else (0, 0, 0))]
    for _ in range(chance.randrange(3)):
        place = chance.choice((3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 15, 16, 17))
        words[place] = chance.choice((0, 1, 2, 3, 5, 6, 0x10, 0x7FFF, 0x8000, 0xFFFF))
    image.put(r.COMMAND, words)
    return words, PlcCommand.of(image)


def by_the_double(command: PlcCommand) -> tuple[int, int]:
    """The error code and detail that the double gives for these parameters."""
    checks = CommandChecks(None, Plant())  # type: ignore[arg-type]
    try:
        checks.check_parameters(command, checks.target(command, (EEC, CEC, BACKLASH_KIND)))
    except PlcFault as fault:
        return int(fault.code), fault.detail
    return 0, 0


def _signed(word: int) -> int:
    """What WORD_TO_INT makes of a word."""
    return word - 0x10000 if word > 0x7FFF else word


def by_the_text(words: list[int], low_first: bool) -> tuple[int, int]:
    """The same by the structured text, as step 1 of the mailbox asks."""
    known: dict[str, Any] = {"AxisMap": AXIS_MAP, "Tables": TABLES}
    axis = words[16] if words[2] == CEC else words[3]
    named = {"Kind": words[2], "Index": _signed(words[3]), "Encoder": words[4], "Axis": _signed(axis)}
    if not PLC.call("TF_TableExists", {**named, **known}):
        return UNKNOWN, 0
    fault = PLC.call("TF_ParametersFault", {**known, "Taken": words, "LowFirst": low_first})
    return (UNKNOWN, 0) if fault == -1 else (RANGE if fault else 0, fault)


@pytest.mark.parametrize("low_first", [False, True])
def test_random_parameters_get_the_same_code_from_the_text_and_from_the_double(low_first: bool) -> None:
    chance, codes = random.Random(f"plc-{low_first}"), []
    for _ in range(COUNT // 2):
        words, command = command_of(chance, low_first)
        wanted = by_the_double(command)
        assert by_the_text(words, low_first) == wanted, words
        codes.append(wanted[0])
    assert min(codes.count(code) for code in (0, RANGE, UNKNOWN)) > COUNT // 50
