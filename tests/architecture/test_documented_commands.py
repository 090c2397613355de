"""Commands of README and docs: parsed by the real command line, run where they need no machine; pages are current."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from drivers.errors import catalogue
from gateway.cli import app
from gateway.cli.files.reference import command_page
from gateway.cli.setup.check import check_site
from gateway.push.phases import transitions_in_markdown
from simulators.pytest_plugin import CellStarter
from tests.unit.drivers.test_gear_measuring_files import mka

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
ALONE = (
    *("check", "check programs", "docs commands", "docs schema", "evaluate", "explain", "import"),
    *("tables convert", "tables diff", "tables lint"),
)
"""Commands that need neither a machine nor minutes of computing: run here, in the order of each page."""
AT_A_CELL = (
    *("doctor", "doctor accept", "doctor certificate", "doctor compare", "doctor devices", "doctor self-test"),
    "recover",
)
"""Commands that look at a control: run at a simulated one, over its wires, in the long tests."""
PARSED = {
    "audit verify": "the tutorial is done whole by tests/release/test_handbook.py",
    "close": "an hour of machine time: tests/closing",
    "correct": "a site with a gear: tests/unit/cli/test_errors_file.py",
    "day": "asks of every file: tests/unit/day does it with the files of a day",
    "demo": "minutes: tests/release starts it, tests/cell and tests/closing run what it runs",
    "guard": "a run of before: tests/cell/test_grinding.py",
    "init": "asks at a control: tests/unit/cli, tests/contract/test_init.py",
    "study match": "files of several inspected discs: tests/unit/cli/test_match.py",
    "measure": "a machine and its instruments: tests/closing/test_short.py",
    "push": "consent and a machine: tests/push, and the tutorial in tests/release",
    "report": "a run of before: tests/unit/report, and the tutorial in tests/release",
    "run": "a machine and its instruments: tests/cell, and the tutorial in tests/release",
    "serve": "ends when it is ended: tests/services, tests/browser",
    "simulate": "ends when it is ended: the tutorial in tests/release",
    "study": "minutes of computing: tests/unit/study",
    "simulate teach": "ends when it is ended: tests/unit/cli",
}
"""What is parsed here and not run, and which test does it instead."""
NEEDS = {
    "evaluate disc-section.dat": "a site with a gear: test_every_shipped_file_gives_the_figure_of_its_page",
    "evaluate disc.dat": "a site with a gear: tests/unit/cli/test_inspecting.py",
    "tables convert latest": "a run with an error model: tests/unit/exchange",
    "doctor accept --level motion": "a person mounts instruments: tests/acceptance",
    "doctor accept --level write": "as motion",
}
"""Of commands that are run, the calls that are not."""
VERDICTS = (13, 21)  # of `evaluate --limit`: beyond the limit, not decidable


def _blocks(page_text: str, kind: str) -> list[str]:
    return [text for word, text in BLOCK.findall(page_text) if word == kind]


def _calls() -> Iterator[tuple[str, list[str]]]:
    """Every line of a block that calls `trueflank`, with its page; the page of commands is made from the help."""
    for path in sorted({README, *DOCS.rglob("*.md")} - {DOCS / "commands.md"}):
        for block in _blocks(path.read_text(encoding="utf-8"), ""):
            for line in block.splitlines():
                call = line.strip().removeprefix(".venv\\Scripts\\")
                if call.startswith("trueflank "):
                    yield path.name, shlex.split(call, comments=True)[1:]


def _parsed(words: list[str]) -> None:
    """Parse as the command line would. Raises what it raises on an unknown command, option or value."""
    name, rest = _split(words)
    command = typer.main.get_command(app)
    for word in name.split():
        command = command.commands[word]  # type: ignore[attr-defined]
    command.make_context(name, rest)


def _split(words: list[str]) -> tuple[str, list[str]]:
    """The words that name a command, and what is given to it. Raises KeyError where the first names none."""
    found, rest = typer.main.get_command(app).commands[words[0]], words[1:]  # type: ignore[attr-defined]
    name = words[0]
    while rest and rest[0] in getattr(found, "commands", {}):
        name, found, rest = f"{name} {rest[0]}", found.commands[rest[0]], rest[1:]
    return name, rest


def test_every_command_of_a_block_is_taken_by_the_command_line() -> None:
    calls = list(_calls())
    assert len(calls) > 20
    wrong = []
    for where, words in calls:
        try:
            _parsed(words)
        except Exception as error:  # noqa: BLE001 - whatever it is, the other commands are told too
            wrong.append(f"{where}: trueflank {' '.join(words)}: {error!r}")
    assert wrong == []


def test_what_the_command_line_does_not_know_is_found() -> None:
    for words in (["push", "latest", "--aply"], ["nothing"], ["study"]):
        with pytest.raises(BaseException):  # noqa: B017, PT011 - of the command line's own making
            _parsed(words)


def _bench_record() -> str:
    """A turn of a crank-driven reducer of twelve pins, then a loop of torque with the crank held."""
    turn = [(-0.125 * 11 * 10 * k, 1.25 * k, 5.0) for k in range(290)]
    up = [float(torque) for torque in range(61)]
    load = [*up, *up[-2::-1], *(-torque for torque in up[1:]), *(-torque for torque in up[-2::-1]), *up[1:]]
    held, stood = turn[-1][0], turn[-1][1]
    loop = [(held, stood + torque / 3600.0, torque) for torque in load]
    rows = [f"{k},{a:.6f},{b:.9f},{torque},20" for k, (a, b, torque) in enumerate([*turn, *loop])]
    head = ("# Pins,12", "# Ratio,-11", "# Rated torque Nm,60", "# Output encoder U arcsec,1")
    return "\n".join((*head, "time_s,input_deg,output_deg,torque_Nm,temperature_degC", *rows, ""))


OTHER_CONTROLS = {
    "axis_x.com": ("BEGIN AXIS_X.COM MM", "NR AXISPOS BACKLASH X", "0 -100 0.004 0.001", "1 0 0.005 0.002", "[END]"),
    "x.cal": (":START 1 SAMPLEDIST=100 POSUNIT=PRIMARY CORUNIT=PRIMARY/1000", "0 -0.4 0.7", ":END"),
    "listing.txt": ("%", "N03620P1", "N10000P1", "N10001P-2", "N10002P1", "%"),
}
"""Tables of other controls, as their makers' documents print them."""


def _six_channels() -> str:
    """Two runs both ways of an instrument that reads six motions at once."""
    heads = "Position (mm);Linear (um);Straightness Y (um);Straightness Z (um);Pitch (urad);Yaw (urad);Roll (urad)"
    ways = [(run, way) for run in (1, 2) for way in "+-"]
    rows = [f"{50 * k};{k};{k * k};{-k};{k};{2 * k};{run};{way};{run}" for run, way in ways for k in range(5)]
    return "\n".join((f"{heads};Direction;Run", *rows, ""))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A place with the files that the handbook's commands name; its site file is that of `docs/connecting.md`."""
    site = next(text for text in _blocks((DOCS / "connecting.md").read_text(encoding="utf-8"), "toml"))
    (tmp_path / "site.toml").write_text(site, encoding="utf-8")
    (tmp_path / "control.der").write_bytes(b"\x30\x82")
    golden = ROOT / "tests" / "golden" / "files"
    for name in ("laser.rtl", "X-axis.rtl"):
        (tmp_path / name).write_bytes((golden / "basic.rtl").read_bytes())
    for name, unit in {"X-straight": "um", "along-x": "um", "along-y": "um", "X-pitch": "arcsec"}.items():
        rows = [
            f"{50 * at},{way},{run},{0.1 * at * at + 0.01 * run}"
            for run in (1, 2, 3)
            for way in "+-"
            for at in range(6)
        ]
        text = "\n".join((f"target_mm,direction,repetition,deviation_{unit}", *rows, ""))
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    turn = [f"{at},{way},{run},{0.01 * at + 0.01 * run}" for run in (1, 2) for way in "+-" for at in range(0, 361, 45)]
    text = "\n".join(("target_deg,direction,repetition,deviation_arcsec", *turn, ""))
    (tmp_path / "C.csv").write_text(text, encoding="utf-8")
    (tmp_path / "six.csv").write_text(_six_channels(), encoding="utf-8")
    circle = [f"{at % 360},{150 + 0.002 * (at % 7)}" for at in range(400)]
    text = "\n".join(("# Radius mm,150", "angle_deg,radius_mm", *circle, ""))
    (tmp_path / "circle.csv").write_text(text, encoding="utf-8")
    for example in (ROOT / "examples" / "files").iterdir():
        (tmp_path / example.name).write_bytes(example.read_bytes())
    (tmp_path / "gear.mka").write_text(mka(), encoding="utf-8")
    for name, lines in OTHER_CONTROLS.items():
        (tmp_path / name).write_text("\n".join((*lines, "")), encoding="utf-8")
    (tmp_path / "record.csv").write_text(_bench_record(), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TRUEFLANK_PASSWORD", "x")
    return tmp_path


def test_the_site_file_of_the_handbook_is_valid_and_short(folder: Path) -> None:
    found = check_site(folder / "site.toml")
    assert [fault.error("site").what for fault in found.faults] == []
    assert len((folder / "site.toml").read_text(encoding="utf-8").splitlines()) <= 15


def _left_out(words: list[str]) -> bool:
    """Whether a call is one of `NEEDS`."""
    return any(_is_need(key, words) for key in NEEDS)


def _is_need(key: str, words: list[str]) -> bool:
    """Whether a call is that of a key: its command, and the next words that tell it."""
    (name, rest), (needed, told) = _split(words), _split(key.split())
    return name == needed and set(told) <= set(rest)


def _to_run(commands: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """The calls of these commands."""
    return [(where, words) for where, words in _calls() if _split(words)[0] in commands and not _left_out(words)]


def test_every_command_of_a_block_is_run_or_its_reason_is_said() -> None:
    used = {_split(words)[0] for _where, words in _calls()}
    assert used <= {*ALONE, *AT_A_CELL, *PARSED}
    assert set(PARSED) - used == set()
    assert set(PARSED) & {*ALONE, *AT_A_CELL} == set()
    assert all(any(_is_need(key, words) for _where, words in _calls()) for key in NEEDS)
    named = re.findall(r"tests/[\w/.]+", " ".join((*PARSED.values(), *NEEDS.values())))
    assert [name for name in named if not (ROOT / name.rstrip(".")).exists()] == []


FIGURES = {
    "laser-x.rtl": "2.875",
    "turn-c.csv": "4.002",
    "straight-x.csv": "2.703",
    "straight-z.csv": "-2.530",
    "six-x.csv": "5.033",
    "circle-xy.csv": "19.991",
    "gear-involute.mka": "10.000",
    "disc-section.dat": "2.04",
}
"""What a command prints of a shipped file, and its page states."""
POINTS = {
    "heidenhain-x.com": "-50.0,-0.4,3.0",
    "fanuc-listing.txt": "-250.0,4.0,",
    "axeserr.dat": "100.0,-3.0,6.0",
    "stage.cal": "-10.0,1.1,",
}
"""A row of the table that comes of a shipped file: position, deviation, deviation of the negative direction."""


def test_every_shipped_file_gives_the_figure_of_its_page(folder: Path) -> None:
    shipped = {one.name for one in (ROOT / "examples" / "files").iterdir()}
    page_text = (DOCS / "from-file-to-figure.md").read_text(encoding="utf-8")
    calls = [words for where, words in _calls() if where == "from-file-to-figure.md"]
    printed: dict[str, str] = {}
    for words in calls:
        given = [str(ROOT / word) if word.startswith("examples/") else word for word in words]
        ended = CliRunner().invoke(app, given)
        assert ended.exit_code == 0, f"{words}: {ended.output}\n{ended.exception!r}"
        for name in shipped & set(words):
            printed[name] = printed.get(name, "") + ended.output
            if words[:2] == ["tables", "convert"]:
                printed[name] += (folder / words[-1]).read_text(encoding="utf-8")
    assert set(printed) == shipped == {*FIGURES, *POINTS}
    assert [name for name, figure in (FIGURES | POINTS).items() if figure not in printed[name]] == []
    assert [name for name, figure in FIGURES.items() if figure not in page_text] == []


def test_every_command_that_needs_no_machine_runs(folder: Path) -> None:
    ran = 0
    for where, words in _to_run(ALONE):
        if words[:2] == ["tables", "diff"]:
            (folder / words[3]).write_bytes((folder / words[2]).read_bytes())
        ended = CliRunner().invoke(app, words)
        assert ended.exit_code in (0, *VERDICTS), f"{where}: {words}: {ended.output}\n{ended.exception!r}"
        ran += 1
    assert ran >= 12


@pytest.mark.long
def test_every_command_that_looks_at_a_control_runs_at_a_simulated_one(
    trueflank_cell: CellStarter, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = trueflank_cell("zero", speed=200.0)
    assert cell.site.name == "site.toml"
    monkeypatch.chdir(cell.site.parent)
    done: set[str] = set()
    for where, words in sorted(_to_run(AT_A_CELL), key=lambda call: "self-test" not in call[1]):
        if " ".join(words) not in done:
            ended = CliRunner().invoke(app, words)
            assert ended.exit_code == 0, f"{where}: {words}: {ended.output}\n{ended.exception!r}"
        done.add(" ".join(words))
    assert len(done) >= len(AT_A_CELL)


def test_the_page_of_commands_is_current() -> None:
    wanted = command_page().rstrip() + "\n"
    assert (DOCS / "commands.md").read_text(encoding="utf-8") == wanted, (
        "run: trueflank docs commands > docs/commands.md"
    )


def test_the_page_of_the_states_of_a_push_is_current() -> None:
    wanted = "run: trueflank docs schema --states > docs/push-states.md"
    assert (DOCS / "push-states.md").read_text(encoding="utf-8") == transitions_in_markdown().rstrip() + "\n", wanted


def test_the_output_in_the_readme_is_real() -> None:
    block = next(text for text in _blocks(README.read_text(encoding="utf-8"), "") if text.startswith("$ trueflank"))
    command, *shown = block.splitlines()
    ended = CliRunner().invoke(app, shlex.split(command)[2:])
    assert ended.exit_code == 0, ended.output
    assert len(shown) >= 10
    assert [line for line in shown if line.strip() != "..." and line not in ended.output.splitlines()] == []


def test_the_first_page_names_every_command() -> None:
    names = {
        name for name, command in typer.main.get_command(app).commands.items() if not getattr(command, "hidden", False)
    }
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    assert sorted(name for name in names if f"`{name}`" not in text) == []


def test_every_term_of_the_glossary_is_used() -> None:
    lines = (DOCS / "glossary.md").read_text(encoding="utf-8").splitlines()
    terms = [found[1] for line in lines if (found := re.match(r"\| \*\*(.+?)\*\* \|", line))]
    assert len(terms) >= 60
    assert len(terms) == len(set(terms))
    pages = [path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md") if path.name != "glossary.md"]
    texts = [text for entry in catalogue().values() for text in entry.values()]
    everything = re.sub(r"\s+", " ", " ".join((*pages, README.read_text(encoding="utf-8"), *texts))).replace("*", "")
    unused = [term for term in terms if not re.search(rf"\b{re.escape(term)}", everything, re.IGNORECASE)]
    assert unused == []


def test_the_blocks_of_toml_can_be_read() -> None:
    blocks = [text for path in (README, *DOCS.glob("*.md")) for text in _blocks(path.read_text("utf-8"), "toml")]
    assert len(blocks) > 1
    assert all(tomllib.loads(text) for text in blocks)
