"""The live panel of a terminal: redrawn in place, the lines that stay above it."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from drivers.local.names import visible
from gateway.cli.screen.scene import Count, Scene, clock_text
from gateway.cli.show import spoken, with_site
from gateway.remaining import RemainingTime

A_SECOND = 4
BAR = 28
TO_GO = len("about 10:00 to go")


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

    def __init__(self, title: str, scene: Scene, now: Callable[[], float], console: PanelConsole | None = None) -> None:
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

    def _rows(self, scene: Scene, now: float) -> list[Any]:
        rows: list[Any] = [_staged(scene.stages, now)] if scene.stages.number else []
        rows += [_bars(scene.counts, scene.stages, now)] if scene.counts else []
        rows += [Text(f"! {visible(with_site(text))}", style="bold red") for text in (scene.open_road,) if text]
        rows += [Text(visible(text)) for text in (scene.step,) if text]
        rows += [_hung("  ", Text(visible(move))) for move in scene.moves]
        if scene.ask:
            waited = clock_text(now - scene.asked)
            rows.append(_hung("> ", Text(visible(with_site(scene.ask)), style="bold yellow")))
            rows.append(Text(f"  waiting for this {waited}", style="yellow"))
        elif scene.within:
            rows.append(Text(visible(scene.within), style="dim"))
        return rows or [Text("working")]


def _hung(mark: str, said: Text) -> Table:
    """A sentence behind its mark, which further lines of it leave free."""
    row = Table.grid()
    row.add_row(Text(mark, style=said.style), said)
    return row


def _staged(stages: RemainingTime, now: float) -> Text:
    """Which stage of how many, and the time to go over all that are left."""
    said = spoken("S-PANEL-STAGE", number=stages.number, total=stages.total, stage=stages.said)
    left = stages.left_s(now)
    told = said if left is None else ", ".join((said, spoken("S-PANEL-LEFT", time=clock_text(left))))
    return Text(visible(told))


def _bars(counts: Mapping[str, Count], stages: RemainingTime, now: float) -> Table:
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
            Text("" if left is None else f"about {clock_text(left)} to go"),
            Text(visible(count.said)),
        )
    return rows
