"""Tables of instruments with six channels: columns, senses, encodings, and the error of a point beside the beam."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from drivers.types.results import MeasuredSet
from gateway.cli import app
from gateway.evaluate.geometry.six_motions import point_error, six_motions
from gateway.store import RunFolder

ENGLISH = "Position (mm);Linear (um);Straightness Y (um);Straightness Z (um);Pitch (urad);Yaw (arcsec);Roll (um/m)"
GERMAN = "Position (mm);Linear (µm);Geradheit horizontal (µm);Geradheit vertikal (µm);Nicken (µrad);Gieren (arcsec)"
CHINESE = "位置（mm）;定位（um）;水平直线度（um）;垂直直线度（um）;俯仰（urad）;偏摆（arcsec）;滚转（urad）"
FRENCH = "Cible (mm);Linéaire (um);Rectitude Y (um);Rectitude Z (um);Tangage (urad);Lacet (arcsec);Roulis (urad)"
RUSSIAN = "Позиция (mm);Линейное (um);Прямолинейность Y (um);Прямолинейность Z (um);Тангаж (urad);Рыскание (arcsec)"
SENSES = ("EYX_sense=1", "EZX_sense=-1", "EBX_sense=-1", "ECX_sense=1", "EAX_sense=1")
URAD = 1.0 / 4.84813681109536


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def rows(width: int, comma: bool = False) -> str:
    """Reading of column c at target k, run r: c + k / 10 + r / 100, forward then reverse."""
    lines = []
    for run in (1, 2):
        for sign, order in (("+", range(4)), ("-", range(3, -1, -1))):
            for k in order:
                cells = [f"{100 * k}", *(f"{c + k / 10 + run / 100:.2f}" for c in range(1, width)), sign, str(run)]
                lines.append(";".join(cells).replace(".", "," if comma else "."))
    return "\n".join(lines) + "\n"


def table(name: str, heading: str, above: str = "", codec: str = "utf-8", more: str = ";Direction;Run") -> Path:
    text = above + heading + more + "\n" + rows(heading.count(";") + 1, comma=codec == "cp1252")
    Path(name).write_bytes(text.encode(codec))
    return Path(name)


def run(*words: str) -> Any:
    return CliRunner().invoke(app, [*words, "--json"])


def said(*columns: str) -> list[str]:
    return [word for one in columns for word in ("--column", one)]


def told(*words: str) -> Any:
    result = run(*words)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def code(*words: str) -> str:
    result = run(*words)
    if isinstance(result.exception, TrueflankError):
        return result.exception.code
    found = json.loads(result.stdout)
    return str(found[0]["error"]["code"])


def test_axis_and_senses_are_asked_and_kept_for_the_instrument() -> None:
    above = "Laser serial: 6D-77\nOperator: Meier\nAir temperature: 20.1 C\n\n"
    table("a.csv", ENGLISH, above)
    assert code("import", "a.csv") == "E-IMPORT-MOTION-AXIS"
    assert code("import", "a.csv", *said("axis=X")) == "E-IMPORT-MOTION-SENSE"
    found = told("import", "a.csv", *said("axis=X", *SENSES))
    assert [one["component"] for one in found] == ["EXX", "EYX", "EZX", "EBX", "ECX", "EAX"]
    sets = [RunFolder(Path(one["folder"])).get("measured", MeasuredSet) for one in found]
    first = [float(one.deviations[1, 0, 0]) for one in sets]  # target 100, run 1, forward
    np.testing.assert_allclose(first, [1.11, 2.11, -3.11, -4.11 * URAD, 5.11, 6.11 * URAD], rtol=1e-9)
    # Another heading of the same instrument: nothing is asked twice; another axis is.
    table("b.csv", ENGLISH.replace("Linear", "Linear error"), above + "Axis: X\n")
    again = told("import", "b.csv")
    assert len(again) == len(found)
    assert any("senses of instrument 6D-77" in note for note in again[0]["notes"])
    table("y.csv", ENGLISH.replace("Straightness Y", "Straightness X"), above + "Axis: Y\n")
    assert code("import", "y.csv") == "E-IMPORT-MOTION-SENSE"
    # Pitch and yaw of a vertical axis mean nothing by themselves.
    table("z.csv", ENGLISH.replace("Straightness Z", "Straightness X"), above + "Axis: Z\n")
    assert code("import", "z.csv") == "E-IMPORT-MOTION-WHICH"


@pytest.mark.parametrize(
    ("heading", "codec", "above", "motions"),
    [
        (GERMAN, "cp1252", "Prüfer: Müller\nAchse: X\n", 5),
        (CHINESE, "gb18030", "机床：一号\n轴：X\n", 6),
        (FRENCH, "cp1252", "Opérateur: René\nAxe: X\n", 6),
        (RUSSIAN, "cp1251", "Ось: первая\nAxis: X\n", 5),
    ],
)
def test_headings_of_other_countries_in_their_code_pages(heading: str, codec: str, above: str, motions: int) -> None:
    above = above.replace("：", ": ")
    table("t.csv", heading, above, codec, more=";方向;次数" if codec == "gb18030" else ";Direction;Run")
    found = told("import", "t.csv", *said("axis=X", *SENSES))
    assert len(found) == motions
    yaw = next(one for one in found if one["component"] == "ECX")
    measured = RunFolder(Path(yaw["folder"])).get("measured", MeasuredSet)
    assert measured.deviations[2, 1, 1] == pytest.approx(5.22)


def test_declared_columns_skip_a_preamble_and_read_a_foreign_heading() -> None:
    above = "系统: 六维\n日期: 2026-03-04\n温度; 20.1\n\n"
    table("p.csv", CHINESE.replace("定位", "读数"), above, "gb18030", more=";方向;次数")
    columns = said("target=1", "deviation=2", "direction=8", "run=9", "confirmed=yes")
    (one,) = told("evaluate", "p.csv", *columns)
    assert (one["targets"], one["repetitions"], one["unit"]) == (4, 2, "um")
    assert one["M"] == pytest.approx(0.3)
    # A row whose target cannot be read is no heading: it is refused by its line, not passed over.
    lines = Path("p.csv").read_bytes().split(b"\n")
    lines[5] = b"x" + lines[5]
    Path("p.csv").write_bytes(b"\n".join(lines))
    refusal = run("evaluate", "p.csv", *columns)
    assert json.loads(refusal.stdout)[0]["error"]["code"] == "E-FILE-LINE"
    assert json.loads(refusal.stdout)[0]["error"]["fields"]["line"] == "6"


def test_a_point_beside_the_beam_moves_by_the_lever_of_the_angles() -> None:
    names = ("Position (mm)", "EXX (um)", "EYX (um)", "EZX (um)", "EAX (urad)", "EBX (urad)", "ECX (urad)")
    lines = [";".join((*names, "Direction", "Run"))]
    for number in (1, 2):
        for sign in "+-":
            for k in range(5):
                # Straightness and linear motion are nought, angles curves of their own, in urad.
                cells = (100 * k, 0, 0, 0, 3 * k * (4 - k), 2 * k, k**2)
                lines.append(";".join(map(str, (*cells, sign, number))))
    Path("six.csv").write_text("\n".join([*lines, ""]), encoding="utf-8")
    found = told("evaluate", "six.csv", "--kind", "six-dof", "--offset", "0,200,500")
    figures = {one["name"]: one["value"] for one in found["figures"]}
    k = np.arange(5.0)
    along = (2 * k * 500.0 - k**2 * 200.0) * 1e-3  # EBX z - ECX y, um
    across = -(3 * k * (4 - k)) * 500.0 * 1e-3  # -EAX z
    assert figures["point along X range"] == pytest.approx(np.ptp(along), abs=1e-9)
    assert figures["point along Y range"] == pytest.approx(np.ptp(across), abs=1e-9)  # symmetric: its line is level
    assert code_of_kind("six.csv", "--offset", "1,2") == "E-CLI-OFFSET"
    assert code_of_kind("six.csv", "--axis", "Y") in ("E-SIX-MISSING", "E-EXPORT-AXIS")


def code_of_kind(*words: str) -> str:
    result = CliRunner().invoke(app, ["evaluate", *words, "--kind", "six-dof", "--json"])
    assert isinstance(result.exception, TrueflankError)
    return result.exception.code


def test_covariance_of_common_scatter_is_kept_by_the_point() -> None:
    rng = np.random.default_rng(5)
    targets, runs = np.arange(0.0, 500.0, 50.0), 40
    shape = (targets.size, runs, 2)
    # A head that tilts about Y: 1 arcsec of pitch stands with -1.5 um of height; nothing else scatters as much.
    tilt = rng.normal(0.0, 1.0, shape)
    noise = rng.normal(0.0, 0.05, (6, *shape))
    own = {"EXX": 0.0, "EYX": 0.0, "EZX": -1.5 * tilt, "EAX": 0.0, "EBX": tilt, "ECX": 0.0}
    readings = {name: value + noise[k] for k, (name, value) in enumerate(own.items())}
    found = six_motions("X", targets, readings)
    assert found.covariance is not None
    np.testing.assert_allclose(found.covariance[2, 4], -1.5, rtol=0.1)
    # Independently: at x the height is EZX - EBX x (1 arcsec over 1 mm = 4.848e-3 um), scatter taken from the readings.
    x = -300.0
    point = readings["EZX"] - readings["EBX"] * x * 4.84813681e-3
    scatter = np.sqrt(np.mean(np.var(point, axis=1, ddof=1)))
    at = point_error(found, (x, 0.0, 0.0))
    assert at.U is not None
    assert at.U_independent is not None
    assert at.U[0, 2] == pytest.approx(2.0 * scatter / np.sqrt(2 * runs), rel=1e-6)
    assert at.U_independent[0, 2] > 5.0 * at.U[0, 2]
    # A lost roll leaves the other channels valid.
    readings["EAX"][3, 0, 0] = np.nan
    assert six_motions("X", targets, readings).means[3, 0] == pytest.approx(found.means[3, 0])
