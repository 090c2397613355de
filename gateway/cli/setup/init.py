"""`init` and `init instrument`: a site file by questions in a terminal or on a page; a driver's package."""

from __future__ import annotations

import keyword
import re
import tomllib
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import Annotated, Any, TypeVar

import typer

from drivers import registry
from drivers.errors import ConfigError, TrueflankError, words
from drivers.message import Message
from gateway.cli.output import echo
from gateway.cli.setup.check import check_site, show_check, show_next_check
from gateway.cli.setup.questions import (
    PASSWORD_FILE,
    AnswerCheck,
    Objection,
    TerminalQuestioner,
    accept_any,
    parse_answers,
)
from gateway.cli.setup.wizard import STORE, wizard_text
from gateway.cli.signals import run_to_end
from gateway.errors import InvalidOption

FileArgument = Annotated[Path, typer.Argument(help="Site file to write; none is overwritten.")]
AnswerOption = Annotated[
    list[str] | None, typer.Option("--answer", help="KEY=VALUE: answer a question in advance.", show_default=False)
]


def init_command(
    file: FileArgument = Path("site.toml"),
    from_cell: Annotated[
        str,
        typer.Option("--from-cell", help="Describe a shipped simulated cell, for example demo.", show_default=False),
    ] = "",
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing: use the defaults and the given answers.")] = False,
    answer: AnswerOption = None,
) -> None:
    """Write a commented site file: a few questions, the rest is read from the control; nothing moves."""
    require_absent(file)
    if not file.parent.is_dir():
        raise ConfigError("E-INIT-FOLDER", str(file), folder=str(file.parent))
    if from_cell:
        text = cell_text(from_cell, file)
    else:
        from gateway.cli.setup.wizard import wizard_text

        text = wizard_text(file, TerminalQuestioner(parse_answers(answer or []), yes))
    write_site_file(file, text)
    echo("\n" + words("P-INIT-WRITTEN", file=file))
    found = check_site(file)
    show_check(found, file, [], as_json=False)
    show_next_check(found, file, connected=False)


def require_absent(file: Path) -> None:
    """Nothing stands there yet. Raises ConfigError (E-INIT-EXISTS)."""
    if file.exists() or file.is_symlink():
        raise ConfigError("E-INIT-EXISTS", str(file))


def write_site_file(file: Path, text: str) -> None:
    """Write a new site file. Raises ConfigError (E-INIT-EXISTS, E-INIT-WRITE)."""
    require_absent(file)
    try:
        with file.open("x", encoding="utf-8") as written:
            written.write(text)
    except OSError as error:
        raise ConfigError("E-INIT-WRITE", str(file), why=error.strerror or str(error)) from error


# ---- --from-cell: the site file of a shipped cell, with the meaning of each key


def cell_text(cell: str, file: Path) -> str:
    """Start the cell for a moment, take its site file, explain it. Raises ConfigError (E-CLI-CELL)."""
    from gateway.cli.cell import CellRequest, cell_process
    from gateway.config import site_text

    site = file.resolve().parent / f"{cell}-cell" / "site.toml"
    with cell_process(CellRequest(cell, site, 1.0, plan=True)):
        tree = tomllib.loads(site.read_text(encoding="utf-8"))
    return site_text(tree, words("P-INIT-CELL-HEAD", cell=cell, site=site))


# ---- the questions on the page of a service that has no site file yet
#
# The page sends every answer so far, and the questions are repeated up to the first open one: an answer can be changed,
# and the next question follows from it. The answers of the control are kept meanwhile.

T = TypeVar("T")
DeviceAnswers = dict[tuple[object, ...], Any]


class _OpenQuestion(Exception):
    """A question that has no answer yet, or one that will not do."""

    def __init__(self, question: dict[str, Any]) -> None:
        super().__init__(question["key"])
        self.question = question


class _PageQuestioner:
    """One way through the questions."""

    def __init__(self, answers: Mapping[str, str], known: DeviceAnswers, who: str) -> None:
        self.who = who
        self.asked: list[dict[str, Any]] = []
        self.told: list[dict[str, Any]] = []
        self._answers = answers
        self._known = known

    def ask(
        self, key: str, code: str, default: str, judge: AnswerCheck = accept_any, *, secret: bool = False, **fields: str
    ) -> str:
        """The answer that was sent; what is open ends this way."""
        answer = self._answers.get(key)
        why = None if answer is None else judge(answer)
        shown = "" if secret else answer or ""
        question = {"key": key, "code": code, "fields": fields, "secret": secret, "answer": shown}
        if answer is None or why is not None:
            raise _OpenQuestion({**question, "default": default, "wrong": _reason_record(why)})
        self.asked.append(question)
        return answer

    def tell(self, code: str, *, loud: bool = False, **fields: object) -> None:
        """Shown above the next question."""
        said = {"code": code, "fields": {key: str(value) for key, value in fields.items()}, "loud": loud}
        self.told.append({**said, "after": len(self.asked)})

    def found(self, what: tuple[object, ...], work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Asked once, until an earlier answer changes."""
        if what not in self._known:
            try:
                self._known[what] = run_to_end(work())
            except TrueflankError as error:
                self._known[what] = error
        kept = self._known[what]
        if isinstance(kept, TrueflankError):
            raise kept
        result: T = kept
        return result


def _reason_record(why: Objection | None) -> dict[str, Any] | None:
    return None if why is None else {"code": why.code, "fields": {key: str(one) for key, one in why.fields.items()}}


class SiteMaker:
    """Makes one site file by the answers of a page; nothing is overwritten."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.root = file.parent / STORE
        self._own_password = not (file.parent / PASSWORD_FILE).exists()
        self._known: DeviceAnswers = {}
        self._last: dict[str, str] = {}
        self._lock = Lock()

    def ask(self, answers: Mapping[str, str], who: str, *, anew: bool = False) -> dict[str, Any]:
        """The next question with what was found so far; no question where every one is answered.

        ``anew`` asks the control again. Blocks while the control is asked. Raises StoreError, ConfigError.
        """
        with self._lock:
            asking, question, _text = self._gone_through(answers, who, anew=anew)
        return {"file": str(self.file), "asked": asking.asked, "told": asking.told, "question": question}

    def write(self, answers: Mapping[str, str], who: str) -> dict[str, Any]:
        """Write the file; one that no site can be read from is taken back. Its faults, doubts and remarks are told.

        Raises ConfigError (E-INIT-ENDED, E-INIT-EXISTS, E-INIT-WRITE).
        """
        with self._lock:
            _asking, question, text = self._gone_through(answers, who, anew=False)
            if question is not None:
                raise InvalidOption("E-INIT-ENDED", "init", key=question["key"])
            write_site_file(self.file, text)
            found = check_site(self.file)
            if found.site is None:
                self.file.unlink()
        faults = [one.error(str(self.file)).as_record() for one in (*found.faults, *found.doubts)]
        told = {"faults": faults, "remarks": [one.as_data() for one in found.remarks]}
        return {"file": str(self.file), "made": found.site is not None, **told}

    def _gone_through(
        self, answers: Mapping[str, str], who: str, *, anew: bool
    ) -> tuple[_PageQuestioner, dict[str, Any] | None, str]:
        if anew or any(answers.get(key) != answer for key, answer in self._last.items()):
            self._known.clear()
        self._last = dict(answers)
        if self._own_password:  # asked again each time, so that another one can be given
            with suppress(FileNotFoundError):
                (self.file.parent / PASSWORD_FILE).unlink()
        asking = _PageQuestioner(answers, self._known, who)
        try:
            return asking, None, wizard_text(self.file, asking)
        except _OpenQuestion as still:
            return asking, still.question, ""


# ---- init instrument

NAME = re.compile(r"[a-z][a-z0-9_]{1,29}")
TEMPLATE = ".template"


def new_instrument_command(
    name: Annotated[
        str, typer.Argument(help="Name of the driver, as a site file will give it: lower-case letters, digits, _.")
    ],
    folder: Annotated[Path | None, typer.Option(help="Folder to create; trueflank-NAME if not given.")] = None,
) -> None:
    """Write a package with a driver for an instrument of your own: codec, settings, device, simulator and tests."""
    check_name(name)
    target = folder or Path(f"trueflank-{name}")
    written = write_package(name, target)
    fields = {"name": name, "count": len(written), "folder": target}
    echo(words("P-INIT-PACKAGE", **fields), colour="green")
    echo(words("P-INIT-PACKAGE", "do", **fields))


def check_name(name: str) -> None:
    """Raises ConfigError (E-INIT-PACKAGE-NAME) for a name that no Python package and no driver can have."""
    why: str | Message = ""
    if NAME.fullmatch(name) is None:
        why = Message.of("W-INIT-NAME")
    elif keyword.iskeyword(name):
        why = Message.of("W-INIT-PYTHON")
    elif name in registry.known():
        why = Message.of("W-INIT-DRIVER")
    elif find_spec(name) is not None:
        why = Message.of("W-INIT-PACKAGE")
    if why:
        raise ConfigError("E-INIT-PACKAGE-NAME", name, why=why)


def write_package(name: str, target: Path) -> list[Path]:
    """Write the files of the package into a folder that does not exist yet, and return them.

    Raises ConfigError: E-INIT-PACKAGE-EXISTS where the folder exists, E-CLI-WRITE where it cannot be written.
    """
    title = "".join(part.capitalize() for part in name.split("_"))
    try:
        target.mkdir(parents=True)
    except FileExistsError as error:
        raise ConfigError("E-INIT-PACKAGE-EXISTS", str(target)) from error
    except OSError as error:
        raise ConfigError("E-CLI-WRITE", str(target), why=str(error)) from error
    written = []
    for path, template in _templates(files("gateway.cli.setup") / "instrument"):
        place = target / Path(*(f"src/{name}" if part == "src" else part for part in path))
        place.parent.mkdir(parents=True, exist_ok=True)
        text = template.read_text(encoding="utf-8").replace("@name@", name).replace("@Name@", title)
        place.write_text(text, encoding="utf-8")
        written.append(place)
    return written


def _templates(folder: Traversable, above: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], Traversable]]:
    found: list[tuple[tuple[str, ...], Traversable]] = []
    for entry in sorted(folder.iterdir(), key=lambda one: one.name):
        if entry.is_dir():
            found += _templates(entry, (*above, entry.name))
        elif entry.name.endswith(TEMPLATE):
            found.append(((*above, entry.name.removesuffix(TEMPLATE)), entry))
    return found
