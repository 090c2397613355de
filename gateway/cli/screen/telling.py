"""Progress to whoever looks: the panel of a terminal or the plain lines of a pipe, and always to the log."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drivers.clock import Clock, LoopClock
from drivers.errors import TrueflankError
from drivers.message import Message
from gateway.audience import Audience, kind_of
from gateway.cli import voice
from gateway.cli.screen.scene import Scene
from gateway.cli.show import begun_with, echo, spoken
from gateway.cli.voice import Voice
from gateway.events import DevicesOpened, RunStarted, received
from gateway.remaining import RemainingTime
from gateway.say import Say

SPOKEN = {
    Voice.QUIET: {Audience.LOUD, Audience.ASK, Audience.MOVE},
    Voice.PLAIN: {Audience.LOUD, Audience.ASK, Audience.MOVE, Audience.RESULT, Audience.STEP},
    Voice.VERBOSE: set(Audience),
}
LEVELS = {Audience.LOUD: "WARNING", Audience.DETAIL: "DEBUG", Audience.COUNT: "DEBUG"}
# What a terminal shows in its panel stays there; what the operator of a shipped cell does by himself asks nobody.
OPERATORS = {Audience.ASK, Audience.STEP, Audience.MOVE}
IN_PANEL = {*OPERATORS, Audience.COUNT}


@contextmanager
def progress(
    *,
    quiet: bool,
    at: tuple[Any, Path] | None = None,
    folder: Any = None,
    own_operator: bool = False,
    stages: RemainingTime | None = None,
) -> Iterator[Say]:
    """Show progress while the block lasts; with ``quiet`` (data was asked for) the log alone hears it.

    ``at`` is a site and its file, ``folder`` a run's: their store keeps the log. With ``own_operator`` nobody here is
    asked to press anything. ``stages`` are those of the whole command: the time to go is reckoned over them. An error
    that leaves the block is kept in the log.
    """
    if folder is not None:
        from gateway.workflow.run.folder import site_path_of

        begun_with({"site": site_path_of(folder)})
    clock = LoopClock()
    title, run = _title(at, folder), "" if folder is None else str(folder.run_id)
    log = _log(at, folder, clock)
    kinds = set() if quiet else SPOKEN[voice.now()] - (OPERATORS if _brief(own_operator) else set())

    def kept(code: str, fields: dict[str, object]) -> None:
        nonlocal run
        event = received(code, fields)
        if isinstance(event, RunStarted):
            run = event.run_id
        elif isinstance(event, DevicesOpened):
            run = run or event.run
        if log is not None:
            log.add(LEVELS.get(kind_of(code), "INFO"), code, fields, run=run)

    try:
        with _shown(title, clock, kinds, quiet=quiet, stages=stages) as show:

            def say(code: str, /, **fields: object) -> None:
                kept(code, fields)
                show(code, fields)

            yield say
    except TrueflankError as error:
        if log is not None:
            log.add("ERROR", error.code, error.fields, run=run, where=error.where)
        raise
    finally:
        if log is not None and log.problem:
            echo(Message.of("W-LOG-NOT-KEPT", file=str(log.path), why=log.problem), err=True)


def _title(at: tuple[Any, Path] | None, folder: Any) -> str:
    if at is not None:
        return f"trueflank: {at[0].site.name}"
    return "trueflank" if folder is None else f"trueflank: {folder.facts['site']}"


def _log(at: tuple[Any, Path] | None, folder: Any, clock: Clock) -> Any:
    """The log of their store; what keeps it is loaded when it is needed."""
    from gateway.store.log_book import LogBook

    if folder is not None:
        return LogBook(folder.path.parent, clock.utc)
    if at is None:
        return None
    from gateway.workflow.run.folder import store_of

    return LogBook(store_of(*at).root, clock.utc)


def _brief(own_operator: bool) -> bool:
    return own_operator and voice.now() is not Voice.VERBOSE


@contextmanager
def _shown(
    title: str, clock: Clock, kinds: set[Audience], *, quiet: bool, stages: RemainingTime | None
) -> Iterator[Callable[[str, dict[str, object]], None]]:

    def now() -> float:
        """The panel is drawn outside the loop, so it goes by the wall's clock."""
        return clock.utc().timestamp()

    if quiet or not sys.stderr.isatty():

        def line(code: str, fields: dict[str, object]) -> None:
            if stages is not None:
                stages.told(code, fields, now())
            _line(code, fields, kinds)

        yield line
        return
    from gateway.cli.screen.panel import LivePanel

    with LivePanel(title, Scene(now(), stages=stages or RemainingTime()), now) as panel:

        def show(code: str, fields: dict[str, object]) -> None:
            kind = kind_of(code)
            panel.told(code, fields)
            if kind in kinds - IN_PANEL:
                panel.keep(spoken(code, **fields), loud=kind is Audience.LOUD)

        yield show


def _line(code: str, fields: dict[str, object], kinds: set[Audience]) -> None:
    if kind_of(code) in kinds:
        echo(Message.of(code, **fields), err=True)
