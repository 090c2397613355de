"""The command `explain`: what a code says, how it comes about and how to get out of it."""

from __future__ import annotations

import difflib
from typing import Annotated

import typer

from drivers.errors import ConfigError, catalogue, explained, words
from gateway.cli.options import JsonOption
from gateway.cli.show import echo, show_json

CodeArgument = Annotated[str, typer.Argument(help="A code as it is printed, such as E-INT-WARMTH.", show_default=False)]
PARTS = {"what": "it says", "do": "what to do", "how": "how it comes about", "out": "how to get out of it"}


def explain_command(code: CodeArgument, as_json: JsonOption = False) -> None:
    """Say what a code means, how it comes about and how to get out of it."""
    found = explanation(code.strip().upper())
    if as_json:
        show_json(found)
        return
    echo(found["code"], bold=True)
    for part, title in PARTS.items():
        if found.get(part):
            echo(f"{title}: {found[part]}")


def explanation(code: str) -> dict[str, str]:
    """``code`` with its texts: what, do and, for what people meet most, how and out.

    Raises ConfigError (E-CLI-CODE) with the codes that are spelt most alike.
    """
    known = catalogue()
    if code not in known:
        near = difflib.get_close_matches(code, known, n=3, cutoff=0.6)
        raise ConfigError("E-CLI-CODE", "command line", given=code, near=", ".join(near) or "none is spelt like it")
    return {"code": code, "what": words(code), "do": words(code, "do"), **explained(code)}
