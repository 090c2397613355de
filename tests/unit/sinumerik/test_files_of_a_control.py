"""What a control writes is read as it acts: unit line, leftovers, never-loaded tables, odd steps, archives."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path

import pytest

from drivers.errors import FileFormatError
from drivers.sinumerik.tablefile.format import TableFiles
from drivers.tablefile import TableFile, TableMachine
from tests.unit.sinumerik.archives import ACTIVE, archive

GOLDEN = Path(__file__).parents[2] / "golden" / "tables"
AXES, CROSS, NOTHING, DATA = (
    (GOLDEN / f"control_{name}.ini").read_bytes() for name in ("axes", "cross", "nothing", "data")
)
WHOLE = archive(
    ("_N_AX_EEC_INI", ACTIVE, AXES),
    ("_N_NC_CEC_INI", ACTIVE, CROSS),
    ("_N_INITIAL_INI", ACTIVE, DATA),
    ("_N_OLD_MPF", "\\WKS.DIR\\KEPT.WPD\\", b"$AA_ENC_COMP[0,0,AX1]=5\r\nM30\r\n"),
)
FILES = TableFiles()


def found(data: bytes, known: TableMachine | None = None) -> dict[str, str]:
    return {one.code: one.severity for one in FILES.findings(data, "f", known)}


def read(data: bytes) -> TableFile:
    return FILES.read(data, "f")


def test_members_of_an_archive_are_read_as_they_act() -> None:
    content = read(WHOLE)
    own, turn, cross = content.tables
    assert (own.index, own.output_axis, own.input_unit) == (1, "AX1", "mm")
    assert list(own.positions) == [-30.0, 10.0, 50.0]  # 40 in -30 .. 70: k = 2, the last value acts beyond 50
    assert own.at(own.positions + 100.0)[-1] == pytest.approx(3.4)
    assert (turn.input_unit, turn.modulo, turn.deviations[1]) == ("deg", True, pytest.approx(2.52))
    assert (cross.name, cross.input_unit, len(cross.deviations)) == ("AX1(AX4)", "deg", 4)
    assert content.names == {"AX1": "U1", "AX4": "TURN", "AX14": "W1"}
    assert not content.unknown
    assert content.settings["$MA_BACKLASH[1,AX1]"] == Decimal("0.0017")
    assert "$SN_CEC_TABLE_ENABLE[1]" not in content.settings  # no table 1 in the file
    assert any("never loaded" in note for note in map(str, content.notes))
    assert any("assumed to act up to 50" in note for note in map(str, content.notes))


def test_findings_of_an_archive_use_its_machine_data() -> None:
    codes = found(WHOLE)
    assert "wrong" not in {one.severity for one in FILES.findings(WHOLE, "f") if one.code != "E-TABLE-RESERVED"}
    assert codes["E-TABLE-RESERVED"] == "wrong"  # MD38000[1,AX4] = 3, its table has 4 points
    assert codes["W-TABLE-OTHER-ENCODER"] == "doubtful"  # MD32700 of AX4 switches measuring system 1 on
    assert codes["W-TABLE-STEP"] == "doubtful"
    assert codes["W-TABLE-NEVER"] == codes["W-TABLE-NAMES"] == codes["W-TABLE-LEFT"] == "note"
    assert "W-TABLE-ENCODER" not in codes
    assert "W-TABLE-UNIT" not in codes
    places = {one.error.where for one in FILES.findings(WHOLE, "f")}
    assert "f: AX_EEC.INI, line 5" in places


def test_members_are_listed() -> None:
    listed = FILES.members(WHOLE, "f")
    assert [one.shown for one in listed] == ["@@STAMP", "AX_EEC.INI", "NC_CEC.INI", "INITIAL.INI", "OLD.MPF"]
    assert (listed[1].folder, listed[1].size, listed[1].changed) == (ACTIVE, len(AXES), 1_400_000_000)
    assert FILES.members(AXES, "f") == ()


@pytest.mark.parametrize("data", [NOTHING, archive(("_N_X_MPF", "\\MPF.DIR\\", b"G0 X0\nM30\n")), archive()])
def test_a_file_without_tables_is_said_to_have_none(data: bytes) -> None:
    assert found(data) == {"W-TABLE-NO-TABLES": "note"}
    assert read(data).tables == ()
    assert "no" in str(read(data).notes[0])


@pytest.mark.parametrize("data", [AXES, CROSS, NOTHING, DATA])
def test_each_file_alone_reads_without_an_error(data: bytes) -> None:
    assert "wrong" not in found(data).values()
    read(data)


def test_numbered_axes_are_not_guessed_to_be_linear() -> None:
    assert read(AXES).unknown == {"AX1"}  # the modulo table tells that AX4 is rotary
    assert found(AXES)["W-TABLE-UNIT"] == "doubtful"
    assert "W-TABLE-UNIT" not in found(AXES, TableMachine(units={"AX1": "mm"}))
    steep = AXES.replace(b"=0.0034", b"=0.1999")
    assert "E-TABLE-SLOPE" not in found(steep)
    assert found(steep, TableMachine(units={"AX1": "mm"}))["E-TABLE-SLOPE"] == "wrong"
    assert found(AXES.replace(b"=0.0034", b"=0.2001"))["E-TABLE-VALUE"] == "wrong"  # too much in either unit


@pytest.mark.parametrize("wrong", [b"AX0", b"AX00", b"AX01"])
def test_axes_count_from_one(wrong: bytes) -> None:
    assert found(AXES.replace(b"AX1]", wrong + b"]"))["E-TABLE-INDEX"] == "wrong"
    assert found(CROSS.replace(b"(AX4)", b"(" + wrong + b")"))["E-TABLE-AXIS"] == "wrong"


def test_inches_are_converted_by_the_axis_or_refused_by_its_name() -> None:
    inch = AXES.replace(b"METRIC", b"INCH")
    assert found(inch)["E-TABLE-INCH-AXIS"] == "wrong"
    with pytest.raises(FileFormatError, match="AX1"):
        read(inch)
    linear, turn = FILES.read(inch, "f", {"AX1": "mm"}).tables
    assert (linear.step, linear.minimum, linear.maximum) == (1016.0, -762.0, 1778.0)
    assert linear.deviations[1] == pytest.approx(2.1 * 25.4)
    assert (turn.step, turn.deviations[1]) == (120.0, pytest.approx(2.52))
    whole = archive(("_N_NC_CEC_INI", ACTIVE, CROSS.replace(b"METRIC", b"INCH")), ("_N_INITIAL_INI", ACTIVE, DATA))
    (cross,) = read(whole).tables
    assert (cross.step, cross.deviations[1]) == (70.0, pytest.approx(1.1 * 25.4))  # deg along AX4, inches of AX1


def test_a_text_that_is_no_table_gives_one_sentence() -> None:
    program = "\n".join(f"N{10 * line} G1 X{line} F500" for line in range(1, 20_000))
    for data in (program.encode(), bytes(range(256)) * 500, b"\xff" * 10_000):
        findings = FILES.findings(data, "f")
        assert [one.code for one in findings] == ["E-TABLE-NONE"]
    many = AXES.replace(b"=0", b" 0") + b"$AA_ENC_COMP[1,9,AX9] 7\n" * 500
    assert len(FILES.findings(many, "f")) < 200
    assert "E-TABLE-MORE" in found(many)


def test_machine_data_of_others_are_counted_and_misspelt_ones_of_ours_are_not() -> None:
    assert found(DATA)["W-TABLE-OTHER-DATA"] == "note"
    (note,) = (one for one in FILES.findings(DATA, "f") if one.code == "W-TABLE-OTHER-DATA")
    assert (note.error.fields["count"], note.error.fields["line"]) == (6, 10)
    assert "E-TABLE-NAME" in found(DATA.replace(b"$MA_BACKLASH[1", b"$MA_BACKLASCH[1"))
    assert "E-TABLE-NAME" in found(AXES.replace(b"COMP_STEP", b"COMP_STEPS"))


@pytest.mark.parametrize(
    ("damage", "code"),
    [
        (lambda data: data[: 512 * 4], "E-ARCHIVE-CUT"),
        (lambda data: data[:1024] + b"?" + data[1025:], "E-ARCHIVE-HEADER"),
        (lambda data: data + b"tail", "E-ARCHIVE-HEADER"),
    ],
)
def test_a_damaged_archive_is_refused_with_the_place(damage: Callable[[bytes], bytes], code: str) -> None:
    data = damage(WHOLE)
    assert found(data) == {code: "wrong"}
    with pytest.raises(FileFormatError, match=code):
        read(data)
    with pytest.raises(FileFormatError, match=code):
        FILES.members(data, "f")
