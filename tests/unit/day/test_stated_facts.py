"""What files state of machine, people, day and settings: read, compared with the site and between files, asked once."""

from __future__ import annotations

import json
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

import trueflank as tf
from drivers.errors import ConfigError, TrueflankError
from gateway.cli import app
from gateway.config import SiteFile
from gateway.domain.stated import StatedFacts
from gateway.store import Maps, Store
from gateway.workflow.files.headers import days_of
from gateway.workflow.files.importing import watcher_of
from gateway.workflow.files.statements import FileFacts, differences, facts_of, quantity, settle, settle_setup
from simulators.cell.site import section
from tests.unit.components.site import site_data, site_of

TABLE = "target_mm;direction;run;deviation_um\n0;+;1;1\n9;+;1;2\n9;-;1;3\n0;-;1;2\n0;+;2;1\n9;+;2;3\n9;-;2;3\n0;-;2;1\n"
MACHINE: dict[str, Any] = {"maker": "Qinchuan", "type": "YK7350B", "number": "4711", "year": 2012}


NOW = datetime(2026, 11, 28, tzinfo=UTC)


def site(**more: Any) -> SiteFile:
    return site_of([], machine=MACHINE, **more)


@pytest.mark.parametrize(
    ("text", "day"),
    [
        ("2024-03-02", date(2024, 3, 2)),
        ("2024/3/2 14:05", date(2024, 3, 2)),
        ("02.03.2024", date(2024, 3, 2)),
        ("2.3.24", date(2024, 3, 2)),
        ("2. März 2024", date(2024, 3, 2)),
        ("Mar 2, 2024", date(2024, 3, 2)),
        ("2 March 2024", date(2024, 3, 2)),
        ("Sat Mar  2 14:05:00 2024", date(2024, 3, 2)),
        ("2024年3月2日", date(2024, 3, 2)),
        ("20240302", date(2024, 3, 2)),
        ("13/3/2024", date(2024, 3, 13)),
        ("3/2/2024", None),
        ("2024", None),
        ("31.02.2024", None),
        ("yesterday", None),
    ],
)
def test_a_date_is_a_day_whatever_its_language_or_no_single_day(text: str, day: date | None) -> None:
    assert days_of(text).day == day


def test_dates_are_compared_as_days_not_as_texts() -> None:
    same = [
        FileFacts(str(at), said={"date": text}) for at, text in enumerate(("2024-03-02", "2. März 2024", "3/2/2024"))
    ]
    assert differences(same) == ()
    late = FileFacts("old", said={"date": "02.03.2017"})
    (one,) = differences([*same, late])
    assert (one.file, one.key, one.value) == ("old", "date", "02.03.2017")


@pytest.mark.parametrize(
    ("key", "value", "differs"),
    [
        ("machine", "Qinchuan YK7350B", False),
        ("machine", "YK-7350B", False),
        ("machine", "grinder", False),
        ("machine", "Grinder 2", True),
        ("machine", "Mill 7", True),
        ("serial", "SN 04711", False),
        ("serial", "4712", True),
        ("operator", "J. Weiß", False),
        ("operator", "Li Na", True),
        ("place", "halle 3, jena", False),
        ("place", "Halle 4", True),
        ("feed", "3 m/min", False),
        ("feed", "F1000 mm/min", True),
        ("dwell", "1000 ms", False),
        ("dwell", "5 s", True),
        ("date", "2011", True),
        ("date", "14.05.2019", True),
        ("date", "2024-03-02", False),
        ("instrument_serial", "77", True),
    ],
)
def test_a_statement_is_compared_with_the_site(key: str, value: str, differs: bool) -> None:
    told = {"operator": "Jürgen Weiss", "place": "Halle 3"}
    laser = {"name": "head", "serial": "78", "calibrated": "2020-01-31"}
    known = site(report=told, equipment=[laser])
    assert bool(differences([FileFacts("a", "X", {key: value})], known)) is differs


def test_settings_are_compared_between_files_of_one_axis_only() -> None:
    files = [FileFacts(name, axis, {"feed": feed}) for name, axis, feed in (("a", "X", "500"), ("b", "Z", "900"))]
    assert differences(files) == ()
    (one,) = differences([*files, FileFacts("c", "Z", {"feed": "901 mm/min"}), FileFacts("d", "Z", {"feed": "900"})])
    assert (one.file, one.other) == ("c", "900")
    assert quantity("feed", "500") is None, "a number without a unit is no quantity"


def test_a_header_is_read_in_the_languages_of_the_field_and_a_section_of_equipment_is_the_instruments() -> None:
    header = {
        "Maschine": "Mill 7",
        "Prüfer": "Li Na",
        "Vorschub": "500 mm/min",
        "日期": "2024-03-02",
        "By": "",
        "Ort": "-",
    }
    found = facts_of("a", {**header, "EQUIPMENT": "Laser : XL 1234\nSerial No: 88\nwithout a key"})
    wanted = {"machine": "Mill 7", "operator": "Li Na", "feed": "500 mm/min", "date": "2024-03-02"}
    assert dict(found.said) == {**wanted, "instrument": "XL 1234", "instrument_serial": "88"}


def test_a_difference_is_refused_asked_once_and_then_remembered_for_the_site(tmp_path: Path) -> None:
    files, maps = [FileFacts("a", said={"machine": "Mill 7"})], Maps(tmp_path)
    with pytest.raises(ConfigError, match=r'--accept "machine=Mill 7"'):
        settle(files, site(), maps=maps)
    with pytest.raises(ConfigError, match="E-FACTS-OTHER"):
        settle(files, site(), maps=maps, ask=lambda _one: False)
    asked: list[str] = []
    settle(files, site(), maps=maps, ask=lambda one: not asked.append(one.text))
    found = settle(files, site(), maps=maps)
    assert asked == ["machine=Mill 7"]
    assert [(one.value, one.source) for one in found.accepted] == [("Mill 7", "site")]
    with pytest.raises(ConfigError, match="E-FACTS-ACCEPT"):
        settle(files, site(), accepted=["colour=red"])


def site_file(folder: Path) -> Path:
    data = site_data([], machine=MACHINE)
    parts = [section(name, data[name]) for name in ("site", "controller", "machine")]
    parts += [section("[instruments]", one) for one in data["instruments"]]
    parts += [section("[axes]", one) for one in data["axes"]]
    path = folder / "site.toml"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def run(*words: str, typed: str | None = None) -> Result:
    return CliRunner().invoke(app, list(words), input=typed)


def test_every_command_with_a_site_refuses_another_machines_file_and_takes_it_once_it_was_accepted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    known = site_file(tmp_path)
    (tmp_path / "x.csv").write_text(f"Machine;Mill 7\nAxis;X\n{TABLE}", encoding="utf-8")
    commands = {name: (name, "x.csv", "--site", "site.toml") for name in ("evaluate", "import", "report")}
    for words in commands.values():
        result = run(*words, "--no-ask")
        said = result.output if result.exception is None else f"{result.output} {result.exception}"
        assert result.exit_code != 0
        assert "Mill 7" in said
        assert '--accept "machine=Mill 7"' in said
    watcher = watcher_of(site_of([], machine=MACHINE), known, tmp_path, utc=lambda: NOW, settle_s=0.0)
    assert watcher.look(0.0) == 0
    assert watcher.look(1.0) == 0
    assert not Store(tmp_path / "runs").runs()
    first = run("import", "x.csv", "--site", "site.toml", typed="y\n")
    assert first.exit_code == 0, first.output
    assert "accepted" in first.output
    for words in (commands["evaluate"], commands["report"]):
        result = run(*words, "--no-ask")
        assert result.exit_code == 0, result.output
    assert watcher.look(2.0) == 1, "what a person accepted holds for the watched folder too"


def test_files_of_one_command_are_compared_with_each_other_without_a_site(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, head in (("a", "Machine;Mill 7\nDate;3.2.2026"), ("b", "Machine;Mill 7"), ("c", "Date;3.2.2019")):
        (tmp_path / f"{name}.csv").write_text(f"{head}\n{TABLE}", encoding="utf-8")
    (tmp_path / "d.csv").write_text(f"Machine;Mill 8\nDate;May 3, 2199\n{TABLE}", encoding="utf-8")
    assert run("evaluate", "a.csv", "b.csv", "--no-ask").exit_code == 0
    (tmp_path / "e.csv").write_text(f"Machine;Mill 8\nDate;May 3, 2019\n{TABLE}", encoding="utf-8")
    assert run("evaluate", "e.csv", "--no-ask").exit_code == 0, "one file alone is compared with today alone"
    for words in (("evaluate",), ("import",), ("report",), ("evaluate", "--kind", "reversal")):
        for other, stated in (("c", "date=3.2.2019"), ("d", "machine=Mill 8")):
            result = run(words[0], "a.csv", f"{other}.csv", *words[1:], "--no-ask")
            assert result.exit_code != 0
            assert f'--accept "{stated}"' in f"{result.output} {result.exception}"
    words = ("evaluate", "a.csv", "d.csv", "--no-ask", "--accept", "machine=Mill 8", "--accept", "date=May 3, 2199")
    accepted = run(*words)
    assert accepted.exit_code == 0, accepted.output
    assert "accepted" in accepted.output


def test_a_date_that_is_still_to_come_is_asked_about() -> None:
    today = date(2026, 11, 28)
    for text, differs in (("29.11.2026", False), ("2026-11-30", True), ("3/12/2026", False), ("2027", True)):
        found = differences([FileFacts("a", said={"date": text})], None, today)
        assert bool(found) is differs, text


@pytest.mark.parametrize(
    "words",
    [
        ("evaluate",),
        ("evaluate", "--json"),
        ("evaluate", "--table", "t.csv"),
        ("evaluate", "--kind", "straightness"),
        ("report", "--no-ask"),
        ("import",),
        ("tables convert", "--to", "eec", "--axis", "X1", "--reference", "0", "--datum", "0=0", "-o", "o.spf"),
        ("tables convert", "--to", "linuxcnc", "--axis", "X", "--reference", "0", "--datum", "0=0", "-o", "o.comp"),
    ],
)
def test_no_command_takes_one_file_of_a_day_to_come_without_a_word(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "".join(
        f"{at},{way},{run},{at / 100 + run / 10}\n" for at in (0, 100, 200, 300) for way in "+-" for run in (1, 2)
    )
    head = "target_mm,direction,repetition,deviation_um"
    Path("a.csv").write_text(f"Machine: Mill 7\nDate: 2026-12-20\n{head}\n{rows}", encoding="utf-8")
    monkeypatch.setattr("gateway.cli.options._utc_now", lambda: NOW)
    command, *rest = words
    refused = CliRunner().invoke(app, [*command.split(), "a.csv", *rest])
    assert refused.exit_code not in (0, 21)
    said = f"{refused.output} {refused.exception}".replace("\\", "")
    assert "E-FACTS-DIFFER" in said
    assert '--accept "date=2026-12-20"' in said
    assert not Path("o.spf").exists()
    accepted = CliRunner().invoke(app, [*command.split(), "a.csv", *rest, "--accept", "date=2026-12-20"])
    assert accepted.exit_code == 0, accepted.output
    monkeypatch.setattr("gateway.cli.options._utc_now", lambda: NOW + timedelta(days=60))
    later = CliRunner().invoke(
        app, [*command.split(), "a.csv", *rest, *(("--force",) if command == "tables convert" else ())]
    )
    assert later.exit_code == 0, "what was to come is past"


def test_the_library_says_that_a_day_is_still_to_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "Date: 2026-12-20\ntarget_mm,direction,repetition,deviation_um\n0,+,1,1\n10,+,1,2\n20,+,1,4\n"
    (tmp_path / "a.csv").write_text(text)
    for today, said in ((date(2026, 11, 28), True), (date(2026, 12, 19), False)):
        monkeypatch.setattr("trueflank.measuring._today", lambda today=today: today)
        read = tf.read(tmp_path / "a.csv")
        assert any("2026-12-20" in one for one in read.warnings) is said
        assert any("2026-12-20" in one for one in tf.evaluate(read).notes) is said


def test_beside_a_site_a_date_of_more_than_a_year_ago_is_asked_about(tmp_path: Path) -> None:
    texts = [("28.11.2025", False), ("2025-11-26", True), ("May 3, 2019", True), ("11/27/25", False), ("2025", False)]
    for text, differs in (*texts, ("2024", True), ("some day", False)):
        one = FileFacts("a", said={"date": text})
        assert bool(differences([one], site(), NOW.date())) is differs, text
        assert differences([one], None, NOW.date()) == (), "without a site nobody judges a machine of today by it"
    old, maps = [FileFacts("a", said={"date": "May 3, 2019"})], Maps(tmp_path)
    with pytest.raises(ConfigError, match=r"May 3, 2019'.*2026-11-28(.|\n)*--accept \"date=May 3, 2019\""):
        settle(old, site(), maps=maps, utc=NOW)
    settle(old, site(), maps=maps, ask=lambda _one: True, utc=NOW)
    assert len(settle(old, site(), maps=maps, utc=NOW + timedelta(days=90)).accepted) == 1, "accepted once for all days"
    assert settle(old, site(), maps=Maps(tmp_path / "b"), utc=NOW, recent=False).accepted == ()


def test_no_command_takes_a_file_of_years_ago_for_a_site_without_a_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    known = site_file(tmp_path)
    (tmp_path / "x.csv").write_text(f"Axis;X\nDate;May 3, 2019\n{TABLE}", encoding="utf-8")
    for command in ("evaluate", "import", "report"):
        result = run(command, "x.csv", "--site", "site.toml", "--no-ask")
        assert result.exit_code != 0, command
        assert '--accept "date=May 3, 2019"' in f"{result.output} {result.exception}"
    watcher = watcher_of(site_of([], machine=MACHINE), known, tmp_path, utc=lambda: NOW, settle_s=0.0)
    watcher.look(0.0)
    assert watcher.look(1.0) == 0
    assert not Store(tmp_path / "runs").runs()
    day = tmp_path / "day"
    day.mkdir()
    (tmp_path / "x.csv").rename(day / "x.csv")
    error = run("day", "day", "--site", "site.toml", "--no-ask").exception
    assert isinstance(error, TrueflankError)
    assert 'accept = ["date=May 3, 2019"]' in error.what


def test_a_setup_takes_a_file_of_this_machine_or_one_that_it_accepts(tmp_path: Path) -> None:
    utc, maps, known = datetime(2026, 11, 28, tzinfo=UTC), Maps(tmp_path), site()
    one = FileFacts("x.rtl", "X", {"machine": "YK7350B", "date": "20.11.2026"})
    first = settle_setup(one, known, StatedFacts(), maps=maps, accepted=(), utc=utc)
    old = FileFacts("z.rtl", "Z", {"machine": "Mill 7", "date": "May 3, 2019"})
    with pytest.raises(ConfigError, match="E-FACTS-SETUP") as refused:
        settle_setup(old, known, first, maps=maps, accepted=(), utc=utc)
    accept = json.loads(f"[{refused.value.fields['accept']}]")
    assert accept == ["machine=Mill 7", "date=May 3, 2019"]
    both = settle_setup(old, known, first, maps=Maps(tmp_path / "b"), accepted=accept, utc=utc)
    assert both.values("machine") == ("YK7350B", "Mill 7")
    assert {one.key for one in both.accepted} == {"machine", "date"}
    again = settle_setup(old, known, both, maps=Maps(tmp_path / "c"), accepted=accept, utc=utc)
    assert again.facts == both.facts


def test_a_day_refuses_a_file_of_another_machine_and_year_and_prints_what_was_accepted(tmp_path: Path) -> None:
    known, folder = site_file(tmp_path), tmp_path / "day"
    folder.mkdir()
    for name, axis, head in (
        ("x", "X", "Machine;YK7350B\nDate;20.11.2026"),
        ("z", "Z", "Machine;Mill 7\nDate;May 3, 2019"),
    ):
        low, high = ("0", "300") if axis == "Z" else ("-300", "0")
        table = TABLE.replace("\n0", f"\n{low}#").replace("\n9", f"\n{high}").replace("#", "")
        (folder / f"{name}.csv").write_text(
            f"{head}\nAxis;{axis}\nTitle;E{axis}{axis}\nBy;Li Na\nFeed;3000 mm/min\n{table}"
        )
    kept = '[axes.X1]\ndatum = 0\ndirection = "+"\n[axes.Z1]\ndatum = 0\ndirection = "+"\n'
    (tmp_path / "day.answers.toml").write_text(kept)
    words = ("day", str(folder), "--site", str(known))
    error = run(*words, "--no-ask").exception
    assert isinstance(error, TrueflankError)
    assert error.code == "E-DAY-OPEN"
    line = next(one for one in error.what.splitlines() if one.startswith("accept = "))
    assert "machine=Mill 7" in line
    assert "date=May 3, 2019" in line or "date=20.11.2026" in line
    (tmp_path / "day.answers.toml").write_text(f"[all]\n{line}\n{kept}")
    told = run(*words, "--no-ask", "--json")
    assert told.exit_code == 0, told.output
    page = Path(json.loads(told.stdout)["report"]["pdf"]).with_suffix(".html").read_text(encoding="utf-8")
    assert "Accepted differences" in page
    assert "Mill 7" in page
    assert "Li Na (stated in the files)" in page
    assert "3000 mm/min" in page
    assert "UNPROTECTED" not in page
    (tmp_path / "day.answers.toml").write_text(kept)
    left = run(*words, typed="no\n")
    assert left.exit_code == 0, left.output
    assert 'files."z.csv"]\nuse = false' in (tmp_path / "day.answers.toml").read_text()
