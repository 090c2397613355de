"""`run --plan` and `close --plan`: the day as a table, what it asks of a person, and its hours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drivers.errors import words
from drivers.message import Message, fixed
from drivers.terms import spoken
from gateway.cli.onward import next_step
from gateway.cli.options import load_site, with_control
from gateway.cli.show import say_line, show_json, show_table


def show_day_of_run(site: Path, axes: Sequence[str], *, apply: bool, as_json: bool) -> None:
    """The day of `run`. Raises as `day_of_run`."""
    from gateway.config import typed_rotary
    from gateway.workflow.forecast import day_of_run

    tree = load_site(site)
    with_control(tree)
    if not as_json:
        for name in typed_rotary(tree):
            if not axes or name in axes:
                say_line(f"W-CFG-TYPED-ROTARY: {name}: {words('W-CFG-TYPED-ROTARY')}", 2)
    named = "".join(f" --axis {name}" for name in axes)
    _show(day_of_run(tree, apply=apply, axes=axes), f"run {site}{named}", apply=apply, as_json=as_json)


def show_day_of_closing(site: Path, *, apply: bool, as_json: bool) -> None:
    """The day of `close`. Raises as `day_of_closing`."""
    from gateway.workflow.forecast import day_of_closing

    tree = load_site(site)
    with_control(tree)
    _show(day_of_closing(tree, site, apply=apply), f"close {site}", apply=apply, as_json=as_json)


def _show(day: Any, command: str, *, apply: bool, as_json: bool) -> None:
    if as_json:
        show_json(day.as_data())
        return
    terms = spoken()
    headings = ("work", "of", "optics and place", terms.start, terms.restart, "min")
    show_table(
        words("S-DAY-TITLE", command=day.command, site=day.site), headings, [_row(day, one) for one in day.pieces]
    )
    counts = {"mountings": len(day.mountings), "blanks": day.blanks}
    counts |= {"presses": len(day.presses), "resets": len(day.resets)}
    say_line(Message.of("S-DAY-COUNTS", **counts), 2)
    stages = ", ".join(f"{stage} {hours:.1f} h" for stage, hours in day.by_stage().items())
    say_line(Message.of("S-DAY-HOURS", hours=fixed(day.hours, 1), stages=stages, extra=fixed(day.most_extra_h, 1)), 2)
    if day.unprotected:
        say_line(Message.of("P-UNPROTECTED", road=day.unprotected), 2)
    say_line(Message.of("S-DAY-SUPPOSES" if apply else "S-DAY-NO-APPLY"), 2)
    next_step(command + (" --apply --machine NAME" if apply else ""))


def _row(day: Any, piece: Any) -> tuple[str, ...]:
    place = piece.mounting.words if piece.mounting is not None else "blank" if piece.clampings else ""
    asked = (str(len(asks) or "") for asks in (piece.asks.presses, piece.asks.resets))
    return piece.stage, piece.name, place, *asked, f"{piece.seconds(day.times) / 60.0:.0f}"
