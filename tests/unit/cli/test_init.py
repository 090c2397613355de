"""A site file by answers: typed, piped or given; checked at once; nothing is ever overwritten."""

from __future__ import annotations

import socket
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from drivers.checks import ControlAxis, ControlFacts
from drivers.errors import ConfigError, TrueflankError
from gateway.cli import app
from gateway.cli.setup.check import check_site, compare_with_control
from gateway.cli.setup.site_tree import axis_tree, grid, letter_of, plan_axis, used_letters, work_tree
from gateway.config import files_only, load_site, schema, unprotected_connection
from gateway.config.reference import page, settings_models, site_text, toml_value
from gateway.study.inputs import load_gear

ROOT = Path(__file__).parents[3]
EXAMPLES = sorted((ROOT / "examples" / "sites").glob("*.toml"))


def ran(folder: Path, *options: str, typed: str = "") -> Result:
    words = ["init", str(folder / "site.toml"), *options]
    return CliRunner().invoke(app, words, input=typed, catch_exceptions=False)


def test_an_owner_of_files_gets_a_checked_file_from_three_answers(tmp_path: Path) -> None:
    done = ran(tmp_path, typed="files\nold-1\n\n\n\n")
    assert done.exit_code == 0, done.output
    assert done.output.count("  road") == 1
    assert "valid" in done.output
    found = check_site(tmp_path / "site.toml")
    assert found.faults == ()
    assert found.doubts == (), "no program asks where axes stand"
    assert found.site.site.name == "old-1"
    assert [axis.name for axis in found.site.axes] == ["X1", "Z1", "C1"]
    assert [axis.measure.targets.count for axis in found.site.axes] == [21, 21, 25]


def test_a_site_of_files_names_no_control_and_says_what_it_can_do(tmp_path: Path) -> None:
    ran(tmp_path, "--yes", "--answer", "road=files")
    site = tmp_path / "site.toml"
    text = site.read_text(encoding="utf-8")
    assert [word for word in ("url", "serial", "security", "terminal", "[moves]") if f"\n{word}" in text] == []
    tree = load_site(site)
    assert (files_only(tree), unprotected_connection(tree), tree.instruments) == (True, None, ())
    for command in ("run", "doctor self-test", "recover", "tables verify", "doctor accept"):
        done = CliRunner().invoke(app, [*command.split(), str(site)])
        assert isinstance(done.exception, TrueflankError), done.output
        causes = getattr(done.exception, "causes", (("", done.exception),))
        assert {error.code for _, error in causes} == {"E-FILES-ONLY"}
        assert done.exception.exit_code == 2
    done = CliRunner().invoke(app, ["doctor", str(site)])
    assert done.exit_code == 0
    assert "files only" in done.output
    assert f"next: trueflank day FOLDER --site {site}" in done.output.replace("\n", " ")


@pytest.mark.parametrize("key", ['url = "opc.tcp://h:4840"', 'serial = "7"'])
def test_driver_none_takes_no_address_and_no_serial_number(tmp_path: Path, key: str) -> None:
    ran(tmp_path, "--yes", "--answer", "road=files")
    site = tmp_path / "site.toml"
    site.write_text(site.read_text(encoding="utf-8").replace('driver = "none"', f'driver = "none"\n{key}'))
    assert [fault.path for fault in check_site(site).faults] == [("controller", key.split(maxsplit=1)[0])]


def test_every_question_says_why_it_is_asked_and_a_wrong_answer_is_asked_again(tmp_path: Path) -> None:
    done = ran(tmp_path, typed="opc\nfiles\nmy grinder\nm1\nX1 X1\nY B\nX 0 1\nY -100 200, B -20 120\n")
    assert done.exit_code == 0, done.output
    assert "must be opcua, mailbox, carried, linuxcnc, files" in done.output
    assert "serial number" not in done.output
    site = load_site(tmp_path / "site.toml")
    assert [(axis.name, axis.kind, axis.travel) for axis in site.axes] == [
        ("Y", "linear", (-100.0, 200.0)),
        ("B", "rotary", (-20.0, 120.0)),
    ]


def test_nothing_is_overwritten_and_no_end_of_input_hangs(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="E-INIT-ENDED"):
        ran(tmp_path, typed="files\n")
    assert not (tmp_path / "site.toml").exists()
    (tmp_path / "site.toml").write_text("mine")
    with pytest.raises(ConfigError, match="E-INIT-EXISTS"):
        ran(tmp_path, "--yes")
    assert (tmp_path / "site.toml").read_text() == "mine"


def test_a_grinder_gets_its_gear_and_the_errors_that_its_optics_show(tmp_path: Path) -> None:
    optics = "optics=straightness bridge tcp://127.0.0.1:7002, angular"
    done = ran(tmp_path, "--yes", *("--answer", "road=files"), *("--answer", "gear=example 150"), *("--answer", optics))
    assert done.exit_code == 0, done.output
    found = check_site(tmp_path / "site.toml")
    assert found.faults == ()
    site = found.site
    assert [setup.component for setup in site.setups] == ["EYX", "EZX", "EXZ", "EYZ", "EBX", "ECX", "EAZ", "EBZ"]
    assert [setup.axis for setup in site.setups] == ["X1", "X1", "Z1", "Z1"] * 2
    assert [(one.name, one.driver) for one in site.instruments] == [
        ("straightness", "bridge"),
        ("angular", "manual"),
    ]
    assert (site.work.infeed, site.work.stroke, site.work.index, site.work.dresser) == ("X", "Z", "C", "")
    assert site.work.height_mm == 150.0
    assert load_gear(tmp_path / "gear.toml").gear == load_gear(ROOT / "examples" / "gears" / "rv-40e-like.toml").gear


def test_an_own_gear_is_kept_and_the_axis_that_is_not_measured_dresses(tmp_path: Path) -> None:
    (tmp_path / "gear.toml").write_bytes((ROOT / "examples" / "gears" / "rv-20e-like.toml").read_bytes())
    kept = (tmp_path / "gear.toml").read_bytes()
    ran(tmp_path, "--yes", "--answer", "road=files", "--answer", "gear=example")
    assert (tmp_path / "gear.toml").read_bytes() == kept
    plans = [plan_axis(axis, axis.travel or (0.0, 360.0), ("a", "b")) for axis in FIVE if axis.name != "Y1"]
    tree = work_tree(plans, "gear.toml", 20.0, [FIVE[1]])
    assert (tree["dresser"], tree["dresser_letter"]) == ("Y1", "Y")
    assert "wheel_place" not in tree


@pytest.mark.parametrize(
    ("answer", "code"),
    [
        ("road=train", "E-INIT-ANSWER"),
        ("name=a b", "E-INIT-ANSWER"),
        ("axes=", "E-INIT-ANSWER"),
        ("travel=X1 5 1", "E-INIT-ANSWER"),
        ("gear=there-is-none.toml 150", "E-INIT-ANSWER"),
        ("gear=site.toml", "E-INIT-ANSWER"),
        ("colour=red", "E-INIT-OPTION"),
        ("road", "E-INIT-OPTION"),
    ],
)
def test_answers_given_beforehand_are_judged(tmp_path: Path, answer: str, code: str) -> None:
    with pytest.raises(ConfigError, match=code):
        ran(tmp_path, "--yes", "--answer", "road=files", "--answer", answer)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "optics", ["level", "angular, angular", "straightness,", "angular bridge", "angular train tcp://h:1"]
)
def test_optics_are_named_once_with_driver_and_address_or_alone(tmp_path: Path, optics: str) -> None:
    with pytest.raises(ConfigError, match="E-INIT-ANSWER"):
        ran(
            tmp_path,
            "--yes",
            *("--answer", "road=files"),
            *("--answer", "gear=example"),
            "--answer",
            f"optics={optics}",
        )
    assert not (tmp_path / "site.toml").exists()


def test_a_control_that_does_not_answer_leaves_a_file_and_the_next_step(tmp_path: Path) -> None:
    done = ran(tmp_path, "--yes", "--answer", "url=opc.tcp://127.0.0.1:9")
    assert done.exit_code == 0
    assert "cannot be read now" in done.output
    assert "trueflank doctor certificate" in done.output
    assert [fault.code for fault in check_site(tmp_path / "site.toml").faults] == ["E-CFG-CERTIFICATE"]


FIVE = (
    ControlAxis("X1", "mm", False, (-650.0, 650.0), 0, 131),
    ControlAxis("Y1", "mm", False, (-3.3, 4.1), 1, 10),
    ControlAxis("Z1", "mm", False, (-500.0, -50.0), 0, 20),
    ControlAxis("B1", "deg", False, (-110.0, 110.0), 0, 50),
    ControlAxis("C1", "deg", True, None, 0, 40),
)


def test_five_axes_fit_into_travel_and_room(tmp_path: Path) -> None:
    travels = [axis.travel or (0.0, 360.0) for axis in FIVE]
    plans = [plan_axis(axis, travel, ("laser", "ring")) for axis, travel in zip(FIVE, travels, strict=True)]
    tree = {
        "site": {"name": "five"},
        "controller": {"driver": "sinumerik-modbus", "url": "tcp://h:502", "serial": "S"},
        "instruments": [
            {"name": "laser", "driver": "umd", "url": "COM5", "settings": {"max_fringe_hz": 0.0}},
            {"name": "ring", "driver": "bridge", "url": "tcp://h:1", "settings": {"max_speed_deg_s": 0.0}},
        ],
        "axes": [axis_tree(plan) for plan in plans],
    }
    path = tmp_path / "site.toml"
    path.write_text(site_text(tree, "five"), encoding="utf-8")
    found = check_site(path)
    assert found.faults == ()
    # This driver reads the tables of one measuring system for all axes, and one axis has the other.
    assert [one.path for one in found.doubts] == [("moves", "safe"), ("axes", 1, "encoder")]
    assert list(compare_with_control(found.site, ControlFacts("S", "V", "metric", FIVE))) == []
    assert [grid(plan)[2] for plan in plans] == [20.0, 1.0, 25.0, 5.0, 10.0]


def test_a_control_that_programs_are_carried_to_has_its_axes_in_its_own_order(tmp_path: Path) -> None:
    given = (
        "road=carried",
        "cross=2",
        "serial=ST-1",
        "axes=X1 C1",
        "order=X1 Y1 C1",
        "safe=X1 0 400, Y1 any, C1 0 360",
    )
    done = ran(tmp_path, "--yes", *(word for one in given for word in ("--answer", one)))
    assert "next: trueflank doctor self-test" in done.output
    site = load_site(tmp_path / "site.toml")
    assert (site.controller.driver, site.controller.url) == ("sinumerik-offline", "carried://stick")
    assert site.controller.settings["axes"] == "X1 Y1 C1"
    assert site.controller.settings["cross_tables"] == 2
    assert site.moves.safe["Y1"] == "any"
    (tmp_path / "other").mkdir()
    with pytest.raises(ConfigError, match="name these too: C1"):
        ran(
            tmp_path / "other",
            "--yes",
            "--answer",
            "road=carried",
            "--answer",
            "axes=X1 C1",
            "--answer",
            "order=X1",
        )


def test_what_the_control_says_otherwise_is_told_before_anything_moves(tmp_path: Path) -> None:
    ran(tmp_path, "--yes", "--answer", "road=files")
    site = load_site(tmp_path / "site.toml")
    told = ControlFacts(
        "S",
        "V",
        "metric",
        (ControlAxis("X1", "mm", False, (0.0, 400.0), 1, 50), ControlAxis("C1", "mm", False, (0.0, 360.0), 0, 500)),
    )
    found = [(fault.path[1:], fault.code) for fault in compare_with_control(site, told)]
    assert found == [
        ((0, "encoder"), "E-CFG-CONTROL-ENCODER"),
        ((0, "table"), "E-CFG-CONTROL-ROOM"),
        ((0, "travel"), "E-CFG-CONTROL-LIMITS"),
        ((0, "table"), "E-CFG-CONTROL-LIMITS"),
        ((0, "targets"), "E-CFG-CONTROL-LIMITS"),
        ((1, "name"), "E-CFG-CONTROL-AXIS"),
        ((2, "kind"), "E-CFG-CONTROL-KIND"),
        ((2, "modulo"), "E-CFG-CONTROL-MODULO"),
    ]


def test_letters_come_from_names() -> None:
    assert [letter_of(name) for name in ("X1", "MX2", "C", "TABLE", "Q7")] == ["X", "X", "C", "A", "Q"]
    two = [plan_axis(ControlAxis(name, "mm"), (0.0, 9.0), ("a", "b")) for name in ("X1", "X2", "Z1")]
    assert [plan.name for plan in used_letters(two)] == ["X1", "Z1"]


def test_written_values_are_read_back() -> None:
    tree = {"a": 'q"\\\x7f\n', "b": [1, 2.5, True], "c": {"d": -1e-9, "e": ""}}
    assert tomllib.loads("\n".join(f"{key} = {toml_value(value)}" for key, value in tree.items())) == tree


@pytest.mark.parametrize("path", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_every_example_is_valid_once_its_secrets_are_there(tmp_path: Path, path: Path) -> None:
    lacking = {fault.path[-1] for fault in check_site(path).faults}
    assert lacking <= {"password_file", "server_certificate", "token_file"}
    copy = tmp_path / "sites" / path.name
    copy.parent.mkdir()
    copy.write_bytes(path.read_bytes())
    (tmp_path / "gears").symlink_to(ROOT / "examples" / "gears")
    for secret in ("password.txt", "token.txt"):
        (copy.parent / secret).touch(mode=0o600)
        (copy.parent / secret).write_text("secret-0123456789")
    (copy.parent / "control.der").write_bytes(b"\x30\x82")
    found = check_site(copy)
    assert found.faults == ()
    assert found.doubts == ()
    assert all("#" in line for line in path.read_text().splitlines() if line.strip() and not line.startswith("["))


def test_there_is_an_example_for_each_kind_of_owner() -> None:
    names = [path.stem for path in EXAMPLES]
    roads = ["carried-grinder", "files-only", "five-axes", "linuxcnc-mill", "mailbox-grinder", "mill-three-axes"]
    assert names == [*roads, "opcua-grinder"]


def test_the_page_of_reference_is_that_of_the_code() -> None:
    assert (ROOT / "docs" / "site-file.md").read_text(encoding="utf-8") == page()
    assert " |  |" not in page(), "a key without a description"


def test_the_schema_holds_the_settings_of_every_driver() -> None:
    whole = schema()
    for role in ("controller", "instrument", "gear-inspector"):
        for name, model in settings_models(role).items():
            assert set(whole["$defs"][f"Settings-{name}"]["properties"]) == set(model.model_fields)
    assert len(whole["$defs"]["InstrumentSection"]["allOf"]) >= 5


def test_an_owner_of_linuxcnc_gets_a_checked_file_and_a_token_for_the_agent(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    given = ("road=linuxcnc", f"url=tcp://127.0.0.1:{port}", "travel=X 0 300, Y 0 200, Z 0 100")
    done = ran(tmp_path, "--yes", *(word for one in given for word in ("--answer", one)))
    assert done.exit_code == 0, done.output
    token = tmp_path / "token.txt"
    assert token.stat().st_mode & 0o077 == 0
    assert len(token.read_text().strip()) >= 16
    found = check_site(tmp_path / "site.toml")
    assert found.faults == ()
    assert [axis.name for axis in found.site.axes] == ["X", "Y", "Z"]


def test_an_owner_of_a_mailbox_gets_a_checked_file_though_no_plc_answers_yet(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    url = f"tcp://127.0.0.1:{port}"
    done = ran(tmp_path, "--yes", "--answer", "road=Mail-Box", "--answer", f"url={url}", "--answer", "serial=YK-1")
    assert done.exit_code == 0, done.output
    assert "cannot be read now" in done.output
    found = check_site(tmp_path / "site.toml")
    assert found.faults == ()
    assert [one.path for one in found.doubts] == [("moves", "safe")]  # only who knows the machine can say the places
    control = found.site.controller
    assert (control.driver, control.url, control.serial) == ("sinumerik-modbus", url, "YK-1")
    assert control.settings["word_order"] == "high-first"
