"""What an error says to do can be done: each command and option named exists, and following it ends the trouble.

The table drives the real commands: an input that provokes the code, then the remedy as printed, round by round, until
the command ends well. A code of files and sites that names a command or an option and stands in no list fails here.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from openpyxl import Workbook
from typer.testing import CliRunner, Result

import trueflank as tf
from drivers.errors import TrueflankError, catalogue
from gateway.cli import app
from gateway.cli.next_steps import NEXT_COMMANDS
from tests.unit.cli.test_remedies_at_work import AT_WORK
from tests.unit.drivers.test_rtx_files import written

ROOT = Path(__file__).parents[3]
GOLDEN = ROOT / "tests" / "golden" / "files"
SITE = ROOT / "examples" / "sites" / "files-only.toml"
RUNNER = CliRunner()
MOST_ROUNDS = 6
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
CALL = re.compile(
    r"trueflank((?: [a-z][a-z-]*)+)((?: (?:--?[a-zA-Z][\w-]*|[A-Z][\w=.:/]*|\.\.\.|NAME=VALUE|[\w]+=[\w]+))*)"
)
FOLLOWED = (
    "E-FILE-",
    "E-IMPORT-",
    "E-DAY-",
    "E-CFG-",
    "E-COMP-",
    "E-DOUBT-",
    "E-EXPORT-",
    "E-KIND-",
    "E-CLI-",
    "E-EVAL-",
)
"""Codes that files, sites and what was typed about them raise: their remedies are executed."""
Words = list[str]
Answer = Callable[[Words, "Raised"], Words]


# ------------------------------------------------------------------------------------- every command and option exists


def command_of(words: list[str]) -> tuple[Any, list[str]] | None:
    """The command that the first words name, and the words behind it; None where the first is none."""
    found, depth = typer.main.get_command(app), 0
    while words and words[0] in getattr(found, "commands", {}):
        found, words, depth = found.commands[words[0]], words[1:], depth + 1
    return (found, words) if depth else None


def options_of(command: Any) -> set[str]:
    return {name for one in command.params for name in (*one.opts, *one.secondary_opts)} | {"--help"}


def every_option() -> set[str]:
    found: set[str] = set()
    groups: list[Any] = [typer.main.get_command(app)]
    while groups:
        one = groups.pop()
        found |= options_of(one)
        groups += [inner for _name, inner in getattr(one, "commands", {}).items()]
    return found


def wrong_calls(text: str) -> list[str]:
    """Calls of a text whose command does not exist or lacks an option that is named with it."""
    wrong = []
    marked = re.findall(r"`(trueflank [^`]+)`", text)
    # Without marks it may be a sentence about the program, so only what begins as a command counts.
    for line in marked or [call for one in CALL.finditer(text) if command_of((call := one.group()).split()[1:])]:
        words = [word.rstrip(".,;:") for word in shlex.split(line.replace("...", ""))[1:]]
        found = command_of(words)
        if found is None:
            wrong.append(line)
            continue
        command, rest = found
        wrong += [f"{line}: {word}" for word in rest if word.startswith("--") and word not in options_of(command)]
    return wrong


@pytest.mark.parametrize("language", ["en", "de", "zh"])
def test_every_command_and_option_that_a_text_names_exists(language: str) -> None:
    known, wrong = every_option(), []
    assert {"--accept-doubt", "--apply", "--column"} <= known
    for code, entry in catalogue(language).items():
        text = entry.get("do", "")
        wrong += [f"{code}: {one}" for one in wrong_calls(text)]
        wrong += [f"{code}: {one}" for one in OPTION.findall(text) if one not in known]
    assert wrong == []


def test_every_next_command_exists() -> None:
    lines = [f"trueflank {text.split(' (')[0].replace('{', '').replace('}', '')}" for text in NEXT_COMMANDS.values()]
    assert len(lines) > 20
    assert [one for line in lines for one in wrong_calls(f"`{line}`")] == []


def test_a_command_or_option_that_does_not_exist_is_found() -> None:
    assert wrong_calls("run `trueflank evalute FILE`") == ["trueflank evalute FILE"]
    assert wrong_calls("run `trueflank evaluate FILE --colum target=1`") == [
        "trueflank evaluate FILE --colum target=1: --colum"
    ]
    assert wrong_calls("say it once: trueflank import --column passes=up FILE") == []


# -------------------------------------------------------------------------------------------- the remedies are executed


@dataclass(frozen=True)
class Raised:
    """An error as a command prints it: raised, or in the record of one of several files."""

    code: str
    hint: str
    fields: Mapping[str, object]


def raised(result: Result) -> Raised | None:
    error = result.exception
    if isinstance(error, TrueflankError):
        return Raised(error.code, error.hint, error.fields)
    assert error is None or isinstance(error, SystemExit), result.output
    records = json.loads(result.stdout) if result.stdout.startswith(("[", "{")) else []
    failed = [one["error"] for one in records if isinstance(one, dict) and "error" in one]
    return Raised(failed[0]["code"], failed[0]["do"], failed[0]) if failed else None


def add(*words: str) -> Answer:
    """The options that the remedy names, behind what was typed."""
    return lambda typed, _error: [*typed, *words]


def instead(old: str, *new: str) -> Answer:
    """Other words in the place of one that was wrong; none leave it out."""

    def answer(typed: Words, _error: Raised) -> Words:
        at = typed.index(old)
        return [*typed[:at], *new, *typed[at + 1 :]]

    return answer


def edited(name: str, old: str, new: str) -> Answer:
    """The file as the remedy wants it, the first ``old`` in it replaced, and the same words again."""

    def answer(typed: Words, _error: Raised) -> Words:
        Path(name).write_text(Path(name).read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
        return typed

    return answer


def book(path: Path, text: str) -> None:
    """A workbook with the same table in two sheets."""
    made = Workbook()
    for title in ("one", "two"):
        sheet = made.create_sheet(title)
        for line in text.splitlines():
            sheet.append([float(cell) if re.fullmatch(r"[\d.]+", cell) else cell for cell in line.split(",")])
    made.save(path)


@dataclass(frozen=True)
class Remedy:
    """``words`` typed in a folder with ``files`` raise the first code of ``answers``; each answer follows one code."""

    words: str
    answers: Mapping[str, Answer]
    files: Mapping[str, str]
    named: tuple[str, ...] = ()


def table(heading: str, *rows: str) -> str:
    return "\n".join((heading, *rows, ""))


def both_ways(places: tuple[float, ...], gap: float = 0.0) -> list[str]:
    turns = {places[-1]: gap}
    return [f"{at},{way},{run},{at % 7 / 10 + turns.get(at, 0.0)}" for at in places for way in "+-" for run in (1, 2)]


LINE = table("target_mm,direction,repetition,deviation_um", *both_ways((0.0, 10.0, 20.0, 30.0)))
UNEVEN = table("target_mm,direction,repetition,deviation_um", *both_ways((0.0, 11.0, 20.0, 30.0)))
OPEN = table("target_deg,direction,repetition,deviation_arcsec", *both_ways((0.0, 90.0, 180.0, 270.0, 360.0), 9.0))
TURN = table("target_deg,direction,repetition,deviation_um", *both_ways((0.0, 60.0, 120.0, 180.0, 240.0, 300.0)))
PASSES = table("target_mm,Run 1 [um],Run 2 [um]", "0,0.1,0.4", "10,1.2,1.5", "20,2.0,2.4", "30,1.1,1.4")
RUNS = table("target_mm,run,deviation_um", *(f"{10 * at},{run},{at}.{run}" for run in (1, 2) for at in range(4)))
STRANGE = table("A mm;B mm", "0;0.0001", "10;10.0002", "20;20.0004", "30;30.0001")
SMALL = table(
    "target_mm,direction,repetition,deviation", *(f"{10 * at},{way},1,0.00{at}" for at in range(4) for way in "+-")
)
INSTRUMENTS = table(
    "target_mm,direction,repetition,Encoder [mm],Laser [mm]",
    *(f"{10 * at},{way},1,{10 * at}.000{at},{10 * at}.001{at}" for at in range(4) for way in "+-"),
)
EXCHANGED = table(
    "Target [mm];Direction;Measured [mm]",
    *(f"{10 * at + run / 997:.4f};+;{10 * at}" for run in range(5) for at in range(4)),
)
TWO = table(
    *("target_mm,deviation_um", *(f"{at},0.{at}" for at in (10, 20, 30)), "", "backward"),
    *("target_mm,deviation_um", *(f"{at},0.{at}" for at in (10, 20, 30))),
)
MOTIONS = table("target_mm,EXX [um],EYX [um]", *(f"{10 * at},0.{at},0.{2 * at}" for at in range(4)))
CHANNELS = table(
    "target_mm,Linear [um],Straightness Y [um],Pitch [urad]", *(f"{10 * at},0.{at},0.{2 * at},{at}" for at in range(4))
)
SIX = table(
    "target_mm,EXX [um],EYX [um],EZX [um],EAX [urad],EBX [urad],ECX [urad]",
    *(f"{10 * at},0.{at},0.{2 * at},{at},1,2,{3 * at}" for at in range(4)),
)
TO_EEC = "tables convert f.csv --to eec --axis X1 --reference 0 --datum 0=0 -o out.spf"
DATUM = {"E-CLI-DATUM": add("--reference", "0", "--datum", "0=0")}
LIST: Answer = lambda _typed, _error: ["evaluate", "--standard", "list"]  # noqa: E731 - the printed command itself

COM = table("BEGIN AXIS_X.COM MM", "NR AXISPOS BACKLASH X", "0 -10 0.004 0.001", "1 0 0.005 0.002", "[END]")


def converted(words: Words, error: Raised) -> Words:
    """The command that the remedy prints, with the file that was given."""
    (call,) = re.findall(r"trueflank (tables convert .+)$", error.hint)
    return [words[-1] if word == "FILE" else word for word in shlex.split(call)]


REMEDIES: Mapping[str, Remedy] = {
    "E-IMPORT-COLUMNS": Remedy(
        "import --json f.csv",
        {"E-IMPORT-COLUMNS": add("--column", "target=1", "--column", "measured=2")},
        {"f.csv": STRANGE},
    ),
    "E-IMPORT-WAYS": Remedy(
        "import --json f.csv", {"E-IMPORT-WAYS": add("--column", "passes=alternate")}, {"f.csv": PASSES}
    ),
    "E-IMPORT-RUNS": Remedy(
        "import --json f.csv", {"E-IMPORT-RUNS": add("--column", "direction=runs")}, {"f.csv": RUNS}
    ),
    "E-IMPORT-READINGS": Remedy(
        "import --json f.csv", {"E-IMPORT-READINGS": add("--column", "reading_unit=um")}, {"f.csv": SMALL}
    ),
    "E-IMPORT-CHOOSE": Remedy(
        "import --json f.csv", {"E-IMPORT-CHOOSE": add("--column", "measured=4")}, {"f.csv": INSTRUMENTS}
    ),
    "E-FILE-RTA-UNIT": Remedy(
        "import --json rotary.rta", {"E-FILE-RTA-UNIT": add("--unit", "arcsec")}, {"rotary.rta": ""}
    ),
    "E-FILE-CONTROL": Remedy(
        "import --json x.com", {"E-FILE-CONTROL": converted, "E-EXCHANGE-SIGN": add("--form", "error")}, {"x.com": COM}
    ),
    "E-CLI-DATUM": Remedy("tables convert f.csv --to eec --axis X1 -o out.spf", DATUM, {"f.csv": LINE}),
    "E-CLI-AXIS": Remedy(
        "tables convert f.csv --to eec --reference 0 --datum 0=0 -o out.spf",
        {"E-CLI-AXIS": add("--axis", "X1")},
        {"f.csv": LINE},
    ),
    "E-CLI-AXIS-UNIT": Remedy(
        TO_EEC.replace("X1", "C1"), {"E-CLI-AXIS-UNIT": instead("C1", "X1")}, {"f.csv": LINE}, ("--axis",)
    ),
    "E-CLI-KIND": Remedy(
        "evaluate --json f.rtx --unit mm",
        {"E-CLI-KIND": lambda _typed, _error: ["measure", "dynamic", "f.rtx", "--unit", "mm"]},
        {"f.rtx": ""},
        ("trueflank measure dynamic",),
    ),
    "E-CLI-LAYER": Remedy(TO_EEC.replace("eec", "both"), {"E-CLI-LAYER": instead("both", "eec")}, {"f.csv": LINE}),
    "E-CLI-EXISTS": Remedy(TO_EEC, {"E-CLI-EXISTS": add("--force")}, {"f.csv": LINE, "out.spf": "older"}),
    "E-CLI-COLUMN": Remedy(
        "import --json f.csv --column target --column measured=2",
        {"E-CLI-COLUMN": instead("target", "target=1")},
        {"f.csv": STRANGE},
    ),
    "E-COMP-NO-GRID": Remedy(
        TO_EEC, {"E-COMP-NO-GRID": add("--min", "0", "--max", "30", "--step", "5")}, {"f.csv": UNEVEN}
    ),
    "E-COMP-DATUM": Remedy(
        f"{TO_EEC} --datum 10=25", {"E-COMP-DATUM": instead("10=25", "10=10")}, {"f.csv": LINE}, ("--datum",)
    ),
    "E-COMP-REACH": Remedy(
        f"{TO_EEC} --min -10 --step 10", {"E-COMP-REACH": instead("-10", "0")}, {"f.csv": LINE}, ("--min", "--max")
    ),
    "E-COMP-FREE": Remedy(
        "tables convert f.csv --to linuxcnc --axis X --reference 99 --datum 0=0 -o out.comp",
        {"E-COMP-FREE": instead("99", "10")},
        {"f.csv": LINE},
        ("--reference",),
    ),
    "E-DOUBT-OPEN": Remedy(
        f"{TO_EEC.replace('X1', 'C1')} --modulo",
        {
            "E-DOUBT-OPEN": lambda typed, error: [
                *typed,
                "--accept-doubt",
                f"{error.fields['first']}=slipped at the end",
            ]
        },
        {"f.csv": OPEN},
        ("--accept-doubt",),
    ),
    "E-DOUBT-ACCEPT": Remedy(
        f"{TO_EEC.replace('X1', 'C1')} --modulo --accept-doubt slipped",
        {"E-DOUBT-ACCEPT": instead("slipped", "S-EVAL-CLOSURE-FAR=slipped")},
        {"f.csv": OPEN},
        ("--accept-doubt",),
    ),
    "E-CLI-LIMIT": Remedy("evaluate f.csv --limit A10", {"E-CLI-LIMIT": instead("A10", "A=1000")}, {"f.csv": LINE}),
    "E-CLI-NO-FILES": Remedy("evaluate", {"E-CLI-NO-FILES": LIST}, {}),
    "E-CLI-STANDARD": Remedy("evaluate f.csv --standard iso9999", {"E-CLI-STANDARD": LIST}, {"f.csv": LINE}),
    "E-CLI-SITE-KIND": Remedy(
        "evaluate f.csv --kind straightness --site site.toml",
        {"E-CLI-SITE-KIND": lambda typed, _error: [word for word in typed if word not in ("--site", "site.toml")]},
        {"f.csv": LINE, "site.toml": ""},
        ("--site",),
    ),
    "E-KIND-NAME": Remedy(
        "evaluate f.csv --kind bent", {"E-KIND-NAME": instead("bent", "straightness")}, {"f.csv": LINE}, ("--kind",)
    ),
    "E-EXPORT-FORM": Remedy(
        "runs export f.csv --to doc -o out.csv", {"E-EXPORT-FORM": instead("doc", "csv")}, {"f.csv": LINE}, ("--to",)
    ),
    "E-CLI-NOT-DYNAMIC": Remedy(
        "measure dynamic f.csv", {"E-CLI-NOT-DYNAMIC": lambda _typed, _error: ["evaluate", "f.csv"]}, {"f.csv": LINE}
    ),
    "E-FILE-EXCHANGED": Remedy(
        "import --json f.csv",
        {"E-FILE-EXCHANGED": add("--column", "target=3", "--column", "measured=1", "--column", "direction=2")},
        {"f.csv": EXCHANGED},
    ),
    "E-FILE-CSV-SECOND": Remedy(
        "import --json f.csv", {"E-FILE-CSV-SECOND": edited("f.csv", "target_mm", "forward\ntarget_mm")}, {"f.csv": TWO}
    ),
    "E-EXPORT-AXIS": Remedy(
        "evaluate --json f.csv --axis EZX", {"E-EXPORT-AXIS": instead("EZX", "EYX")}, {"f.csv": MOTIONS}, ("--axis",)
    ),
    "E-IMPORT-MOTION": Remedy(
        "import --json f.csv --motion EZX",
        {"E-IMPORT-MOTION": instead("EZX", "EYX")},
        {"f.csv": MOTIONS},
    ),
    "E-IMPORT-MOTION-TWICE": Remedy(
        "import --json f.csv",
        {"E-IMPORT-MOTION-TWICE": add("--column", "EXX=2")},
        {"f.csv": MOTIONS.replace("EYX", "EXX")},
    ),
    "E-IMPORT-MOTION-UNIT": Remedy(
        "import --json f.csv",
        {
            "E-IMPORT-MOTION-UNIT": add(
                *("--column", "EXX=2", "--column", "EYX=3", "--column", "reading_unit=um", "--column", "target_unit=mm")
            )
        },
        {"f.csv": MOTIONS.replace(" [um]", "")},
    ),
    "E-IMPORT-MOTION-AXIS": Remedy(
        "import --json f.csv",
        {
            "E-IMPORT-MOTION-AXIS": add("--column", "axis=X"),
            "E-IMPORT-MOTION-SENSE": add("--column", "EYX_sense=1", "--column", "EBX_sense=-1"),
        },
        {"f.csv": CHANNELS},
    ),
    "E-IMPORT-MOTION-SENSE": Remedy(
        "import --json f.csv --column axis=X",
        {"E-IMPORT-MOTION-SENSE": add("--column", "EYX_sense=1", "--column", "EBX_sense=-1")},
        {"f.csv": CHANNELS},
    ),
    "E-IMPORT-MOTION-WHICH": Remedy(
        "import --json f.csv --column axis=Z",
        {"E-IMPORT-MOTION-WHICH": add("--column", "EZZ=2", "--column", "EYZ=3", "--column", "EAZ=4")},
        {"f.csv": CHANNELS},
    ),
    "E-CLI-OFFSET": Remedy(
        "evaluate f.csv --kind six-dof --offset 1,2",
        {"E-CLI-OFFSET": instead("1,2", "0,120,-35")},
        {"f.csv": SIX},
        ("--offset",),
    ),
    "E-IMPORT-SEVERAL": Remedy(
        TO_EEC,
        {"E-IMPORT-SEVERAL": lambda _typed, _error: ["import", "f.csv", "--motion", "EXX"]},
        {"f.csv": MOTIONS},
    ),
    "E-IMPORT-SHEET": Remedy(
        "import --json f.xlsx", {"E-IMPORT-SHEET": add("--column", "sheet=two")}, {"f.xlsx": LINE}, ("sheet=",)
    ),
    "E-KIND-FILES": Remedy(
        "evaluate f.csv --kind squareness",
        {
            "E-KIND-FILES": lambda _typed, _error: ["evaluate", "f.csv", "f.csv", "--kind", "squareness"],
            "E-KIND-SENSES": add("--senses", "in,out"),
        },
        {"f.csv": LINE},
    ),
    "E-KIND-SENSES": Remedy(
        "evaluate f.csv f.csv --kind squareness",
        {"E-KIND-SENSES": add("--senses", "in,out")},
        {"f.csv": LINE},
        ("--senses",),
    ),
    "E-KIND-SIDES": Remedy(
        "evaluate f.csv f.csv --kind parallelism",
        {"E-KIND-SIDES": add("--senses", "same")},
        {"f.csv": LINE},
        ("--senses",),
    ),
    "E-KIND-UNIT": Remedy(
        "evaluate f.csv --kind angular --axis X --angle pitch",
        {"E-KIND-UNIT": edited("f.csv", "deviation_um", "deviation_arcsec")},
        {"f.csv": LINE},
    ),
    "E-KIND-MOTION": Remedy(
        "evaluate f.csv --kind rotary-motion --axis C --motion bent",
        {"E-KIND-MOTION": instead("bent", "axial")},
        {"f.csv": TURN},
        ("--motion",),
    ),
    "E-KIND-DISTANCE": Remedy(
        "evaluate f.csv f.csv --kind rotary-motion --axis C --motion tilt",
        {"E-KIND-DISTANCE": add("--distance", "100")},
        {"f.csv": TURN},
    ),
    "E-EVAL-NOT-LINEAR": Remedy(
        "evaluate --json rotary.csv --air edlen",
        {"E-EVAL-NOT-LINEAR": lambda _typed, _error: ["evaluate", "rotary.csv"]},
        {"rotary.csv": OPEN.replace("9.", "0.")},
        ("--air",),
    ),
}
"""What provokes each code, and its remedy."""
ELSEWHERE = {
    "E-CFG-CERTIFICATE": "a thumbprint that a person reads at the control's own display: tests/contract",
}
"""Remedies that are followed elsewhere, or that nobody can follow here, each with the reason."""


def names_something(text: str) -> bool:
    return bool(OPTION.search(text) or "trueflank " in text)


def test_every_remedy_of_files_and_sites_is_followed_or_excused() -> None:
    asked = {
        code
        for code, entry in catalogue().items()
        if code.startswith(FOLLOWED) and names_something(entry.get("do", ""))
    }
    followed = {*REMEDIES, *AT_WORK, "E-CFG-NOTHING", "E-EVAL-STANDARD"}
    assert sorted(asked - followed - set(ELSEWHERE)) == []
    assert followed & set(ELSEWHERE) == set()
    assert set(ELSEWHERE) <= asked, "an excuse for a code that names nothing to follow, or is none"
    assert followed <= set(catalogue())


@pytest.mark.parametrize("code", REMEDIES)
def test_following_what_is_printed_ends_the_trouble(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    remedy = REMEDIES[code]
    monkeypatch.chdir(tmp_path)
    for name, text in remedy.files.items():
        if name.endswith(".xlsx"):
            book(Path(name), text)
        elif name.endswith(".rtx"):
            written(Path(name), np.sin(np.arange(2000.0) / 30.0))
        elif text:
            Path(name).write_text(text, encoding="utf-8")
        else:
            shutil.copy(SITE if name.endswith(".toml") else GOLDEN / name, name)
    words, met = shlex.split(remedy.words), []
    for _ in range(MOST_ROUNDS):
        result = RUNNER.invoke(app, words)
        error = raised(result)
        if error is None:
            break
        assert error.code in remedy.answers, str(error)
        assert all(name in error.hint for name in remedy.named), error.hint
        met.append(error.code)
        typed, words = words, remedy.answers[error.code](words, error)
        new = [word for word in words if word.startswith("--") and word not in typed]
        assert all(option in error.hint for option in new), f"{new} are not in: {error.hint}"
    assert met[:1] == [code]
    assert result.exit_code == 0, result.output


def test_the_library_names_the_command_that_lists_the_standards() -> None:
    with pytest.raises(TrueflankError) as refused:
        tf.evaluate(tf.read(GOLDEN / "basic.rtl"), "iso9999")
    assert refused.value.code == "E-EVAL-STANDARD"
    (call,) = re.findall(r"`trueflank ([^`]+)`", refused.value.hint)
    assert RUNNER.invoke(app, shlex.split(call)).exit_code == 0


def test_a_site_file_that_is_not_there_is_copied_from_the_examples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused = RUNNER.invoke(app, ["check", "site.toml"])
    assert isinstance(refused.exception, TrueflankError)
    assert "trueflank init" in catalogue()["E-CFG-NOTHING"]["do"]
    shutil.copytree(SITE.parent, tmp_path / "sites")
    assert RUNNER.invoke(app, ["check", "sites/files-only.toml"]).exit_code in (0, 2)
