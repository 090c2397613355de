"""Files of gear measuring machines: curves, values, contour scans and traces, by what public readers of them found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import registry
from drivers.errors import ConfigError, FileFormatError, TrueflankError
from drivers.files.gear import GearColumns, read_gear_table
from drivers.files.klingelnberg import is_contour, read_contour, read_mew, read_mka
from drivers.message import render
from drivers.types.gears import GearTraces

TEETH, MODULE, BASE = 52, 1.0, 26.0 * np.cos(np.deg2rad(20.0))
DA, D1, D2, DE = 50.156, 50.6, 53.8, 54.2


def roll(diameter: float) -> float:
    """Roll length of a spur gear of the header below, by Pythagoras."""
    return float(np.sqrt((diameter / 2.0) ** 2 - BASE**2))


def rows(values: np.ndarray) -> str:
    texts = [f"{one:.3f}" for one in values]
    return "\n".join("  ".join(texts[at : at + 12]) for at in range(0, len(texts), 12))


def curves(count: int = 480) -> tuple[np.ndarray, np.ndarray]:
    """Deviations to DIN: a profile that rises by 10 um from D1 to D2, a lead that falls by 6 um over 15 mm."""
    along, height = np.linspace(roll(DA), roll(DE), count), np.linspace(0.0, 15.0, count)
    return 10.0 * (along - roll(D1)) / (roll(D2) - roll(D1)), -6.0 * height / 15.0


def mka(count: int = 480, **header: str) -> str:
    profile, lead = curves(count)
    words = {
        "21": "1.000", "22": "52 : aussen", "23": "0.0000", "24": "20.0000", "26": "15.000", "41": f"{DA}",
        "42": f"{D1}", "43": f"{D2}", "44": f"{DE}", "61": "0.000", "62": "1.500", "63": "13.500", "64": "15.000",
        "178": "1", "179": "1", "180": "0", **header,
    }  # fmt: skip
    numbered = "\n".join(f"  {key:>3}  :label.........: {value}" for key, value in words.items())
    return (
        "\ufeffHEADER KS.MK.FILE\nTYPE      GEAR ! kind\nUNITS     MM\n" + numbered + "\n"
        f"Flankenlinie:\nZahn-Nr.: 44 links / {count}  Werte  x= 8.742\n{rows(-lead)}\n"
        f"Profil:\nZahn-Nr.: 44 links / {count}  Werte  z= 7.5\n{rows(-profile)}\n"
        f"Zahn-Nr.: 44 rechts / {count} Werte / z= 7.5\n{rows(profile)}\n"
        "linke Zahnflanke\nZahn-Nr.   fp     Fp     Fr\n 1  1.5  0.0  3.0\n 2  -2.5  -2.5  5.0\n 3  1.0  -1.5  1.0\n"
    )


def test_curves_have_the_sign_of_material_and_run_in_roll_length() -> None:
    profile, lead = curves()
    found = read_mka(mka(), "x.mka")
    assert [(one.feature, one.tooth, one.flank) for one in found.curves] == [
        ("lead", "44", 1), ("profile", "44", 1), ("profile", "44", -1),
    ]  # fmt: skip
    np.testing.assert_allclose(found.curves[0].deviation_um, lead, atol=1e-3)
    for curve in found.curves[1:]:
        np.testing.assert_allclose(curve.deviation_um, profile, atol=1e-3)
        assert curve.along_mm[0] == pytest.approx(roll(DA))
        assert np.ptp(np.diff(curve.along_mm)) < 1e-9
        assert curve.judged_mm == pytest.approx((roll(D1), roll(D2)))
    assert found.pitch_um[1].tolist() == [[1.5, 0.0, 3.0], [-2.5, -2.5, 5.0], [1.0, -1.5, 1.0]]
    assert found.width_mm == 15.0


def test_a_helical_gear_has_the_base_radius_of_its_transverse_section() -> None:
    """m_n = 1, z = 52, beta = 10 deg: m_t = 1.015427, alpha_t = 20.2836 deg, r_b = 24.7640 (by hand)."""
    found = read_mka(mka(**{"23": "10.0000", "41": "50.6", "42": "50.8"}), "x.mka")
    wanted = np.sqrt(25.3**2 - 24.7640**2)
    assert found.curves[1].along_mm[0] == pytest.approx(wanted, abs=2e-3)


def test_older_heads_undefined_values_and_twist() -> None:
    profile, _ = curves(915)
    raw = profile.copy()
    raw[3] = -2147483.648
    twist = "Verschränkung: Zahn-Nr.: 1k /Flankenlinie:3 links\nProfil: Zahn-Nr.: 1a links"
    text = mka(915).replace("Profil:\nZahn-Nr.: 44 links", twist)
    text = text.replace("Werte  z= 7.5", "Werte / d= 47.82").replace(rows(profile), rows(raw))
    found = read_mka(text, "x.mka")
    assert found.curves[1].tooth == "1a"
    assert np.flatnonzero(np.isnan(found.curves[2].deviation_um)).tolist() == [3]
    told = [render(one) for one in found.warnings]
    assert "1 curve of twist" in told[0]
    assert "1 point of the curves" in told[1]


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("KS.MK.FILE", "KS.XX.FILE", "E-GEARFILE-HEAD"),
        ("links / 480", "links / 492", "E-GEARFILE-COUNT"),
        ("links / 480", "links / 470", "E-GEARFILE-COUNT"),
        ("178  :label.........: 1", "178  :label.........: 0", "E-GEARFILE-SETTING"),
        ("180  :label.........: 0", "180  :label.........: 1", "E-GEARFILE-SETTING"),
        ("   22  :label.........: 52 : aussen\n", "", "E-GEARFILE-FACT"),
        (f": {DA}", ": 40.0", "E-GEARFILE-FACT"),
        (f": {D1}", ": 54.0", "E-GEARFILE-RANGE"),
        ("links / 480", "links / 999999", "E-FILE-SIZE"),
    ],
)
def test_curves_that_cannot_be_placed_are_refused(old: str, new: str, code: str) -> None:
    text = mka()
    assert old in text
    with pytest.raises(FileFormatError) as wrong:
        read_mka(text.replace(old, new), "x.mka")
    assert wrong.value.code == code


MEW = (
    "HEADER KS.MW.FILE\n  22 :Zaehnezahl ..: 52\n11131 : fHb li mittel : 7.2\n21011 : fHa Zahn 1 : -9999\n"
    "24411 : Profil : 3.1\n26411 : Fusskreis : 47.5\n21021 : fHa Zahn 1 re : 8999\n"
)


def test_values_keep_the_makers_code_and_leave_out_what_was_not_measured() -> None:
    found = read_mew(MEW, "x.mew")
    assert [(one.kind, one.value) for one in found.figures] == [("11131", 7.2), ("24411", 3.1), ("26411", 47.5)]
    with pytest.raises(FileFormatError) as other:
        read_mew(MEW.replace("fHb li mittel", "Profil mittel"), "x.mew")
    assert (other.value.code, other.value.fields["number"]) == ("E-GEARFILE-CODE", "11131")
    with pytest.raises(FileFormatError) as empty:
        read_mew("HEADER KS.MW.FILE\n", "x.mew")
    assert empty.value.code == "E-FILE-ROWS"


SCAN = "[A]\n1; 3.418; 26.143; 87.572;\n2; 3.408; 26.150; 87.572;\n[B]\n1; 3.418; 26.144; 87.572;\n"


def test_sections_of_a_contour_scan() -> None:
    found = read_contour(SCAN, "x.dat")
    assert found.points_mm.tolist() == [[3.418, 26.143, 87.572], [3.408, 26.150, 87.572], [3.418, 26.144, 87.572]]
    assert found.section.tolist() == [0, 0, 1]
    assert is_contour(SCAN)
    assert not is_contour("[X]\n-300, 0.000, 0.012\n")


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (SCAN.removeprefix("[A]\n"), "E-GEARFILE-HEAD"),
        (SCAN.replace("2; 3.408", "3; 3.408"), "E-GEARFILE-INDEX"),
        (SCAN.replace("26.150; 87.572", "26.150; 88.572"), "E-GEARFILE-PLANE"),
        (SCAN.replace("26.150", "---"), "E-FILE-LINE"),
        (SCAN.replace("26.150", "26150"), "E-FILE-GEAR-SIZE"),
        ("[A]\n", "E-FILE-ROWS"),
    ],
)
def test_contour_scans_that_are_wrong_are_refused(text: str, code: str) -> None:
    with pytest.raises(FileFormatError) as wrong:
        read_contour(text, "x.dat")
    assert wrong.value.code == code


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([(read_mka, mka(24)), (read_mew, MEW), (read_contour, SCAN)]), st.data())
def test_files_that_are_broken_anywhere_are_read_or_refused(case: tuple[Any, str], data: st.DataObject) -> None:
    read, text = case
    at = data.draw(st.integers(0, len(text) - 1))
    piece = data.draw(st.sampled_from(["", "9" * 400, "\0", "-", ";", "[", "\n", "NaN", "\u00b5", ":", "1e999"]))
    try:
        read(text[:at] + piece + text[at + data.draw(st.integers(0, 6)) :], "x")
    except TrueflankError as error:
        told = str(error)
    else:
        told = "-> read"
    assert "-> " in told


TRACES = "tooth;flank;diameter;z;dev\n0;left;121,0;2,0;1,5\n1;右;122,0;8,0;-0,5\n"
TRACE_COLUMNS = {"space": 1, "flank": 2, "diameter": 3, "z": 4, "deviation": 5, "decimal_comma": True}


def test_a_trace_without_angles_keeps_radius_height_and_deviation() -> None:
    found = read_gear_table(TRACES, GearColumns.read(TRACE_COLUMNS, "x"), "x")
    assert isinstance(found, GearTraces)
    assert (found.radius_mm.tolist(), found.z_mm.tolist()) == ([60.5, 61.0], [2.0, 8.0])
    assert (found.deviation_um.tolist(), found.flank.tolist()) == ([1.5, -0.5], [1, -1])
    assert [one.code for one in found.warnings] == ["S-GEARFILE-TRACES"]
    with pytest.raises(ConfigError) as placeless:
        GearColumns.read({key: value for key, value in TRACE_COLUMNS.items() if key != "deviation"}, "x")
    assert placeless.value.fields["key"] == "x"


def test_files_are_read_by_their_driver(tmp_path: Path) -> None:
    for name, ending, text in (("mka", "mka", mka()), ("mew", "mew", MEW), ("contour", "dat", SCAN)):
        path = tmp_path / f"x.{ending}"
        path.write_text(text, encoding="latin-1" if name == "contour" else "utf-8")
        assert registry.load(name, "gear-curves")().read(path)
