"""The command `cell`: an operator's console for a simulated machine that runs, over loopback."""

from __future__ import annotations

import json
import socket
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from drivers.errors import ConfigError
from drivers.message import Message
from gateway.cli.show import echo, show_json

ANSWER_S = 120.0
Ask = Any


def stand_at(site: Path, orders: tuple[str, ...], *, as_json: bool) -> None:
    """Do these orders at the cell of a site file, or those that are typed until the input ends.

    Raises ConfigError (E-CLI-NO-CELL, E-CLI-CELL-WORD).
    """
    with _cell(site) as ask:
        if orders:
            for order in orders:
                tell(order, _demanded(order, ask(order)), as_json=as_json)
            return
        echo(Message.of("P-CELL-CONSOLE"))
        tell("status", ask("status"), as_json=False)
        for line in _typed():
            tell(line, ask(line), as_json=as_json)


def tell(order: str, answer: dict[str, Any], *, as_json: bool) -> None:
    """An answer of the cell, as people read it or as data."""
    if as_json:
        show_json(answer)
    elif "error" in answer:
        echo(str(answer["error"]), colour="red")
    elif set(answer) <= {"done", "pressed", "taken"}:
        echo(Message.of("P-CELL-DONE" if all(answer.values()) else "P-CELL-NOTHING", order=order))
    else:
        for line in lines_of(answer):
            echo(line)


def lines_of(answer: dict[str, Any]) -> Iterator[str]:
    """One line for each thing an answer holds."""
    width = max(len(key) for key in answer)
    for key, value in answer.items():
        yield f"{key:<{width}}  {_short(value)}"


def _short(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_short(one)}" for name, one in value.items())
    if isinstance(value, list):
        return ", ".join(str(one) for one in value[-5:]) or "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _demanded(order: str, answer: dict[str, Any]) -> dict[str, Any]:
    if "error" in answer:
        raise ConfigError("E-CLI-CELL-WORD", "cell", order=order, why=answer["error"])
    return answer


def _typed() -> Iterable[str]:
    """Lines of the standard input; an empty one asks how things stand."""
    for line in sys.stdin:
        yield line.strip() or "status"


@contextmanager
def _cell(site: Path) -> Iterator[Ask]:
    """A conversation with the cell that wrote a site file: one line, one answer. Raises ConfigError (E-CLI-NO-CELL)."""
    try:
        place = urlsplit(str(json.loads(site.with_suffix(".cell.json").read_text(encoding="utf-8"))["judge"]))
        wire = socket.create_connection((place.hostname or "", place.port or 0), ANSWER_S)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError("E-CLI-NO-CELL", str(site), why=str(error)) from error
    with wire, wire.makefile("rwb") as lines:

        def ask(order: str) -> dict[str, Any]:
            try:
                lines.write(order.encode("utf-8") + b"\n")
                lines.flush()
                return dict(json.loads(lines.readline()))
            except (OSError, ValueError) as error:
                raise ConfigError("E-CLI-NO-CELL", str(site), why=str(error)) from error

        yield ask
