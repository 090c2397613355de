"""Files that our own programs wrote: believed when whole and of the very run, refused with line and reason else."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import FileFormatError
from drivers.sinumerik.ncprogram import backup, pushing
from drivers.sinumerik.ncprogram.backup import BackupFile, ReservedPoints, backup_text, read_backup
from drivers.sinumerik.ncprogram.measuring import MachineSetting
from drivers.sinumerik.ncprogram.words import Words
from drivers.sinumerik.tablefile.format import TableFiles
from drivers.sinumerik.tablefile.reader import read_tables_loosely
from drivers.types.orders import PushOrder
from drivers.types.tables import CompensationTable, LiveSet
from simulators.nck import AxisSpec, Nck, NckSpec
from tests import attacks

pytestmark = pytest.mark.attack
FAMILY = "lines of a saved file left out, doubled, exchanged, foreign; one alone, runs and pairs"

GOLDEN = Path(__file__).parents[2] / "golden" / "sinumerik" / "saved_c1.spf"
SAVING = BackupFile("BACK", 4711, "C1", 0, ReservedPoints(4, (3, 2, 0), ("X1", "Z1", "C1")))
TEXT = GOLDEN.read_text()
LINES = TEXT.splitlines()
SECTIONS = ("LIVE", "BACK", "READ")


def read(lines: list[str], saving: BackupFile = SAVING) -> LiveSet:
    """The lines as a file."""
    return read_backup("\n".join([*lines, ""]), "back", saving)


def refusal(lines: list[str], saving: BackupFile = SAVING) -> FileFormatError:
    """The error with which they are refused."""
    with pytest.raises(FileFormatError) as caught:
        read(lines, saving)
    return caught.value


def section(name: Any, number: int = 4711) -> tuple[list[str], BackupFile]:
    """The golden file as another section or of another run."""
    text = TEXT.replace(" BACK 4711 ", f" {name} {number} ")
    return text.splitlines(), replace(SAVING, section=name, number=number)


def test_a_whole_file_gives_the_live_set() -> None:
    live = read_backup(TEXT, "back", SAVING)
    assert live.own.enabled
    assert live.own.table.deviations == pytest.approx((0.0, -2.9988, 0.0), abs=1e-12)
    assert live.own.table.modulo
    assert live.own.table.input_unit == "deg"
    (cross,) = live.cross
    assert (cross.table.name, cross.enabled, cross.table.index) == ("C1(Z1)", False, 1)
    assert cross.table.deviations == pytest.approx((0.0, 14.4))
    assert (live.backlash, live.native, live.others) == (0.0002, TEXT, ())
    (turned,) = read_backup(TEXT, "back", SAVING, cec_sign=-1).cross
    assert turned.table.deviations == pytest.approx((0.0, -14.4))


def test_a_table_of_another_output_has_the_switch_of_that_output() -> None:
    (other,) = read([line.replace("OUTPUT_AXIS[1]=(C1)", "OUTPUT_AXIS[1]=(X1)") for line in LINES]).others
    assert (other.table.output_axis, other.enabled) == ("X1", True)


def test_the_digest_is_that_of_what_the_file_says() -> None:
    digest = read(LINES).digest
    assert {read(*section(name, number)).digest for name in SECTIONS for number in (1, 999_999)} == {digest}
    assert read([line.replace("0.004", "0.005") for line in LINES]).digest != digest


@pytest.mark.parametrize("ends", ["\r\n", "\n"])
def test_line_ends_and_blank_lines_at_the_end_are_the_transfers(ends: str) -> None:
    assert read_backup(ends.join([*LINES, "", ""]), "back", SAVING).digest == read(LINES).digest


@pytest.mark.parametrize("name", SECTIONS)
def test_any_line_left_out_doubled_or_foreign_is_refused(name: str) -> None:
    lines, saving = section(name)
    for place in range(len(lines)):
        for changed in (
            [*lines[:place], *lines[place + 1 :]],
            [*lines[:place], lines[place], *lines[place:]],
            [*lines[:place], "; a comment", *lines[place:]],
            [*lines[:place], "", *lines[place:]],
            [*lines[:place], lines[place] + ")", *lines[place + 1 :]],
        ):
            assert refusal(changed, saving).code.startswith(("E-SAVED-", "E-TABLE-"))
    attacks.counted(FAMILY, "OPC UA", 5 * len(lines))


@pytest.mark.parametrize("name", SECTIONS)
def test_any_run_of_lines_left_out_is_refused(name: str) -> None:
    lines, saving = section(name)
    runs = list(itertools.combinations(range(len(lines) + 1), 2))
    for first, behind in runs:
        refusal([*lines[:first], *lines[behind:]], saving)
    attacks.counted(FAMILY, "OPC UA", len(runs))


@pytest.mark.parametrize("name", SECTIONS)
def test_any_pair_of_lines_exchanged_is_refused(name: str) -> None:
    lines, saving = section(name)
    pairs = list(itertools.combinations(range(len(lines)), 2))
    for one, two in pairs:
        changed = list(lines)
        changed[one], changed[two] = lines[two], lines[one]
        refusal(changed, saving)
    attacks.counted(FAMILY, "OPC UA", len(pairs))


def test_a_line_left_out_is_refused_though_the_count_was_made_to_fit() -> None:
    for place in range(1, len(LINES) - 2):
        shorter = [*LINES[:place], *LINES[place + 1 : -2], ";TRUEFLANK END BACK 4711 LINES 30", "M17"]
        error = refusal(shorter)
        assert (error.code, error.fields["line"]) == ("E-SAVED-LINE", place + 1)


def test_the_reason_names_the_line_and_what_must_stand_there() -> None:
    error = refusal([*LINES[:27], *LINES[28:-2], ";TRUEFLANK END BACK 4711 LINES 30", "M17"])
    assert error.fields == {"line": 28, "text": "$MA_CEC_ENABLE[C1]=FALSE", "wanted": "$MA_ENC_COMP_ENABLE[0,C1]"}
    assert "run the program again" in str(error)


def _files() -> Iterator[tuple[str, Callable[[list[str]], list[str]], str]]:
    yield "empty", lambda _lines: [], "E-SAVED-CUT"
    yield "no begin", lambda lines: lines[1:], "E-SAVED-CUT"
    yield "comments lost", lambda lines: [one for one in lines if one[0] != ";"], "E-SAVED-CUT"
    yield "no end word", lambda lines: lines[:-1], "E-SAVED-CUT"
    yield "no count", lambda lines: [*lines[:-2], lines[-1]], "E-SAVED-CUT"
    yield "older", lambda _lines: section("BACK", 4710)[0], "E-SAVED-OTHER"
    yield "other section", lambda _lines: section("READ")[0], "E-SAVED-OTHER"
    yield "other axis", lambda lines: [lines[0].replace("C1", "X1"), *lines[1:]], "E-SAVED-OTHER"
    yield "other encoder", lambda lines: [lines[0].replace("R 0", "R 1"), *lines[1:]], "E-SAVED-OTHER"
    yield "older end", lambda lines: [*lines[:-2], lines[-2].replace("4711", "4710"), "M17"], "E-SAVED-OTHER"
    yield "other count", lambda lines: [*lines[:-2], lines[-2].replace("31", "32"), "M17"], "E-SAVED-COUNT"
    yield "two runs", lambda lines: [*section("BACK", 4710)[0], *lines], "E-SAVED-OTHER"
    yield "appended", lambda lines: [*lines, *lines], "E-SAVED-COUNT"


@pytest.mark.parametrize(("change", "code"), [pytest.param(*rest, id=name) for name, *rest in _files()])
def test_what_is_no_file_of_this_run_is_refused(change: Callable[[list[str]], list[str]], code: str) -> None:
    assert refusal(change(LINES)).code == code


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("$AN_CEC_STEP[0]=0", "$AN_CEC_STEP[0]=5"),
        ("$AN_CEC_STEP[1]=100", "$AN_CEC_STEP[1]=0"),
        ("OUTPUT_AXIS[1]=(C1)", "OUTPUT_AXIS[1]=(B1)"),
        ("=0.004", "=NaN"),
        ("=0.004", "=inf"),
        ("=0.004", "="),
        ("=180", "=1e2"),
        ("ENABLE[0,C1]=TRUE", "ENABLE[0,C1]=2"),
    ],
)
def test_values_that_cannot_be(old: str, new: str) -> None:
    refusal([line.replace(old, new) for line in LINES])


@pytest.mark.parametrize(
    "memory",
    [
        ReservedPoints(3, (3, 2, 0), ("X1", "Z1", "C1")),
        ReservedPoints(5, (3, 2, 0), ("X1", "Z1", "C1")),
        ReservedPoints(4, (3, 3, 0), ("X1", "Z1", "C1")),
        ReservedPoints(4, (3, 2, 1), ("X1", "Z1", "C1")),
        ReservedPoints(4, (0, 2, 0), ("X1", "Z1", "C1")),
        ReservedPoints(4, (3, 2, 0), ("X1", "Z1", "C1", "B1")),
        ReservedPoints(0, (3, 2, 0), ("X1", "Z1", "C1")),
    ],
)
def test_what_the_control_has_reserved_must_all_be_there_and_no_more(memory: ReservedPoints) -> None:
    assert refusal(LINES, replace(SAVING, memory=memory)).code == "E-SAVED-LINE"


def test_an_axis_without_table_memory_still_says_its_switches() -> None:
    saving = BackupFile("LIVE", 1, "X1", 0, ReservedPoints(0))
    text = backup_text(saving, {**dict.fromkeys(backup.axis_settings(saving), "0"), "$MA_BACKLASH_FACTOR[0,X1]": "1"})
    live = read_backup(text, "live", saving)
    assert (live.own.table.deviations, live.own.table.step, live.own.enabled) == ((0.0,), 0.0, False)
    for place in range(7):
        refusal([line for at, line in enumerate(text.splitlines()) if at != place], saving)


def test_a_range_beyond_the_memory_is_shortened_as_the_control_does() -> None:
    table = read([line.replace("STEP[0,C1]=180", "STEP[0,C1]=60") for line in LINES]).own.table
    assert (table.maximum, len(table.deviations)) == (180.0, 4)


def test_a_file_of_ours_is_still_a_program_and_a_table_file_for_everybody() -> None:
    read_whole = read_tables_loosely(TEXT, "back")
    assert [table.kind for table in read_whole.tables] == ["axis", "cross"]
    assert "$AN_CEC[0,..]: never loaded (STEP 0)" in map(str, read_whole.notes)
    codes = {one.error.code for one in TableFiles().findings(TEXT, "back")}
    assert "W-TABLE-NEVER" in codes
    assert "E-TABLE-PARAMETER" not in codes


# ---- what a program really writes ------------------------------------------------------------------------

X1, Z1 = AxisSpec("X1", "X", eec_points=(4, 3)), AxisSpec("Z1", "Z")
WORDS = Words()
NEW = CompensationTable("axis", "X1", "X1", 0.0, 100.0, 50.0, (0.0, 3.0, 0.0))
ORDER = PushOrder(4711, NEW, "X", False, True, 0.0, "restore", None)


async def _saved_by_the_control(clock: LoopClock, *, never: bool) -> tuple[str, str]:
    """BACK and READ after the first half, on a control with three CEC tables, one of them loaded."""
    nck = Nck(NckSpec((X1, Z1), cec_points=(2, 0, 3), files_max_bytes=65536), clock)
    await nck.start()
    try:
        for axis in ("X1", "Z1"):
            nck.reference_axis(axis)
        await clock.sleep(60.0)
        if not never:
            for name, value in (("INPUT_AXIS", "Z1"), ("OUTPUT_AXIS", "X1"), ("MAX", 20.0), ("STEP", 10.0)):
                nck.set(f"$AN_CEC_{name}[2]", value, 0)
            nck.set("$AN_CEC[2,1]", -0.0015, 0)
        setting = MachineSetting(WORDS, ReservedPoints(4, (2, 0, 3), ("X1", "Z1")), modulo=False)
        nck.files.write("/_N_MPF_DIR/_N_TFPUSH_X1_MPF", pushing.build_loading_program([(ORDER, setting)]).encode())
        nck.set_mode("AUTO")
        assert nck.select("/_N_MPF_DIR/_N_TFPUSH_X1_MPF") == 0
        assert nck.nc_start()
        await clock.sleep(60.0)
        assert not nck.alarms
        back, readback = (nck.files.read(f"/_N_SPF_DIR/_N_TF{name}_X1_SPF").decode() for name in ("BACK", "READ"))
        return back, readback
    finally:
        await nck.stop()


@pytest.mark.parametrize("never", [False, True])
def test_what_the_control_writes_is_what_the_reader_wants(never: bool) -> None:
    found: list[str] = []

    async def main() -> None:
        found.extend(await _saved_by_the_control(LoopClock(), never=never))

    run_virtual(main)
    memory = ReservedPoints(4, (2, 0, 3), ("X1", "Z1"))
    back = read_backup(found[0], "back", BackupFile("BACK", 4711, "X1", 0, memory))
    after = read_backup(found[1], "read", BackupFile("READ", 4711, "X1", 0, memory))
    assert (back.own.table.step, after.own.table.deviations) == (0.0, NEW.deviations)
    assert [one.table.deviations for one in back.cross] == ([] if never else [(0.0, -1.5, 0.0)])
    with pytest.raises(FileFormatError, match="E-SAVED-OTHER"):
        read_backup(found[0], "back", BackupFile("READ", 4711, "X1", 0, memory))
