"""Tables of a reducer's bench: headings in every spelling, declared columns, marks of recorders, and damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ConfigError, TrueflankError
from drivers.files.drives import DriveColumns, DriveCsvFormat, parse_drive
from drivers.registry import known

HEAD = "time_s,input_angle_deg,output_angle_deg,torque_Nm,temperature_degC"


def rows(count: int = 12, separator: str = ",") -> list[str]:
    return [separator.join((f"{0.5 * k}", f"{121.0 * k}", f"{1.0 * k}", f"{k - 5}.25", "21.5")) for k in range(count)]


def text(*lines: str, head: str = HEAD, body: list[str] | None = None) -> str:
    return "\n".join([*lines, head, *(body or rows()), ""])


def code(body: str, said: DriveColumns | None = None) -> str:
    with pytest.raises(TrueflankError) as caught:
        parse_drive(body, said or DriveColumns(), "x.csv")
    return caught.value.code


def test_a_plain_table_is_read_with_what_it_states() -> None:
    found = parse_drive(text("# Pins,40", "# Ratio,121", "# Instrument,rig (simulated)"), DriveColumns(), "x")
    assert found.stated == {"pins": 40.0, "ratio": 121.0}
    assert found.header["Instrument"] == "rig (simulated)"
    assert found.output_deg.tolist() == [float(k) for k in range(12)]
    assert found.lines[0] == 5.0
    assert found.time_s is not None
    assert found.torque_nm is not None
    assert found.torque_nm[0] == -5.25 + 0.5 or found.torque_nm[0] == -5.25
    assert found.warnings == ()


@pytest.mark.parametrize(
    ("head", "factor", "torque"),
    [
        ("Time [ms];Input angle [arcsec];Output angle (rad);Torque [kNm];Temp. [K]", np.rad2deg(1.0), 1000.0),
        ("Zeit (min);Antrieb (deg);Abtrieb (arcmin);Drehmoment (Nmm);Temperatur (°C)", 1.0 / 60.0, 1e-3),
        ("时间 [s];输入角 [度];输出角 [角秒];扭矩 [Nm];温度 [°C]", 1.0 / 3600.0, 1.0),
    ],
)
def test_headings_name_role_and_unit_in_three_languages(head: str, factor: float, torque: float) -> None:
    found = parse_drive(text(head=head, body=rows(separator=";")), DriveColumns(), "x")
    assert found.output_deg[7] == pytest.approx(7.0 * factor)
    assert found.torque_nm is not None
    assert found.torque_nm[8] == pytest.approx(3.25 * torque)


def test_declared_columns_need_no_heading_and_a_decimal_comma_is_read() -> None:
    body = "\n".join([*(one.replace(".", ",") for one in rows(separator=";")), ""])
    said = DriveColumns(input=2, output=3, input_unit="deg", output_unit="arcmin")
    found = parse_drive(body, said, "x")
    assert found.output_deg[6] == pytest.approx(0.1)
    assert found.torque_nm is None


def test_missing_readings_leave_their_line_out_and_are_told() -> None:
    body = rows()
    body[4] = body[4].replace("4.0,", "n/a,")
    found = parse_drive(text(body=body), DriveColumns(), "x")
    assert len(found.lines) == 11
    assert any("line 6" in one for one in map(str, found.warnings))


def test_an_angle_that_starts_again_at_each_turn_is_continued() -> None:
    body = [f"{k},{10.0 * k},{(350.0 + 2.0 * k) % 360.0},0,20" for k in range(12)]
    found = parse_drive(text(body=body), DriveColumns(), "x")
    assert np.diff(found.output_deg) == pytest.approx(2.0)
    assert any("continued" in one for one in map(str, found.warnings))


def test_what_nobody_named_and_what_cannot_be_is_refused_with_its_place() -> None:
    assert code(text(head="time_s,input,output_angle_deg,torque_Nm,temperature_degC")) == "E-DRIVE-UNIT"
    assert code(text(head="time_s,input_angle_mm,output_angle_deg,torque_Nm,temperature_degC")) == "E-DRIVE-UNIT"
    assert code(text(head="a,b,c,d,e")) == "E-DRIVE-HEADING"
    assert code(text("# Pins,forty")) == "E-DRIVE-STATED"
    assert code(text("# Pins,40.5")) == "E-DRIVE-STATED"
    backwards = rows()
    backwards[5], backwards[6] = backwards[6], backwards[5]
    assert code(text(body=backwards)) == "E-DRIVE-TIME"
    for mark in ("9999999999", "-9999999999", "1e30"):
        assert code(text(body=[*rows(), f"99,1,{mark},0,20"])) == "E-FILE-LINE"
    assert code(text(body=[*rows(), "99,1"])) == "E-FILE-LINE"
    assert code(text(body=[*rows(), "99,1,abc,0,20"])) == "E-FILE-LINE"
    assert code(text(body=rows(5))) == "E-FILE-ROWS"
    assert code("# nothing") == "E-FILE-ROWS"
    assert code(text(), DriveColumns(output=9, output_unit="deg")) == "E-FILE-LINE"


def test_declarations_are_checked(tmp_path: Path) -> None:
    for said in ({"input_unit": "mm"}, {"input": -1}, {"colour": 3}, {"separator": ";;"}):
        with pytest.raises(ConfigError, match="E-FILE-MAP"):
            DriveCsvFormat(columns=said)
    path = tmp_path / "record.csv"
    path.write_text(text(), encoding="utf-8")
    record = known("drive-file")["drive-csv"].load()(columns={}).read(path)
    assert len(record.input_deg) == 12


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 400), st.sampled_from("0123456789,;.-\n\t#eE \"'nax°")), min_size=1, max_size=8)
)
def test_damage_is_read_or_refused_never_anything_else(changes: list[tuple[int, str]]) -> None:
    letters = list(text("# Pins,40"))
    for at, letter in changes:
        letters[at % len(letters)] = letter
    try:
        found = parse_drive("".join(letters), DriveColumns(), "x")
    except TrueflankError:
        return
    assert np.isfinite(found.input_deg).all()
    assert np.isfinite(found.output_deg).all()
    assert len(found.lines) == len(found.output_deg) >= 8


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-1e5, 1e5, allow_nan=False), min_size=8, max_size=30))
def test_numbers_come_back_as_they_were_written(values: list[float]) -> None:
    body = [f"{k},{k}.5,{value!r},0,20" for k, value in enumerate(values)]
    plain = [f"{k},{k}.5,{value:.12f},0,20" for k, value in enumerate(values)]
    found = parse_drive(text(body=plain), DriveColumns(), "x")
    if not found.warnings:
        assert found.output_deg == pytest.approx(values, abs=1e-9)
    assert len(body) == len(found.output_deg)
