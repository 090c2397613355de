"""Options that a mode of a command cannot use: refused by name before anything is done, never ignored.

Each mode lists what it takes. Whatever else was typed is a wrong option (exit code 2): a person who typed it expects it
to count.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import typer

_FILES = ("files", "kind", "limit", "plot", "column")
_GEOMETRY = (*_FILES, "axis", "unit", "phase", "store", "accept_doubt", "accept", "ask")
_POSITIONING = ("standard", "air", "expansion", "material_degc", "seed", "site", "jobs", "scheduler", "table")
_KINDS: dict[str, tuple[str, ...]] = {
    "straightness": (),
    "angular": ("angle",),
    "squareness": ("plane", "artefact", "senses"),
    "parallelism": ("senses",),
    "six-dof": ("offset",),
    "reversal": (),
    "axis-location": (),
    "rotary-motion": ("motion", "distance"),
    "harmonics": ("order",),
}
TAKEN: dict[str, tuple[str, ...]] = {
    "study --relative": ("gear", "errors", "relative", "plots", "height"),
    "run --plan": ("site", "plan", "axis", "apply"),
    "close --plan": ("site", "plan", "apply"),
    "measure --plan": ("site", "plan"),
    "simulate --list": ("listed",),
    "schema --page": ("as_page",),
    "schema --api": ("api",),
    "schema --states": ("states",),
    "correct --run": ("site", "run"),
    "correct --run with a file of errors": ("site", "run", "error_u", "sense"),
    "guard --axis": ("site", "run", "axis", "limit"),
    "evaluate --standard list": ("standard",),
    "evaluate --kind positioning": (*_GEOMETRY, *_POSITIONING),
    "evaluate --kind transmission": (*_FILES, "pins", "ratio", "rated_torque", "encoder_u"),
    "evaluate --kind ballbar": _FILES,
    "evaluate --kind gear": ("files", "kind", "limit", "plot", "site"),
    **{f"evaluate --kind {name}": (*_GEOMETRY, *own) for name, own in _KINDS.items()},
}
ALWAYS = ("as_json", "_quiet", "_verbose", "help")
_now: ContextVar[Any] = ContextVar("context of the command that runs", default=None)


@contextmanager
def running(context: Any) -> Iterator[None]:
    """In the block this command line is the one that `only` asks."""
    before = _now.set(context)
    try:
        yield
    finally:
        _now.reset(before)


def only(mode: str) -> None:
    """Refuse what was typed and this mode of `TAKEN` cannot use. Raises typer.BadParameter (exit code 2).

    A kind that is none is refused by its own command; a function called without a command line has nothing typed.
    """
    context = _now.get()
    if context is None or mode not in TAKEN:
        return
    words = [spelt for name, spelt in _typed(context) if name not in TAKEN[mode]]
    if words:
        _, _, option = mode.partition(" ")
        raise typer.BadParameter(f"{option} cannot use {', '.join(words)}: leave one of them out", param_hint=words[0])


def _typed(context: Any) -> Iterator[tuple[str, str]]:
    """Names and spellings of the parameters that were typed."""
    for one in context.command.params:
        source = context.get_parameter_source(one.name or "")
        if one.name and one.name not in ALWAYS and source is not None and source.name == "COMMANDLINE":
            yield one.name, next((opt for opt in one.opts if opt.startswith("--")), one.opts[0])
