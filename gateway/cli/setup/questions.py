"""Questions for a site file, asked at a terminal or answered beforehand; checks of answers; files of secrets."""

from __future__ import annotations

import re
import secrets
import shutil
import sys
import textwrap
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeVar

import typer

from drivers import registry
from drivers.errors import ConfigError, TrueflankError, words
from drivers.local.names import shown
from drivers.local.ownfiles import open_own
from drivers.message import Message
from gateway.audit import os_user
from gateway.cli.output import echo
from gateway.cli.setup.site_tree import OPTICS
from gateway.cli.signals import run_to_end
from gateway.errors import InvalidOption

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Objection:
    """Why an answer will not do, by the catalogue."""

    code: str
    fields: Mapping[str, Any] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """In English words."""
        return words(self.code, **self.fields)


def objection(code: str, /, **fields: object) -> Objection:
    """Why an answer will not do."""
    return Objection(code, fields)


AnswerCheck = Callable[[str], Objection | None]
"""An answer to None where it will do, else to why not."""


class Questioner(Protocol):
    """Whoever asks the questions of a site file: a terminal, or the page of a service that has no site yet."""

    @property
    def who(self) -> str:
        """The person who answers, for the records."""
        ...

    def ask(
        self, key: str, code: str, default: str, judge: AnswerCheck = ..., *, secret: bool = False, **fields: str
    ) -> str:
        """The answer to one question, which the judge lets pass; ``fields`` are filled into its text."""
        ...

    def tell(self, code: str, *, loud: bool = False, **fields: object) -> None:
        """Say what was found between the questions."""
        ...

    def found(self, what: tuple[object, ...], work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """What a device answers; ``what`` names everything that the answer depends on. Raises what the work raises."""
        ...


def accept_any(_text: str) -> Objection | None:
    """Every answer will do."""
    return None


@dataclass(frozen=True, slots=True)
class TerminalQuestioner:
    """Asks on the terminal or from a pipe; ``given`` answers are not asked, with ``silent`` nothing is."""

    given: Mapping[str, str]
    silent: bool

    @property
    def who(self) -> str:
        """Whoever is at the terminal."""
        return os_user()

    def tell(self, code: str, *, loud: bool = False, **fields: object) -> None:
        """On the terminal."""
        echo(Message.of(code, **fields), colour="yellow" if loud else None)

    def found(self, _what: tuple[object, ...], work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Asked each time."""
        return run_to_end(work())

    def ask(
        self, key: str, code: str, default: str, judge: AnswerCheck = accept_any, *, secret: bool = False, **fields: str
    ) -> str:
        """The answer to one question. Raises ConfigError (E-INIT-ANSWER, E-INIT-ENDED)."""
        if key in self.given or self.silent:
            answer = self.given.get(key, default)
            if wrong := judge(answer):
                raise ConfigError("E-INIT-ANSWER", "init", key=key, answer=shown(answer), why=wrong.words)
            return answer
        echo(f"\n{words(code, **fields)}", bold=True)
        echo(_indent(words(code, "do")))
        while True:
            answer = _read_answer(key, default, secret=secret)
            if (wrong := judge(answer)) is None:
                return answer
            echo(f"  {wrong.words}", colour="yellow")


def _indent(text: str) -> str:
    """Two columns in, broken between words where a terminal would break anywhere."""
    wide = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    return textwrap.fill(text, wide, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)


def _read_answer(key: str, default: str, *, secret: bool) -> str:
    hidden = secret and sys.stdin.isatty()
    try:
        return str(typer.prompt(f"  {key}", default=default, hide_input=hidden, show_default=bool(default))).strip()
    except typer.Abort as error:
        raise InvalidOption("E-INIT-ENDED", "init", key=key) from error


def parse_answers(given: list[str]) -> dict[str, str]:
    """Options KEY=VALUE. Raises ConfigError (E-INIT-OPTION)."""
    pairs = [one.partition("=") for one in given]
    for key, sign, _ in pairs:
        if not sign or key not in QUESTION_KEYS:
            raise ConfigError("E-INIT-OPTION", "command line", text=shown(key), known=", ".join(QUESTION_KEYS))
    return {key: value for key, _, value in pairs}


QUESTION_KEYS = (
    *("road", "name", "url", "user", "password", "thumbprint", "serial"),
    *("axes", "travel", "order", "cross", "safe", "laser", "calibrator", "gear", "optics"),
)


# ---- checks of answers about instruments, gear and optics

NONE, SAMPLE = "none", "example"
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")


def check_instrument(text: str) -> Objection | None:
    """A driver and an address that it opens."""
    parts, known = text.split(maxsplit=1), registry.known("instrument")
    if len(parts) != 2 or parts[0] not in known:
        return objection("W-INIT-INSTRUMENT", known=", ".join(known))
    return check_address(parts[0], "instrument", parts[1])


def check_address(driver: str, role: str, url: str) -> Objection | None:
    """Whether a driver opens this kind of address."""
    from gateway.config import address_of

    wrong = address_of(driver, role, url)
    return None if wrong is None else objection(wrong[0], **wrong[1])


def split_gear_height(text: str) -> tuple[str, float]:
    """A gear file and the height behind it, mm; 0 where none is given."""
    name, _, height = text.rpartition(" ")
    return (name.strip(), float(height)) if name and _NUMBER.fullmatch(height) else (text.strip(), 0.0)


def check_gear_file(text: str, folder: Path) -> Objection | None:
    """A gear file beside the site file, the example, or none."""
    from gateway.study.inputs import load_gear

    name, _ = split_gear_height(text)
    if text == NONE or name == SAMPLE:
        return None
    try:
        load_gear(folder / name)
    except (TrueflankError, OSError) as error:
        # The answer names the file already.
        return objection("W-INIT-GEAR", why=error.what if isinstance(error, TrueflankError) else error)
    return None


def check_optics(text: str) -> Objection | None:
    """Optics by their names, each with or without a driver and an address."""
    if text == NONE:
        return None
    parts = [part.split(maxsplit=1) for part in text.split(",")]
    names = [part[0] for part in parts if part]
    if len(names) < len(parts) or len(set(names)) < len(names) or not set(names) <= set(OPTICS):
        return objection("W-INIT-OPTICS", known=", ".join(OPTICS))
    return next(filter(None, (check_instrument(part[1]) for part in parts if len(part) > 1)), None)


# ---- secrets of a control, in files that only their owner can read

TOKEN_FILE, TOKEN_BYTES = "token.txt", 24
PASSWORD_FILE, PASSWORD_VARIABLE = "password.txt", "TRUEFLANK_PASSWORD"


def keep_token(asker: Questioner, folder: Path) -> dict[str, str]:
    """Where the agent's token is; a new one is made where there is none, for its host as well."""
    place = folder / TOKEN_FILE
    if not place.exists():
        with open_own(place, "wb", secret=True) as file:
            file.write(f"{secrets.token_urlsafe(TOKEN_BYTES)}\n".encode())
        asker.tell("P-INIT-TOKEN", path=str(place))
    return {"token_file": TOKEN_FILE}


def keep_password(asker: Questioner, folder: Path) -> dict[str, str]:
    """Where the password is; a typed one goes into a file that only its owner reads, and into no site file."""
    place = folder / PASSWORD_FILE
    if place.exists():
        return {"password_file": PASSWORD_FILE}
    typed = asker.ask("password", "P-INIT-PASSWORD", "", secret=True)
    if not typed:
        return {"password_env": PASSWORD_VARIABLE}
    with open_own(place, "wb", secret=True) as file:
        file.write(f"{typed}\n".encode())
    return {"password_file": PASSWORD_FILE}
