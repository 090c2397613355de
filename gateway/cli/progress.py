"""Progress for the reader: a live panel in a terminal, plain lines in a pipe, and always the log."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from drivers.clock import Clock, LoopClock
from drivers.errors import TrueflankError
from drivers.local.names import visible
from drivers.message import Message
from gateway.audience import Audience, kind_of
from gateway.cli import output
from gateway.cli.output import Voice, echo, remember_site, text_of, with_site
from gateway.cli.progress_state import ProgressCount, ProgressState, clock_text
from gateway.events import DevicesOpened, RunStarted, received
from gateway.remaining import RemainingTime
from gateway.say import Say

AUDIENCES_BY_VOICE = {
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

        remember_site({"site": site_path_of(folder)})
    clock = LoopClock()
    title, run = _progress_title(at, folder), "" if folder is None else str(folder.run_id)
    log = _open_log(at, folder, clock)
    kinds = (
        set()
        if quiet
        else AUDIENCES_BY_VOICE[output.chosen_voice()] - (OPERATORS if _is_brief(own_operator) else set())
    )

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
        with _progress_display(title, clock, kinds, quiet=quiet, stages=stages) as show:

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


def _progress_title(at: tuple[Any, Path] | None, folder: Any) -> str:
    if at is not None:
        return f"trueflank: {at[0].site.name}"
    return "trueflank" if folder is None else f"trueflank: {folder.facts['site']}"


def _open_log(at: tuple[Any, Path] | None, folder: Any, clock: Clock) -> Any:
    """The log of their store; what keeps it is loaded when it is needed."""
    from gateway.store.log_book import LogBook

    if folder is not None:
        return LogBook(folder.path.parent, clock.utc)
    if at is None:
        return None
    from gateway.workflow.run.folder import store_of

    return LogBook(store_of(*at).root, clock.utc)


def _is_brief(own_operator: bool) -> bool:
    return own_operator and output.chosen_voice() is not Voice.VERBOSE


@contextmanager
def _progress_display(
    title: str, clock: Clock, kinds: set[Audience], *, quiet: bool, stages: RemainingTime | None
) -> Iterator[Callable[[str, dict[str, object]], None]]:

    def now() -> float:
        """The panel is drawn outside the loop, so it goes by the wall's clock."""
        return clock.utc().timestamp()

    if quiet or not sys.stderr.isatty():

        def line(code: str, fields: dict[str, object]) -> None:
            if stages is not None:
                stages.told(code, fields, now())
            if kind_of(code) in kinds:
                echo(Message.of(code, **fields), err=True)

        yield line
        return

    with LivePanel(title, ProgressState(now(), stages=stages or RemainingTime()), now) as panel:

        def show(code: str, fields: dict[str, object]) -> None:
            kind = kind_of(code)
            panel.told(code, fields)
            if kind in kinds - IN_PANEL:
                panel.keep(text_of(code, **fields), loud=kind is Audience.LOUD)

        yield show


# ---- the live panel of a terminal: redrawn in place, below the lines that stay

A_SECOND = 4
BAR = 28
TO_GO = len(text_of("S-PROGRESS-TO-GO", left="10:00"))


class PanelConsole(Console):
    """A console on which one thread prints at a time.

    A live display goes up by the height it had when a print began. A second thread's print in between changes that
    height, and the lines above the panel are gone.
    """

    turn: AbstractContextManager[object] = nullcontext()

    def print(self, *objects: Any, **how: Any) -> None:
        """Print as rich does, after whoever prints now."""
        with self.turn:
            super().print(*objects, **how)


class _Live(Live):
    """Rich's live display; every print on its console waits for its own turn to be over."""

    def __init__(self, console: PanelConsole, drawn: Callable[[], Panel]) -> None:
        super().__init__(console=console, get_renderable=drawn, refresh_per_second=A_SECOND, transient=True)
        console.turn = self._lock


@contextmanager
def _no_carets() -> Iterator[None]:
    """While the block lasts the terminal echoes no ^C: it would go to the next line, and the panel not be erased."""
    if sys.platform == "win32" or not sys.stdin.isatty():
        yield
        return
    import termios

    def set_to(flags: int) -> None:
        now = termios.tcgetattr(sys.stdin)
        termios.tcsetattr(sys.stdin, termios.TCSANOW, [*now[:3], flags, *now[4:]])

    before = termios.tcgetattr(sys.stdin)[3]
    set_to(before & ~termios.ECHOCTL)
    try:
        yield
    finally:
        set_to(before)


class LivePanel:
    """A `Scene` on the terminal; it is drawn from a thread of its own, so its clocks run while a command waits."""

    def __init__(
        self, title: str, scene: ProgressState, now: Callable[[], float], console: PanelConsole | None = None
    ) -> None:
        self._title, self._scene, self._now = title, scene, now
        self._lock = threading.Lock()
        self._console = console or PanelConsole(stderr=True, highlight=False)
        self._live = _Live(self._console, self.drawn)

    def __enter__(self) -> LivePanel:
        with ExitStack() as entered:
            entered.enter_context(_no_carets())
            entered.enter_context(self._live)
            self._entered = entered.pop_all()
        return self

    def __exit__(self, *left: Any) -> None:
        self._entered.__exit__(*left)

    def keep(self, line: str, *, loud: bool = False) -> None:
        """A line that stays above the panel."""
        self._console.print(Text(visible(with_site(line)), style="bold red" if loud else ""))

    def told(self, code: str, fields: dict[str, object]) -> None:
        """Take one piece of progress."""
        with self._lock:
            self._scene.told(code, fields, self._now())

    def refresh(self) -> None:
        """Draw it now."""
        self._live.refresh()

    def drawn(self) -> Panel:
        """The panel as it is now."""
        with self._lock:
            rows = self._rows(self._scene, self._now())
            title = f"{self._title}  {clock_text(self._now() - self._scene.began)}"
        return Panel(Group(*rows), title=Text(visible(title)), title_align="left", border_style="dim")

    def _rows(self, scene: ProgressState, now: float) -> list[Any]:
        rows: list[Any] = [_stage_row(scene.stages, now)] if scene.stages.number else []
        rows += [_count_rows(scene.counts, scene.stages, now)] if scene.counts else []
        rows += [Text(f"! {visible(with_site(text))}", style="bold red") for text in (scene.open_road,) if text]
        rows += [Text(visible(text)) for text in (scene.step,) if text]
        rows += [_marked_row("  ", Text(visible(move))) for move in scene.moves]
        if scene.ask:
            waited = clock_text(now - scene.asked)
            rows.append(_marked_row("> ", Text(visible(with_site(scene.ask)), style="bold yellow")))
            rows.append(Text(text_of("S-PROGRESS-WAITING", waited=waited), style="yellow"))
        elif scene.within:
            rows.append(Text(visible(scene.within), style="dim"))
        return rows or [Text("working")]


def _marked_row(mark: str, said: Text) -> Table:
    """A sentence behind its mark, which further lines of it leave free."""
    row = Table.grid()
    row.add_row(Text(mark, style=said.style), said)
    return row


def _stage_row(stages: RemainingTime, now: float) -> Text:
    """Which stage of how many, and the time to go over all that are left."""
    said = text_of("S-PANEL-STAGE", number=stages.number, total=stages.total, stage=stages.said)
    left = stages.left_s(now)
    told = said if left is None else ", ".join((said, text_of("S-PANEL-LEFT", time=clock_text(left))))
    return Text(visible(told))


def _count_rows(counts: Mapping[str, ProgressCount], stages: RemainingTime, now: float) -> Table:
    """One line for each count: how far, of what; the time to go where no stages tell it for all of them."""
    alone = not stages.pieces
    rows = Table.grid(padding=(0, 1))
    rows.add_column(width=BAR)
    rows.add_column(min_width=TO_GO if alone else 0, no_wrap=True)
    rows.add_column(overflow="ellipsis", no_wrap=True)
    for name, count in counts.items():
        stops = stages.program_left_s(now) if name == "inner" else None
        left = (count.left_s(now) if stops is None else stops) if alone else None
        rows.add_row(
            ProgressBar(total=count.total, completed=count.done, width=BAR),
            Text("" if left is None else text_of("S-PROGRESS-TO-GO", left=clock_text(left))),
            Text(visible(count.said)),
        )
    return rows
