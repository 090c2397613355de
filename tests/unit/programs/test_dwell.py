"""Programs for capture programs of others: what they hold, how the double runs them, what is refused."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError, TrueflankError
from drivers.programs import NOBODY
from drivers.sinumerik.ncprogram.measuring import build_dwell_program
from gateway.cli import app
from gateway.config import load_site
from gateway.workflow.programs import DwellOptions, _dwell_programs
from tests.unit.nck.bench import SPEC, on_bench
from tests.unit.programs.sites import site_file
from tests.unit.sinumerik.test_grindprogram import PLAN, Walk

RUNNER = CliRunner()
TRAVELS = tuple(replace(axis, travel=(-420.0, 320.0)) if axis.letter == "X" else axis for axis in SPEC.axes)


def written(site: Path, folder: Path, *words: object) -> str:
    given = ["check", "programs", site, "-o", folder, "--what", "dwell", *words]
    result = RUNNER.invoke(app, list(map(str, given)), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_each_target_is_stood_at_in_both_directions_and_nothing_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    site = site_file(tmp_path, "demo")
    told = written(site, folder, "--dwell", 4.5, "--settling", 3)
    text = (folder / "dwell-X-TFDWEL_X1.MPF").read_text()
    assert len(text.splitlines()) < 60
    rows = list(csv.DictReader((folder / "dwell-X-stops.csv").read_text().splitlines()))
    assert {row["direction"] for row in rows} == {"+", "-"}
    assert not re.search(r"^[R$].*=", text, re.MULTILINE)
    wanted = [(float(row["target_mm"]), row["direction"]) for row in rows]
    (_, order), *_ = _dwell_programs(load_site(site), DwellOptions(4.5, 3.0))
    unrolled = build_dwell_program(order, modulo=False, origin=NOBODY, loops=False)
    assert unrolled.count("SUPA G1 X=") > len(rows)
    for program in (text, unrolled):  # each dwell follows a move to the target that the list names, from its side
        walk = Walk(PLAN, {}, {"X": -3.0})
        walk.run(program)
        sides, last = [], 0
        for at, seconds in walk.stood:
            last = next(place for place in range(last, len(walk.moves) + 1) if walk.moves[place][2] == at["X"])
            _, here, to = walk.moves[last]
            sides.append((to, "+" if here < to else "-"))
            last += 1
            assert seconds == 4.5
        assert sides == wanted
        assert walk.said == ['MSG("AT THE FIRST TARGET: ZERO THE LASER, START THE CAPTURE, PRESS NC START")', 'MSG("")']
    listed = [float(line) for line in (folder / "dwell-X-targets.txt").read_text().split()]
    assert listed == sorted({float(row["target_mm"]) for row in rows})
    assert f"X1: {len(rows)} stops of 4.5 s" in told


@pytest.mark.parametrize("letter", ["X", "C"])
async def test_the_person_zeroes_the_laser_at_the_first_target_itself(tmp_path: Path, letter: str) -> None:
    """By the positions that the control records: at M0 the axis stands there, come from the side of the first stop."""
    folder = tmp_path / "out"
    written(site_file(tmp_path, "demo"), folder)
    text = (folder / f"dwell-{letter}-TFDWEL_{letter}1.MPF").read_text()
    first = next(csv.DictReader((folder / f"dwell-{letter}-stops.csv").read_text().splitlines()))
    target = float(next(value for name, value in first.items() if name.startswith("target")))
    moved, sign = 0.0, 1.0 if first["direction"] == "+" else -1.0
    async with on_bench(axes=TRAVELS) as bench:
        bench.press_start(text)
        before = float(bench.nck.get(f"$AA_IM[{letter}1]"))
        for _ in range(100_000):
            now = float(bench.nck.get(f"$AA_IM[{letter}1]"))
            if now != before:
                moved, before = now - before, now
            if bench.nck.channel_status != 1:
                break
            await bench.sleep(0.1)
        assert bench.nck.message.startswith("AT THE FIRST TARGET")
        assert before == pytest.approx(target, abs=1e-6)
        assert ((moved + 180.0) % 360.0 - 180.0) * sign > 0.0


def test_a_rotary_calibrator_is_not_outrun(tmp_path: Path) -> None:
    site = site_file(tmp_path, "demo")
    text = site.read_text()
    told = written(site, tmp_path / "out", "--calibrator-feed", 100)
    feeds = {word for word in (tmp_path / "out" / "dwell-C-TFDWEL_C1.MPF").read_text().split() if word.startswith("F=")}
    assert feeds == {"F=100.0"}
    assert "feed 100 deg/min instead of" in told
    assert site.read_text() == text


def test_too_short_a_dwell_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with pytest.raises(ConfigError) as refused:
        written(site_file(tmp_path, "demo"), folder, "--dwell", 2, "--settling", 2)
    assert refused.value.code == "E-DWELL-SHORT"
    assert not folder.exists()


def test_a_road_without_programs_gets_them_too(tmp_path: Path) -> None:
    mailbox = Path(__file__).parents[3] / "examples" / "sites" / "mailbox-grinder.toml"
    written(mailbox, tmp_path / "out")
    assert (tmp_path / "out" / "dwell-X-TFDWEL_X1.MPF").exists()
    for what, code in (("measure", "E-PROGRAM-NO-ROAD"), ("grind", "E-PROGRAM-NOTHING")):
        with pytest.raises(ConfigError) as refused:
            RUNNER.invoke(
                app, ["check", "programs", str(mailbox), "-o", str(tmp_path), "--what", what], catch_exceptions=False
            )
        assert refused.value.code == code


@pytest.mark.parametrize(
    ("example", "was", "now", "code"),
    [
        ("mailbox-grinder", 'driver = "sinumerik-modbus"', 'driver = "sinumerik-modbuss"', "E-CFG-DRIVER"),
        ("carried-grinder", 'axes = "X1 Z1 C1"', 'axes = "X1 Z1"', "E-NC-AXIS"),
    ],
)
def test_a_site_that_names_what_is_not_there_is_told_so(
    tmp_path: Path, example: str, was: str, now: str, code: str
) -> None:
    text = (Path(__file__).parents[3] / "examples" / "sites" / f"{example}.toml").read_text(encoding="utf-8")
    assert was in text
    site = tmp_path / "site.toml"
    site.write_text(text.replace(was, now), encoding="utf-8")
    with pytest.raises(TrueflankError) as refused:
        RUNNER.invoke(
            app, ["check", "programs", str(site), "-o", str(tmp_path / "out"), "--what", "off"], catch_exceptions=False
        )
    assert refused.value.code == code


def test_a_control_that_is_carried_to_is_asked_in_steps(tmp_path: Path) -> None:
    """`doctor identity` says what to carry and ends, as `doctor devices` does; it waits for nobody."""
    text = (Path(__file__).parents[3] / "examples" / "sites" / "carried-grinder.toml").read_text(encoding="utf-8")
    site = tmp_path / "site.toml"
    site.write_text(text, encoding="utf-8")
    for _ in range(2):
        with pytest.raises(TrueflankError) as waits:
            RUNNER.invoke(app, ["doctor", "identity", str(site)], catch_exceptions=False)
        assert (waits.value.code, waits.value.exit_code) == ("E-OFF-CARRY", 15)
    assert (tmp_path / "carried" / "carry" / "TFSEE.MPF").exists()


@pytest.mark.parametrize("command", ["accept", "compare"])
def test_consent_to_a_trial_names_its_own_option(tmp_path: Path, command: str) -> None:
    site = site_file(tmp_path, "demo")
    with pytest.raises(TrueflankError) as refused:
        RUNNER.invoke(
            app, ["doctor", command, str(site), "--level", "write", "--machine", "other"], catch_exceptions=False
        )
    assert (refused.value.code, "--level write" in refused.value.what) == ("E-ACCEPT-NAME", True)
