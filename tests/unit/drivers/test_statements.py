"""Lines around a table that change what its numbers mean: applied by a person's word or in doubt, never passed over."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError, FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.csvmap import CsvFormat, parse_csv
from drivers.files.pos import PosFormat
from drivers.files.rtl import RtlFormat
from drivers.types.results import MeasuredSet

GOLDEN = Path(__file__).parents[2] / "golden" / "files"
READ = {0.0: (1.0, 0.5), 100.0: (3.0, 2.5), 200.0: (6.0, 5.0), 300.0: (8.0, 7.5)}
TABLE = "Target [mm];Direction;Run;Error [um]\n" + "".join(
    f"{at:g};{way};1;{READ[at][k]}\n" for k, way in enumerate("+-") for at in sorted(READ, reverse=way == "-")
)
INDEXED = "".join(
    f"TGT_DATA[{i}]={at:g}\nREF_DATA_FWD[{i},1]={at + up / 1e3}\nREF_DATA_BWD[{i},1]={at + down / 1e3}\n"
    for i, (at, (up, down)) in enumerate(READ.items(), start=1)
)
FACTOR = """Scale: 0.5|Scale factor = 2|Multiplier;10|Faktor: 0,1|# Faktor 0,1|Readings x10|values × 0.1|divide by 10
(all deviations divided by 1000)|Unit: 0.1 um|Einheit: 1/10 µm|1 digit = 0.1 um|Values in tenths of a micron|Scale: 1:10
Gain\t2|Scale factor (readings): 0.001|Messwerte mal 10|Readings multiplied by 10|比例: 0.1|Divisor: 4
Scale [um/div]: 0.5|units of 0.1 um|all readings in 1e-4 inch|Werte in 10^-4 mm|Werte in 1/1000 mm|Scale: 50 %
"Scale";"0.5"|SCALE:.5
Readings are doubled|Half values|deviations x2|Échelle: 10|Magnification 10x
Factor of 10|Scale: 2 um|Maßstab 10|Масштаб: 0.1|Data scale: 1e-3"""
ZERO = "Offset: 5|Offset: 1|Zero offset;12.5 mm|Preset: 100|add 5 um to all readings|偏移: 2|Nullpunktverschiebung: 0,3"
SIGN = """Sign: inverted|Sign: -1|Deviation = target - actual|Sign convention: nominal minus actual
Polarity: negative|Invert: yes|Vorzeichen: umgekehrt|Abweichung = Soll - Ist|signs of all readings were changed"""
NOTHING = """Scale: 1|Scale factor: 1.0|Faktor 1|Offset: 0.000 mm|Sign: +1|Sign: positive|Scale: Heidenhain LS 187
Invert: no|Machine: Mill 7|Serial No: 12345|Date: 2026-10-10|Part 10 x 10 mm|Feed: 1000 mm/min|Resolution: 0.1 um
Unit: um|Deviation = measured - target|Title: X axis, 5 runs, 10 targets
Expansion coefficient: 11.7e-6|Tolerance: 0.01 mm
Axis X from 0 to 1000 mm in 100 mm steps|measured in 0.5 mm steps|Order: 1x10-7|Average of 10 samples
Travel of 10 mm"""
UNIT = "Readings in mm|all values in mm|deviation in mm|Values in inches|Abweichungen in mm|errors are in nm"
RAW = "Expansion not corrected|not compensated for air|without material compensation|nicht kompensiert"
COUNT = "Targets: 99|Runs: 9|Number of runs: 5|Anzahl Läufe: 3"
NOTHING += "\nerrors in microns|values in mm|Targets: 4|Runs: 1|Runs: 2|No of targets: 4|Compensation: off|mean of 5"
MICRONS = "errors in microns"
LISTED = {"S-READ-FACTOR": FACTOR, "S-READ-ZERO": ZERO, "S-READ-SIGN": SIGN, "": NOTHING, "S-READ-UNITS": UNIT}
LISTED |= {"S-READ-RAW": RAW, "S-READ-COUNT": COUNT}
NOT_BLOCKING = ("S-READ-RAW", "S-READ-COUNT")
LINES = [(line, code) for code, lines in LISTED.items() for line in re.split(r"[|\n]", lines)]


def read(text: str, **said: object) -> MeasuredSet:
    return parse_csv(text, ColumnMap.read(said, "x"), "x")


@pytest.mark.parametrize("place", ["above", "below", "indexed"])
def test_a_line_about_factor_zero_or_sign_stops_the_verdict_and_any_other_does_not(place: str) -> None:
    for line, code in LINES:
        texts = {"above": f"{line}\n{TABLE}", "below": f"{TABLE}\n{line}\n", "indexed": f"UNIT=mm\n{line}\n{INDEXED}"}
        # A text by indices has positions in one unit and counts nothing; below a table nothing is counted either.
        if (code == "S-READ-COUNT" and place != "above") or (
            place == "indexed" and line in (*UNIT.split("|"), MICRONS)
        ):
            continue
        found = [(one.code, one.blocking) for one in read(texts[place]).doubts]
        assert found == ([(code, code not in NOT_BLOCKING)] if code else []), line


def test_what_a_person_says_of_a_factor_is_applied_and_settles_it() -> None:
    plain = np.array([READ[at] for at in sorted(READ)])
    for text in (f"Scale: 0.5\n{TABLE}", f"UNIT=mm\nSCALE=0.5\n{INDEXED}"):
        already = read(text, factor=1)
        np.testing.assert_allclose(already.deviations[:, 0, :], plain, atol=1e-9)
        assert not already.doubts
    halved = read(f"Scale: 0.5\n{TABLE}", factor=0.5)
    np.testing.assert_allclose(halved.deviations[:, 0, :], plain / 2.0, atol=1e-12)
    assert not halved.doubts
    assert "factor=0.5" in halved.header["Columns"]
    turned = read(f"Sign: inverted\n{TABLE}", sense=-1)
    np.testing.assert_allclose(turned.deviations[:, 0, :], -plain, atol=1e-12)
    assert not turned.doubts
    with pytest.raises(ConfigError, match="E-FILE-MAP"):
        read(TABLE, factor=-2)


def test_a_large_table_is_read_with_the_same_doubt(tmp_path: Path) -> None:
    rows = "".join(f"{at}.5,+,1,{at % 7}.25\n" for at in range(400))
    (tmp_path / "a.csv").write_text(f"Multiplier: 10\ntarget_mm,direction,repetition,deviation_um\n{rows}")
    assert [one.code for one in CsvFormat().read(tmp_path / "a.csv").doubts] == ["S-READ-FACTOR"]


@pytest.mark.parametrize(("line", "codes"), [
    ("Scale: 0.5", ["S-READ-FACTOR"]), ("Units: inch", ["S-READ-UNITS"]), ("Units: um", []), ("Location: hall 1", []),
    ("Deviation unit: mm", []),
])  # fmt: skip
def test_files_of_vendors_whose_head_states_a_factor_or_another_unit_are_in_doubt(
    line: str, codes: list[str], tmp_path: Path
) -> None:
    text = (GOLDEN / "basic.rtl").read_bytes().decode("cp1252")
    assert "USER-TEXT::" in text
    (tmp_path / "a.rtl").write_text(text.replace("USER-TEXT::", f"USER-TEXT::\n{line}", 1), encoding="cp1252")
    found = RtlFormat().read(tmp_path / "a.rtl")
    assert [one.code for one in found.doubts if one.blocking] == codes
    blocks = "Position Forward Directional Avg Error\n0 0.001\n50 0.002\n100 0.004\n"
    (tmp_path / "a.pos").write_text(f"Machine: Mill 7\n{line}\n{blocks}")
    pos = PosFormat().read(tmp_path / "a.pos")
    assert [one.code for one in pos.doubts if one.blocking] == codes
    assert pos.header["Machine"] == "Mill 7"
    with pytest.raises(ConfigError, match="E-FILE-UNIT"):
        PosFormat("um")


def test_a_stated_unit_of_the_readings_must_be_theirs() -> None:
    assert [one.code for one in read(f"Deviation unit: nm\n{TABLE}").doubts] == ["S-READ-UNITS"]
    assert [one.code for one in read(f"Error unit: mm\n{TABLE}").doubts] == ["S-READ-UNITS"]
    assert [one.code for one in read(f"Units: nm\n{TABLE}").doubts] == ["S-READ-UNITS"]
    assert not read(f"Deviation unit: µm\n{TABLE}").doubts
    assert not read(f"Units: mm\n{TABLE}").doubts


def test_a_gon_is_no_degree_and_a_german_degree_is_one() -> None:
    for head, known in (("Ziel [Grad];Abweichung [arcsec]", True), ("Target [grad];Error [arcsec]", False)):
        text = f"{head.replace(';', ';Direction;Run;')}\n" + "".join(f"{at};+;1;{at / 10}\n" for at in range(0, 50, 10))
        if known:
            assert read(text).targets.tolist() == [0.0, 10.0, 20.0, 30.0, 40.0]
            continue
        with pytest.raises(FileFormatError, match="grad"):
            read(text)
        assert read(text, target_unit="deg").targets[1] == 10.0


def test_a_number_that_no_axis_reaches_is_not_counted_round_the_turn() -> None:
    """1e30 arcsec less whole turns was 0 arcsec."""
    rows = "".join(f"{at};+;1;{'1e30' if at == 40 else at / 100}\n" for at in range(0, 80, 10))
    with pytest.raises(FileFormatError, match="not a measurement"):
        read(f"Target [deg];Direction;Run;Error [arcsec]\n{rows}")


def test_targets_in_the_column_of_deviations_are_refused_and_rounded_deviations_are_not() -> None:
    rng = np.random.default_rng(5)
    ups, downs = range(0, 400, 50), range(350, -1, -50)
    rows = "".join(
        f"{rng.normal(0.0, 3.0):.3f};{way};{run};{at}\n"
        for run in (1, 2)
        for way, ats in (("+", ups), ("-", downs))
        for at in ats
    )
    for unit, other in (("mm", "um"), ("deg", "arcsec")):
        with pytest.raises(FileFormatError, match="E-FILE-EXCHANGED"):
            read(f"Target [{unit}];Direction;Run;Error [{other}]\n{rows}")
    steps = "".join(f"{at};+;1;{at // 100}\n" for at in range(0, 800, 50))
    assert read(f"Target [mm];Direction;Run;Error [um]\n{steps}").deviations.shape == (16, 1, 2)
