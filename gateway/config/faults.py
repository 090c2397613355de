"""One thing that is wrong in a site file, said with its place, and all of them as one exception."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.errors import ConfigError
from gateway.config.places import Path, held

_NAMED = {"axes": "axis", "instruments": "instrument"}
_TITLED = {"equipment": ("equipment", "name"), "tolerances": ("tolerance of", "axis")}


@dataclass(frozen=True, slots=True)
class Fault:
    """``path`` leads to the key in the tree; ``code`` and ``fields`` are of the catalogue.

    ``line`` and ``column`` count from 1, 0 where there is no place. ``on_key``: the key itself is wrong, not its
    value. ``doubt``: worth a look, no reason to refuse the file.
    ``later``: a driver or a command refuses it by itself when its turn comes; others can use the file before.
    """

    path: Path
    code: str
    fields: dict[str, Any] = field(default_factory=dict)
    line: int = 0
    column: int = 0
    on_key: bool = False
    doubt: bool = False
    later: bool = False

    def error(self, file: str) -> ConfigError:
        """As an exception at FILE:LINE:COLUMN."""
        where = f"{file}:{self.line}:{self.column}" if self.line else file
        return ConfigError(self.code, where, **self.fields)

    def as_record(self, file: str) -> dict[str, object]:
        """As data."""
        place = {"line": self.line or None, "column": self.column or None}
        return {"file": file, **place, "doubt": self.doubt, **self.error(file).as_record()}


class SiteFaults(ConfigError):
    """A site file with faults: code and fields are those of the first, ``causes`` holds every one."""

    def __init__(self, file: str, faults: Sequence[Fault]) -> None:
        errors = [fault.error(file) for fault in faults]
        super().__init__(errors[0].code, errors[0].where, **faults[0].fields)
        self.faults = tuple(faults)
        self.causes = tuple((str(number), error) for number, error in enumerate(errors, start=1))

    def __str__(self) -> str:
        return "\n".join(str(error) for _, error in self.causes)


def called(tree: Any, path: Path) -> str:
    """A place in people's words: "axis X1: measure.feed", "controller.settings.r_first"."""
    if not path:
        return "(file)"
    rest = ".".join(map(str, path[2:]))
    if path[0] in _NAMED and len(path) > 1:
        name = held(tree, (*path[:2], "name"))
        who = f"{_NAMED[str(path[0])]} {name if isinstance(name, str) and name else f'number {int(path[1]) + 1}'}"
    elif path[0] in _TITLED and len(path) > 1:
        what, key = _TITLED[str(path[0])]
        name = held(tree, (*path[:2], key))
        who = f"{what} {name if isinstance(name, str) and name else f'number {int(path[1]) + 1}'}"
    elif path[0] == "setups" and len(path) > 1:
        one = {key: held(tree, (*path[:2], key)) for key in ("component", "axis")}
        who = f"set-up {one['component'] or '?'} on {one['axis'] or '?'}"
    else:
        return ".".join(map(str, path))
    return f"{who}: {rest}" if rest else who
