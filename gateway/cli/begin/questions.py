"""Questions of the command line: each has a default and says why it is asked; answers may come beforehand."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import typer

from drivers.errors import ConfigError, catalogue
from drivers.local.names import shown
from gateway.cli.show import echo

Judge = Callable[[str], str]
"""An answer to "" where it will do, else to why not."""


@dataclass(frozen=True, slots=True)
class Asker:
    """Asks on the terminal or from a pipe; ``given`` answers are not asked, with ``silent`` nothing is."""

    given: Mapping[str, str]
    silent: bool

    def ask(self, key: str, code: str, default: str, judge: Judge = lambda _text: "", *, secret: bool = False) -> str:
        """The answer to one question. Raises ConfigError (E-INIT-ANSWER, E-INIT-ENDED)."""
        if key in self.given or self.silent:
            answer = self.given.get(key, default)
            if why := judge(answer):
                raise ConfigError("E-INIT-ANSWER", "init", key=key, answer=shown(answer), why=why)
            return answer
        text = catalogue()[code]
        echo(f"\n{text['what']}", bold=True)
        echo(_indented(text["do"]))
        while True:
            answer = _typed(key, default, secret=secret)
            if not (why := judge(answer)):
                return answer
            echo(f"  {why}", colour="yellow")


def _indented(text: str) -> str:
    """Two columns in, broken between words where a terminal would break anywhere."""
    wide = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    return textwrap.fill(text, wide, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)


def _typed(key: str, default: str, *, secret: bool) -> str:
    hidden = secret and sys.stdin.isatty()
    try:
        return str(typer.prompt(f"  {key}", default=default, hide_input=hidden, show_default=bool(default))).strip()
    except typer.Abort as error:
        raise ConfigError("E-INIT-ENDED", "init", key=key) from error


def answers(given: list[str]) -> dict[str, str]:
    """Options KEY=VALUE. Raises ConfigError (E-INIT-OPTION)."""
    pairs = [one.partition("=") for one in given]
    for key, sign, _ in pairs:
        if not sign or key not in KEYS:
            raise ConfigError("E-INIT-OPTION", "command line", text=shown(key), known=", ".join(KEYS))
    return {key: value for key, _, value in pairs}


KEYS = (
    *("road", "name", "url", "user", "password", "thumbprint", "serial"),
    *("axes", "travel", "laser", "calibrator", "gear", "optics"),
)
