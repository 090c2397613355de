"""Result files: the layouts met in practice are read, the doubtful is said, the wrong is refused by its line."""

from __future__ import annotations

import json
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ConfigError, FileFormatError
from drivers.files.rtl import RtaFormat, RtlFormat, text_of
from drivers.files.rtltext import RtlText, parse, render
from drivers.types.results import MeasuredSet
from drivers.types.sensing import Ambient

FOLDER = Path(__file__).parents[2] / "golden/files"
EXPECTED = json.loads((FOLDER / "expected.json").read_text(encoding="utf-8"))
BASIC = (FOLDER / "basic.rtl").read_bytes().decode("ascii").replace("\r\n", "\n")


def read(tmp_path: Path, data: str | bytes, name: str = "a.rtl", **options: str) -> MeasuredSet:
    path = tmp_path / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode("utf-8"))
    return RtlFormat(**options).read(path)


def refused(tmp_path: Path, text: str | bytes) -> FileFormatError:
    with pytest.raises(FileFormatError) as caught:
        read(tmp_path, text)
    return caught.value


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_files_give_what_a_person_reads_in_them(name: str) -> None:
    form = RtaFormat(unit="mrad") if name.endswith(".rta") else RtlFormat()
    found, wanted = form.read(FOLDER / name), EXPECTED[name]
    assert found.targets.tolist() == wanted["targets"]
    assert found.deviations[:, :, 0] == pytest.approx(np.array(wanted["up"]), abs=1e-9)
    assert found.deviations[:, :, 1] == pytest.approx(np.array(wanted["down"]), abs=1e-9)
    assert found.axis_unit == ("deg" if name.endswith(".rta") else "mm")


def test_environment_has_pressure_in_hpa_and_only_connected_sensors() -> None:
    found = RtlFormat().read(FOLDER / "environment.rtl")
    assert found.ambient_start == Ambient(20.337280, 990.39005, 46.954897, (20.203292,))
    assert found.ambient_end == Ambient(20.384956, 990.49346, 46.893887, (20.321342,))
    assert found.expansion_ppm_per_k == 8.0
    assert found.compensated_for == "air+material"
    assert found.header["Env factor"] == "0.31641096 0.31641067"
    assert found.header["Machine"] == "Schleifmaschine für Räder"
    assert found.header["EQUIPMENT"] == "Laser : XL 1234\nsomething without a key"
    assert found.warnings == ()


def test_a_missing_environment_is_unknown_and_not_twenty_degrees(tmp_path: Path) -> None:
    found = read(tmp_path, BASIC)
    assert found.ambient_start == Ambient()
    assert found.expansion_ppm_per_k is None
    assert any("unknown" in warning for warning in map(str, found.warnings))


@pytest.mark.parametrize("change", [
    lambda text: text,
    lambda text: text.replace("\n", "\r\n"),
    lambda text: text.replace("\n", "\r"),
    lambda text: "\ufeff" + text,
    lambda text: text.replace("Run-count:2", "Run-count : 2").replace("Target-count: 3", "TARGET-COUNT:3"),
    lambda text: text.replace(" -50.000000  0.000000  50.000000\n", "-50\n\n 0.000000\n50.000000\n"),
    lambda text: text.replace("Targets :\n -50.000000", "Targets: -50.000000"),
    lambda text: text.replace("    ", "\t"),
    lambda text: text.replace("2    3    2.875\n2    2    1.625\n2    1    0.500", "2 1 .5\n2 2 1.625\n2 3 2.875"),
    lambda text: text.replace("Filetype  : ISO\n", ""),
    lambda text: text[: text.index("EOF::")],
    lambda text: text + "\nrubbish after the end",
    lambda text: text.replace("0.000000  50", "0,000000  50").replace(".", ","),
])  # fmt: skip
def test_layouts_that_mean_the_same(tmp_path: Path, change: object) -> None:
    found = read(tmp_path, change(BASIC).encode("utf-8"))  # type: ignore[operator]
    assert found.targets.tolist() == [-50, 0, 50]
    assert found.deviations.tolist() == [[[0.0, 0.5]], [[1.25, 1.625]], [[2.375, 2.875]]]


@pytest.mark.parametrize(("codepage", "word"), [("cp1252", "Räder"), ("cp1250", "Řezání"), ("cp936", "磨床")])
def test_the_capture_pcs_code_page(tmp_path: Path, codepage: str, word: str) -> None:
    data = BASIC.replace("Machine:Example", f"Machine:{word}").encode(codepage)
    assert read(tmp_path, data, codepage=codepage).header["Machine"] == word


def test_utf16_with_its_mark(tmp_path: Path) -> None:
    assert read(tmp_path, BASIC.encode("utf-16")).targets.tolist() == [-50, 0, 50]


@pytest.mark.parametrize(("old", "new", "code", "said"), [
    ("HEADER::", "HEADERS::", "E-FILE-DETECT", "HEADERS"),
    ("1    2    1.250", "1    2    1.25x", "E-FILE-LINE", "line 28"),
    ("1    2    1.250", "1    2    nan", "E-FILE-LINE", "line 28"),
    ("1    2    1.250", "1    2", "E-FILE-LINE", "line 28"),
    ("1    2    1.250", "1    2    1.250 7", "E-FILE-LINE", "line 28"),
    ("1    2    1.250", "1    2    1,250", "E-FILE-LINE", "line 28"),
    ("1    2    1.250", "1    1    1.250", "E-FILE-LINE", "twice"),
    ("1    2    1.250", "1    4    1.250", "E-FILE-LINE", "target 4"),
    ("1    2    1.250", "0    2    1.250", "E-FILE-LINE", "run 0"),
    ("1    2    1.250", "1.5  2    1.250", "E-FILE-LINE", "row"),
    ("0.000000  50", "0.0.0  50", "E-FILE-LINE", "0.0.0"),
    ("Target-count: 3", "Target-count: 4", "E-FILE-COUNT", "declares 4 but holds 3"),
    ("Run-count:2", "Run-count:1", "E-FILE-COUNT", "run 2"),
    ("Run-count:2", "Run-count:many", "E-FILE-COUNT", "many"),
    ("-50.000000  0.000000", "-50.000000  60.000000", "E-FILE-TARGETS", "rise nor fall"),
    ("-50.000000  0.000000", "0.000000  0.000000", "E-FILE-TARGETS", "rise nor fall"),
    ("RUNS::", "USER-TEXT::", "E-FILE-LINE", "twice"),
])  # fmt: skip
def test_what_is_wrong_is_refused_and_named(tmp_path: Path, old: str, new: str, code: str, said: str) -> None:
    assert old in BASIC
    error = refused(tmp_path, BASIC.replace(old, new, 1))
    assert error.code == code
    assert said in str(error)


def test_a_file_cut_in_the_middle_of_a_number_is_refused(tmp_path: Path) -> None:
    assert refused(tmp_path, BASIC[: BASIC.index("2    1    0.500") + 12]).code == "E-FILE-CUT"


def test_a_file_cut_anywhere_before_its_last_reading_is_said_to_be_cut(tmp_path: Path) -> None:
    whole = BASIC.rstrip("\n")
    complete = BASIC.index("ENVIRONMENT::") if "ENVIRONMENT::" in BASIC else BASIC.index("EOF::")
    for at in range(4, complete - 2):
        assert refused(tmp_path, whole[:at]).code == "E-FILE-CUT", whole[max(at - 30, 0) : at]


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="E-FILE-READ"):
        RtlFormat().read(tmp_path / "none.rtl")


def test_missing_readings_are_nan_and_said(tmp_path: Path) -> None:
    found = read(tmp_path, BASIC.replace("2    2    1.625\n", ""))
    assert np.isnan(found.deviations).sum() == 1
    assert np.isnan(found.deviations[1, 0, 1])
    assert any("readings missing: 1" in warning for warning in map(str, found.warnings))


def test_targets_that_fall_turn_the_set_round(tmp_path: Path) -> None:
    found = read(tmp_path, BASIC.replace("-50.000000  0.000000  50.000000", "50.0 0.0 -50.0"))
    assert found.targets.tolist() == [-50, 0, 50]
    assert found.deviations[:, 0, 1].tolist() == [2.375, 1.25, 0.0]
    assert found.deviations[:, 0, 0].tolist() == [2.875, 1.625, 0.5]


def test_zero_even_runs_are_no_measurement_without_a_word(tmp_path: Path) -> None:
    zero = BASIC
    for value in ("2.875", "1.625", "0.500"):
        zero = zero.replace(value, "0.000")
    assert any("one way only" in warning for warning in map(str, read(tmp_path, zero).warnings))
    flagged = read(tmp_path, zero.replace("Flags: 0 0 2 0", "Flags: 0 1 2 0"))
    assert np.isnan(flagged.deviations[:, :, 1]).all()


def test_doubts_about_units(tmp_path: Path) -> None:
    assert any("unit" in warning for warning in map(str, read(tmp_path, BASIC, unit="mm").warnings)) is False
    assert any("unit" in warning for warning in map(str, read(tmp_path, BASIC.replace("2.375", "9375.0")).warnings))
    with pytest.raises(ConfigError, match="E-FILE-UNIT"):
        RtlFormat(unit="arcsec")


def test_an_rta_wants_its_unit_confirmed() -> None:
    path = FOLDER / "rotary.rta"
    with pytest.raises(ConfigError) as caught:
        RtaFormat().read(path)
    assert (caught.value.code, caught.value.exit_code) == ("E-FILE-RTA-UNIT", 2)
    assert "0.022" in str(caught.value)
    with pytest.raises(ConfigError, match="E-FILE-UNIT"):
        RtaFormat(unit="gon")
    mrad, urad, arcsec = (RtaFormat(unit=unit).read(path).deviations for unit in ("mrad", "urad", "arcsec"))
    assert mrad == pytest.approx(urad * 1000)
    assert mrad == pytest.approx(arcsec * 206.26480625, rel=1e-9)


def test_an_rta_of_impossible_size_is_doubted(tmp_path: Path) -> None:
    path = tmp_path / "a.rta"
    path.write_bytes((FOLDER / "rotary.rta").read_bytes().replace(b"0.012000", b"12.00000"))
    assert any("unit" in warning for warning in map(str, RtaFormat(unit="mrad").read(path).warnings))


@pytest.mark.parametrize(("pressure", "hpa", "doubted"), [
    ("99.04 99.05", 990.4, False), ("990.4 990.5", 990.4, True), ("0.0 0.0", None, True),
])  # fmt: skip
def test_pressure_units(tmp_path: Path, pressure: str, hpa: float | None, doubted: bool) -> None:
    found = read(tmp_path, BASIC.replace("EOF::", f"ENVIRONMENT::\nAir Press : {pressure} 1\n\nEOF::"))
    assert found.ambient_start.pressure_hpa == (None if hpa is None else pytest.approx(hpa))
    assert any("pressure" in warning for warning in map(str, found.warnings)) is doubted


def test_a_broken_environment_value_is_named(tmp_path: Path) -> None:
    error = refused(tmp_path, BASIC.replace("EOF::", "ENVIRONMENT::\nAir temp : 20.0 warm 0\n\nEOF::"))
    assert error.code == "E-FILE-VALUE"
    assert "Air temp" in str(error)


numbers = st.integers(-9_000_000, 9_000_000).map(lambda value: value / 1000)
words = st.text("abcXYZ 019.-", max_size=12).map(str.strip)


@st.composite
def texts(draw: st.DrawFn) -> RtlText:
    targets = tuple(sorted(draw(st.sets(numbers, min_size=1, max_size=13))))
    runs = draw(st.integers(1, 6))
    rows = [(run, at, draw(numbers)) for run in range(1, runs + 1) for at in range(1, len(targets) + 1)]
    kept = draw(st.permutations(rows))
    sections = (
        ("HEADER", (f"Owner : {draw(words)}",)),
        ("TARGET DATA", (f"Target-count: {len(targets)}", "Flags: 0 0 2 0")),
        ("RUNS", (f"Run-count:{runs}",)),
        ("DEVIATIONS", ("Run Target Data:",)),
        ("SOMETHING NEW", (f"free {draw(words)}", "key : value")),
    )
    return RtlText(targets, runs, tuple(kept), sections)


@given(texts())
@settings(max_examples=60, deadline=None)
def test_text_to_record_and_back(content: RtlText) -> None:
    assert parse(render(content), "x") == content


@given(st.integers(2, 12), st.integers(1, 5), st.randoms(use_true_random=False))
@settings(max_examples=40, deadline=None)
def test_a_measured_set_survives_its_file(count: int, repetitions: int, chance: random.Random) -> None:
    targets = np.cumsum([chance.randrange(1, 50_000) / 1000 for _ in range(count)]) - 20
    deviations = np.round(np.array([chance.uniform(-40, 40) for _ in range(count * repetitions * 2)]), 6)
    deviations = deviations.reshape(count, repetitions, 2)
    deviations[0, 0, 1] = np.nan
    header = {"Machine": "M 1", "EQUIPMENT": "Laser : 7", "Air temp": "20.5 20.6 0"}
    measured = MeasuredSet(np.round(targets, 6), deviations, "mm", header=header)
    text = text_of(measured, "rtl")
    again = parse(text, "x")
    assert render(again) == text
    path_free = RtlFormat()
    from drivers.files.rtl import measured_set

    found = measured_set(again, "mm", path_free._convert, "x")
    assert found.targets == pytest.approx(measured.targets, abs=1e-6)
    assert np.allclose(found.deviations, deviations, atol=1e-6, equal_nan=True)
    assert found.ambient_start.air_degc == 20.5
    assert {key: found.header[key] for key in header} == header


def test_fuzz_from_the_files(tmp_path: Path) -> None:
    """Mutated files are read whole and finite, or refused by our exceptions; nothing else comes out."""
    chance = random.Random(11)
    base = (FOLDER / "environment.rtl").read_bytes()
    outcomes = {"read": 0, "refused": 0}
    path = tmp_path / "a.rtl"
    for _ in range(1500):
        data = bytearray(base)
        for _ in range(chance.randrange(1, 6)):
            at = chance.randrange(len(data))
            match chance.randrange(4):
                case 0:
                    del data[at : at + chance.randrange(1, 40)]
                case 1:
                    data[at:at] = chance.choice(
                        [b"\r\n", b"::", b" ", b",", b"1e9", b"-", b"\xff", b"9" * 30, b"EOF::"]
                    )
                case 2:
                    data[at] ^= 1 << chance.randrange(8)
                case _:
                    data[at:at] = data[at : at + 60]
        path.write_bytes(data)
        try:
            found = RtlFormat().read(path)
        except FileFormatError:
            outcomes["refused"] += 1
            continue
        outcomes["read"] += 1
        assert np.isfinite(found.targets).all()
        assert not np.isinf(found.deviations).any()
        assert (np.diff(found.targets) > 0).all()
    assert min(outcomes.values()) > 100, outcomes
