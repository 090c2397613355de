"""The commands import, export, evaluate on runs, and dynamic: said once, remembered, shown, never overwritten."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers import registry
from drivers.clock import Clock
from drivers.errors import ConfigError, FileFormatError, TrueflankError
from drivers.files.rtl import RtlFormat
from drivers.files.rtx import RtxFormat
from drivers.types.identity import Identity
from drivers.types.results import MeasuredSet
from drivers.types.sensing import SampleBlock
from gateway.capture.corrections import from_live
from gateway.cli import app
from gateway.domain.equipment import SenseProof
from gateway.errors import CaptureError, CorruptRecord
from gateway.store import Maps, Store
from gateway.store.raw_stream import open_stream
from gateway.views.measurements import figures_by, known_standards
from gateway.workflow.files.importing import import_file
from gateway.workflow.files.reading import ReadOptions
from gateway.workflow.run import stages
from tests.unit.capture.test_live import AXIS
from tests.unit.capture.test_plans import run as captured
from tests.unit.drivers.test_rtx_files import written

GOLDEN = Path(__file__).parents[2] / "golden" / "files"
RUNNER = CliRunner()
FOREIGN = "Report\nNo;Theo;Laser;Gang\n1;-10,0;-9,9990;1\n2;0,0;0,0010;1\n3;0,0;0,0005;2\n4;-10,0;-9,9985;2\n"
COLUMNS = ["target=2", "measured=3", "run=4", "direction=runs", "separator=semicolon", "decimal_comma=yes"]
COLUMNS += ["reading_unit=mm", "skip=2"]
SITE = (
    '[site]\nname = "g1"\n[controller]\nurl = "opc.tcp://127.0.0.1:1"\nserial = "1"\n[[instruments]]\nname = "laser"\n'
    'driver = "umd"\nurl = "tcp://127.0.0.1:1"\nserial = "42"\n[[axes]]\nname = "X1"\nletter = "X"\nkind = "linear"\n'
    'travel = [0.0, 10.0]\n[axes.measure]\ncomponent = "EXX"\ninstrument = "laser"\nfeed = 1000.0\nstable = 1.0\n'
    "[axes.measure.targets]\nfirst = 0.0\nlast = 10.0\ncount = 5\n"
    "[axes.table]\nminimum = 0.0\nmaximum = 10.0\nstep = 1.0\n"
)


pytestmark = pytest.mark.usefixtures("inside_folder")


def told(*words: str) -> Any:
    result = RUNNER.invoke(app, [*words, "--json"])
    if isinstance(result.exception, TrueflankError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_what_a_heading_leaves_open_is_one_question_and_one_word_answers_it(tmp_path: Path) -> None:
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    heading = "Target (mm),Run 1 (um),Run 2 (um),Run 3 (um),Run 4 (um)\n"
    first.write_text(f"{heading}0,0.5,1.5,1,2\n10,-0.5,2,0,1\n", encoding="utf-8")
    second.write_text(f"{heading}0,0.25,1.5,1,2\n10,-0.5,2,0,1\n", encoding="utf-8")
    assert refused("evaluate", str(first)) == "E-IMPORT-WAYS"
    assert "--column passes=alternate" in RUNNER.invoke(app, ["import", str(first)]).output
    told("import", str(first), "--column", "passes=alternate")
    assert told("evaluate", str(second))[0]["targets"] == 2
    second.write_text("target_mm,deviation_um,run\n0,1,1\n10,2,1\n0,1,2\n10,2,2\n", encoding="utf-8")
    assert refused("import", str(second)) == "E-IMPORT-RUNS"
    told("import", str(second), "--column", "direction=up")


def refused(*words: str) -> str:
    """The code of a command that goes through several files and says what is wrong with each."""
    result = RUNNER.invoke(app, [*words, "--json"])
    assert result.exit_code == 2
    return str(json.loads(result.stdout)[0]["error"]["code"])


def test_the_unit_of_an_rta_is_asked_once_and_then_remembered_for_its_machine(tmp_path: Path) -> None:
    path = tmp_path / "a.rta"
    path.write_bytes((GOLDEN / "rotary.rta").read_bytes())
    assert refused("evaluate", str(path)) == "E-FILE-RTA-UNIT"
    assert refused("import", str(path)) == "E-FILE-RTA-UNIT"
    first = told("import", str(path), "--unit", "mrad")[0]
    assert (first["new"], first["kind"]) == (True, "measured")
    other = tmp_path / "later" / "b.rta"
    other.parent.mkdir()
    other.write_text(path.read_text(encoding="utf-8").replace("0.010", "0.011"), encoding="utf-8")
    second = told("import", str(other))[0]
    assert "unit mrad, as declared on" in second["notes"][0]
    assert told("evaluate", str(other))[0]["unit"] == "arcsec"
    again = told("import", str(path), str(other), "--unit", "urad", "--forget")
    assert [one["new"] for one in again] == [True, True], "in another unit it is another measurement"
    assert "urad" in told("import", str(other))[0]["notes"][0]


def test_the_folder_stands_for_the_machine_where_the_file_names_none(tmp_path: Path) -> None:
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        written(tmp_path / folder / "a.rtx", np.arange(100.0))
    told("import", "one/a.rtx", "--unit", "mm")
    written(tmp_path / "one/b.rtx", np.arange(50.0))
    assert "in folder" in told("import", "one/b.rtx")[0]["notes"][0]
    with pytest.raises(ConfigError, match="E-FILE-RTX-UNIT"):
        told("measure", "dynamic", "two/a.rtx")


def test_columns_are_said_once_for_a_heading_shown_and_forgotten_on_request(tmp_path: Path) -> None:
    first, second = tmp_path / "a.csv", tmp_path / "b.txt"
    first.write_text(FOREIGN, encoding="utf-8")
    second.write_text(FOREIGN.replace("9,9990", "9,9980"), encoding="utf-8")
    assert refused("evaluate", str(first)) == "E-IMPORT-COLUMNS"
    assert "No;Theo;Laser;Gang" in RUNNER.invoke(app, ["import", str(first)]).output
    words = [word for column in COLUMNS for word in ("--column", column)]
    told("import", str(first), *words)
    notes = told("import", str(second))[0]["notes"]
    assert "columns as declared on" in notes[0]
    assert "target=2" in notes[0]
    result = told("evaluate", str(second))[0]
    assert (result["targets"], result["unit"]) == (2, "um")
    assert refused("import", str(second), "--forget") == "E-IMPORT-COLUMNS"
    (tmp_path / "c.csv").write_text("1 2\n3 4\n", encoding="utf-8")
    bare = [
        "--column",
        "target=1",
        "--column",
        "deviation=2",
        "--column",
        "direction=up",
        "--column",
        "skip=0",
        "--column",
        "separator=blank",
    ]
    bare += ["--column", "target_unit=mm", "--column", "reading_unit=um"]
    assert "no heading" in told("import", "c.csv", *bare)[0]["notes"][0]


def test_flank_points_are_imported_by_their_map(tmp_path: Path) -> None:
    (tmp_path / "g.csv").write_text("s;f;x;y;z\n1;left;30;1;2\n1;right;30;-1;2\n", encoding="utf-8")
    words = [word for column in ("x=3", "y=4", "z=5") for word in ("--column", column)]
    one = told("import", "g.csv", "--gear", *words)[0]
    assert one["kind"] == "gear-inspection"
    assert Store(tmp_path / "runs").open(one["run"]).stages == ("gear-inspection",)


def test_the_fields_own_headings_evaluate_at_once(tmp_path: Path) -> None:
    rows = [
        f"{10.0 * at},{way},{run},{10.0 * at + 0.001 * (at + (way == 'down'))}"
        for at in range(5)
        for way in ("up", "down")
        for run in range(1, 6)
    ]
    (tmp_path / "e.csv").write_text("target_mm,direction,run,position_mm\n" + "\n".join(rows) + "\n", encoding="utf-8")
    found = told("evaluate", "e.csv")[0]
    assert (found["B"], found["M"], found["E"]) == pytest.approx((1.0, 4.0, 5.0))


def test_an_import_is_the_same_content_once_and_leaves_the_file_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.rtl"
    path.write_bytes((GOLDEN / "basic.rtl").read_bytes())
    first, second = told("import", str(path))[0], told("import", str(path))[0]
    assert (first["new"], second["new"]) == (True, False)
    assert first["run"] == second["run"]
    folder = Store(tmp_path / "runs").open(first["run"])
    assert folder.read_bytes("source.rtl") == path.read_bytes()
    found = folder.get("measured", MeasuredSet)
    np.testing.assert_array_equal(found.deviations, RtlFormat().read(path).deviations)


def test_a_file_that_changes_while_it_is_imported_is_not_used(tmp_path: Path) -> None:
    path = tmp_path / "a.rtl"
    path.write_bytes((GOLDEN / "basic.rtl").read_bytes())
    with pytest.raises(FileFormatError, match="E-IMPORT-CHANGED"):
        import_file(path, Store(tmp_path / "runs"), ReadOptions(), None, expected="0" * 64)
    assert Store(tmp_path / "runs").runs() == ()


def test_one_file_that_cannot_be_read_does_not_stop_the_others(tmp_path: Path) -> None:
    (tmp_path / "bad.rtl").write_text("HEADER::\n", encoding="utf-8")
    result = RUNNER.invoke(app, ["import", "bad.rtl", str(GOLDEN / "basic.rtl"), "--json"])
    assert result.exit_code == 2
    first, second = json.loads(result.stdout)
    assert first["error"]["code"].startswith("E-FILE")
    assert second["new"]


def a_run(tmp_path: Path) -> str:
    raw = captured(AXIS)[0]
    folder = Store(tmp_path / "runs").create("g1", {"site_file": ""})
    capture = from_live(AXIS, raw, SenseProof("laser", "X1", 1, 1.0, (0.0, 10.0, 0.0)), "nothing")
    folder.put(stages.capture("X1", "before"), capture)
    folder.put(stages.capture("X1", "after"), capture)
    return folder.run_id


@pytest.mark.parametrize("standard", [one["name"] for one in known_standards()])
def test_every_standard_on_the_page_gives_the_figures_and_u_of_the_command(tmp_path: Path, standard: str) -> None:
    run_id = a_run(tmp_path)
    command = told("evaluate", run_id, "--standard", standard, "--axis", "X1", "--phase", "before")[0]
    folder = Store(tmp_path / "runs").open(run_id)
    rows = figures_by(folder, "X1", "before", name=standard, limits={})["rows"]
    assert rows
    known = {one["parameter"]: one["U"] for one in rows if one["U"] is not None}
    assert known or command["monte_carlo"]  # of older standards the command draws U
    assert known == pytest.approx({name: command["U"][name] for name in known})
    assert all(one["value"] == command[one["parameter"]] for one in rows)


def test_a_runs_capture_is_evaluated_and_exported(tmp_path: Path) -> None:
    run_id = a_run(tmp_path)
    both = told("evaluate", run_id)
    assert len(both) == 2
    assert any("by the gateway" in line for line in both[0]["corrected"])
    with pytest.raises(ConfigError, match="E-EXPORT-SEVERAL"):
        told("runs", "export", run_id, "--to", "rtl", "-o", "a.rtl", "--axis", "X1")
    notes = told("runs", "export", run_id, "--to", "rtl", "-o", "a.rtl", "--axis", "X1", "--phase", "after")["notes"]
    assert notes == []
    found = RtlFormat().read(tmp_path / "a.rtl")
    assert found.header["Axis"] == "X1"
    assert found.ambient_start.pressure_hpa == pytest.approx(1013.25)
    told("runs", "export", "a.rtl", "--to", "csv", "-o", "a.csv")
    keys = ("A", "E", "R", "B", "M")
    assert [told("evaluate", "a.csv")[0][key] for key in keys] == pytest.approx([both[0][key] for key in keys])
    with pytest.raises(ConfigError, match="E-EXPORT-NOTHING"):
        told("runs", "export", run_id, "--to", "rtl", "-o", "b.rtl", "--axis", "Z1")


def test_nothing_is_overwritten_without_a_word_and_no_link_is_followed(tmp_path: Path) -> None:
    source = str(GOLDEN / "basic.rtl")
    (tmp_path / "a.csv").write_text("mine", encoding="utf-8")
    (tmp_path / "link.csv").symlink_to(tmp_path / "a.csv")
    for name in ("a.csv", "link.csv"):
        with pytest.raises(ConfigError, match="E-CLI-EXISTS"):
            told("runs", "export", source, "--to", "csv", "-o", name)
    told("runs", "export", source, "--to", "csv", "-o", "link.csv", "--force")
    assert (tmp_path / "a.csv").read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "link.csv").is_symlink()
    with pytest.raises(ConfigError, match="E-CLI-WRITE"):
        told("runs", "export", source, "--to", "csv", "-o", "none/a.csv")
    with pytest.raises(ConfigError, match="E-EXPORT-FORM"):
        told("runs", "export", source, "--to", "rtx", "-o", "a.rtx")
    with pytest.raises(ConfigError, match="E-FILE-KIND"):
        told("runs", "export", source, "--to", "rta", "-o", "a.rta")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "link.csv"]


def test_a_dynamic_file_goes_through_the_store_and_out_again(tmp_path: Path) -> None:
    samples = np.sin(np.arange(2000) / 7.0)
    written(tmp_path / "a.rtx", samples)
    run_id = told("import", "a.rtx", "--unit", "mm")[0]["run"]
    told("runs", "export", run_id, "--to", "rtx", "-o", "b.rtx")
    np.testing.assert_array_equal(RtxFormat("mm").read(tmp_path / "b.rtx").values(), samples * 1000.0)
    told("runs", "export", run_id, "--to", "csv", "-o", "b.csv")
    rows = (tmp_path / "b.csv").read_text(encoding="utf-8").splitlines()
    assert rows[-1].split(",")[0] == "0.03998"
    assert len([row for row in rows if not row.startswith("#")]) == 2001


def test_a_memory_that_was_tampered_with_is_told(tmp_path: Path) -> None:
    maps = Maps(tmp_path)
    maps.keep("unit", "rta in folder x", {"unit": "mrad"}, "2026")
    path = next((tmp_path / "maps").iterdir())
    path.write_text(path.read_text().replace("rta in folder x", "rta in folder y"))
    with pytest.raises(CorruptRecord):
        maps.find("unit", "rta in folder x")
    assert maps.forget("unit", "rta in folder x")
    assert maps.find("unit", "rta in folder x") is None
    assert not maps.forget("unit", "rta in folder x")


def test_dynamic_opens_a_file_and_draws_it(tmp_path: Path) -> None:
    time_s = np.arange(20_000) / 50_000.0
    written(tmp_path / "a.rtx", 0.002 * np.sin(2.0 * np.pi * 120.0 * time_s))
    data = told("measure", "dynamic", "a.rtx", "--unit", "mm")
    peak = data["spectrum"]["peaks"][0]
    assert (peak["frequency_hz"], peak["amplitude"]) == pytest.approx((120.0, 2.0), rel=0.01)
    assert (tmp_path / data["picture"]).read_bytes().startswith(b"\x89PNG")
    assert told("measure", "dynamic", "a.rtx", "--unit", "mm")["picture"] != data["picture"]
    with pytest.raises(ConfigError, match="E-CLI-EXISTS"):
        told("measure", "dynamic", "a.rtx", "--unit", "mm", "--plot", data["picture"])
    words = RUNNER.invoke(app, ["measure", "dynamic", "a.rtx", "--unit", "mm"]).stdout
    assert "120" in words
    assert "picture:" in words
    with pytest.raises(ConfigError, match="E-CLI-NOT-DYNAMIC"):
        told("measure", "dynamic", str(GOLDEN / "basic.rtl"))


class Laser:
    """Streams a step of 100 um with a ringing at 0.5 s, 1 kHz; then breaks off if told so."""

    def __init__(self, name: str, _url: str, _settings: Any, clock: Clock) -> None:
        self.name, self.channels, self.compensated_for, self.notices = (
            name,
            ("displacement_mm",),
            "air",
            ("cannot detect",),
        )
        self.clock = clock

    async def open(self, _timeout_s: float) -> Identity:
        return Identity("umd", "test laser", "42")

    async def close(self) -> None:
        return None

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        for start in range(0, 4000, 100):
            await self.clock.sleep(0.0)
            time_s = np.arange(start, start + 100) / 1000.0
            after = np.maximum(time_s - 0.5, 0.0)
            ringing = 0.02 * np.exp(-20.0 * after) * np.sin(2.0 * np.pi * 50.0 * after)
            values = np.where(time_s >= 0.5, 0.1 + ringing, 0.0)[:, None]
            yield SampleBlock(self.channels, time_s, values, np.ones(100, dtype=np.bool_), 3 if start == 2000 else 0)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(registry, "load", lambda _name, _role: Laser)
    path = tmp_path / "site.toml"
    path.write_text(SITE, encoding="utf-8")
    return path


def test_dynamic_records_a_stream_from_its_trigger_and_shows_how_it_settles(tmp_path: Path, site: Path) -> None:
    words = ["--instrument", "laser", "--seconds", "1.2", "--trigger", "value=50", "--axis", "X1", "--band", "1"]
    data = told("measure", "dynamic", str(site), *words)
    assert (data["samples"], data["rate_hz"], data["trigger"], data["unit"]) == (1300, 1000.0, 100, "um")
    assert data["settling"]["step"] == pytest.approx(100.0, abs=0.5)
    assert 0.1 < data["settling"]["time_s"] < 0.2
    assert data["settling"]["overshoot"] > 5.0
    recording = open_stream(Path(data["place"]))
    assert recording.header["Axis"] == "X1"
    folder = Store(tmp_path / "runs").open(Path(data["place"]).parent)
    assert folder.state == "captured"
    assert (folder.path / "dynamic.png").exists()
    assert "cannot detect" in json.loads(folder.read_text("dynamic.json"))["notes"]
    again = told("measure", "dynamic", data["place"], "--band", "1")
    assert again["settling"] == data["settling"]


def test_gaps_of_a_live_stream_are_accounted_for(site: Path) -> None:
    data = told("measure", "dynamic", str(site), "--instrument", "laser", "--seconds", "3")
    assert (data["samples"], data["gaps"], data["lost"]) == (3000, 1, 3)
    assert "gap" in data["settling_missing"]


def test_a_trigger_that_never_comes_and_wrong_words_are_told(tmp_path: Path, site: Path) -> None:
    with pytest.raises(CaptureError, match="E-DYN-NOTHING"):
        told("measure", "dynamic", str(site), "--instrument", "laser", "--trigger", "level=1e6")
    assert Store(tmp_path / "runs").runs()[0].state == "failed"
    for wrong in ("level", "value=0", "value=-1", "level=nan", "sometimes", "external=3"):
        with pytest.raises(ConfigError, match="E-CLI-TRIGGER"):
            told("measure", "dynamic", str(site), "--instrument", "laser", "--trigger", wrong)
    with pytest.raises(ConfigError, match="E-DYN-INSTRUMENT"):
        told("measure", "dynamic", str(site), "--instrument", "lamp")


def test_fault_38_a_laser_with_another_serial_is_refused(site: Path) -> None:
    site.write_text(SITE.replace('serial = "42"', 'serial = "43"'), encoding="utf-8")
    with pytest.raises(TrueflankError, match="E-SUP-SERIAL"):
        told("measure", "dynamic", str(site), "--instrument", "laser")
