"""Questions for a site file: each has a default and says why it is asked; asked at a terminal or given beforehand."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import typer

from drivers.errors import ConfigError, words
from drivers.local.names import shown
from drivers.message import Message
from gateway.audit import os_user
from gateway.cli.show import echo
from gateway.cli.stopping import run_to_end
from gateway.errors import InvalidOption

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Why:
    """Why an answer will not do, by the catalogue."""

    code: str
    fields: Mapping[str, Any] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """In English words."""
        return words(self.code, **self.fields)


def why(code: str, /, **fields: object) -> Why:
    """Why an answer will not do."""
    return Why(code, fields)


Judge = Callable[[str], Why | None]
"""An answer to None where it will do, else to why not."""


class Questioner(Protocol):
    """Whoever asks the questions of a site file: a terminal, or the page of a service that has no site yet."""

    @property
    def who(self) -> str:
        """The person who answers, for the records."""
        ...

    def ask(self, key: str, code: str, default: str, judge: Judge = ..., *, secret: bool = False, **fields: str) -> str:
        """The answer to one question, which the judge lets pass; ``fields`` are filled into its text."""
        ...

    def tell(self, code: str, *, loud: bool = False, **fields: object) -> None:
        """Say what was found between the questions."""
        ...

    def found(self, what: tuple[object, ...], work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """What a device answers; ``what`` names everything that the answer depends on. Raises what the work raises."""
        ...


def anything(_text: str) -> Why | None:
    """Every answer will do."""
    return None


@dataclass(frozen=True, slots=True)
class Asker:
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
        self, key: str, code: str, default: str, judge: Judge = anything, *, secret: bool = False, **fields: str
    ) -> str:
        """The answer to one question. Raises ConfigError (E-INIT-ANSWER, E-INIT-ENDED)."""
        if key in self.given or self.silent:
            answer = self.given.get(key, default)
            if wrong := judge(answer):
                raise ConfigError("E-INIT-ANSWER", "init", key=key, answer=shown(answer), why=wrong.words)
            return answer
        echo(f"\n{words(code, **fields)}", bold=True)
        echo(_indented(words(code, "do")))
        while True:
            answer = _typed(key, default, secret=secret)
            if (wrong := judge(answer)) is None:
                return answer
            echo(f"  {wrong.words}", colour="yellow")


def _indented(text: str) -> str:
    """Two columns in, broken between words where a terminal would break anywhere."""
    wide = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    return textwrap.fill(text, wide, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)


def _typed(key: str, default: str, *, secret: bool) -> str:
    hidden = secret and sys.stdin.isatty()
    try:
        return str(typer.prompt(f"  {key}", default=default, hide_input=hidden, show_default=bool(default))).strip()
    except typer.Abort as error:
        raise InvalidOption("E-INIT-ENDED", "init", key=key) from error


def answers(given: list[str]) -> dict[str, str]:
    """Options KEY=VALUE. Raises ConfigError (E-INIT-OPTION)."""
    pairs = [one.partition("=") for one in given]
    for key, sign, _ in pairs:
        if not sign or key not in KEYS:
            raise ConfigError("E-INIT-OPTION", "command line", text=shown(key), known=", ".join(KEYS))
    return {key: value for key, _, value in pairs}


KEYS = (
    *("road", "name", "url", "user", "password", "thumbprint", "serial"),
    *("axes", "travel", "order", "cross", "safe", "laser", "calibrator", "gear", "optics"),
)
