"""The event loop of a command: its clock, and the signals that ask for one stop."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
import threading
import tomllib
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

from drivers.clock import JoinedTimeLoop, LoopClock
from drivers.errors import words
from drivers.offline_exchange import ToCarry
from gateway.cli.output import echo
from gateway.errors import CarryFirst
from gateway.stopping import INTERRUPTED, LONGEST_S, TERMINATED, StopAsked, obey


def loop_factory(site: Path | None) -> Callable[[], asyncio.AbstractEventLoop] | None:
    """What makes the loop for work at a site; None for the system's own, which every real machine gets.

    A site file that says it is simulated, and beside which a running cell keeps a clock, is worked at by that clock:
    no deadline then depends on how fast this computer is.
    """
    address = None if site is None else _shared_clock_address(site)
    if address is None:
        return None

    def joined() -> asyncio.AbstractEventLoop:
        try:
            return JoinedTimeLoop(address, name="trueflank")
        except (OSError, EOFError):  # that cell has ended; whoever opens its devices is told
            return asyncio.new_event_loop()

    return joined


def _shared_clock_address(site: Path) -> str | None:
    try:
        told = tomllib.loads(site.read_text(encoding="utf-8"))
        if told["site"]["simulated"] is not True:
            return None
        return str(json.loads(site.with_suffix(".cell.json").read_text(encoding="utf-8"))["clock"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


# ---- signals: SIGTERM, Ctrl-C, a hung-up terminal, a closed console and a service stop ask for one stop

T = TypeVar("T")
Ask = Callable[[str, int], None]

# Those a system does not have are left out: on Windows a console sends SIGINT and SIGBREAK, elsewhere SIGHUP hangs up.
SIGNALS = {"SIGINT": INTERRUPTED, "SIGTERM": TERMINATED, "SIGHUP": TERMINATED, "SIGBREAK": TERMINATED}


def run_to_end(
    work: Coroutine[Any, Any, T], *, at: Path | None = None, stop: StopAsked | None = None, ends_itself: bool = False
) -> T:
    """Run a command's work in a loop of its own; a stop asked for by the system ends it in order.

    ``at`` is the site file of the machine that it opens: a simulated one keeps the clock of both. ``ends_itself``: the
    work heeds ``stop`` without being cancelled. Raises Stopped, else what the work raises.
    """
    asked = stop or StopAsked()

    async def main() -> T:
        with listen_for_stop(asyncio.get_running_loop(), asked):
            return await obey(work, asked, LoopClock(), ends_itself=ends_itself)

    with asyncio.Runner(loop_factory=loop_factory(at)) as runner:
        try:
            return runner.run(main())
        except ToCarry as out:
            code, place = ("E-OFF-BACK", out.back) if out.why else ("E-OFF-CARRY", out.folder)
            told: dict[str, Any] = {"folder": str(out.folder), "back": str(out.back), "why": out.why}
            raise CarryFirst(code, str(place), program=out.program, **told) from None


@contextmanager
def listen_for_stop(loop: asyncio.AbstractEventLoop, stop: StopAsked) -> Iterator[None]:
    """While the block lasts signals ask for the stop, from whatever thread they come; afterwards they are as before."""

    def ask(by: str, exit_code: int) -> None:
        loop.call_soon_threadsafe(_request_stop, stop, by, exit_code)

    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's business
        return
    before = {name: _install_handler(name, code, ask) for name, code in SIGNALS.items() if hasattr(signal, name)}
    over = threading.Event()
    try:
        with console_close(ask, over):
            yield
    finally:
        over.set()
        for name, handler in before.items():
            # None: somebody else than Python had set it, and Python cannot set it again.
            signal.signal(getattr(signal, name), signal.SIG_DFL if handler is None else handler)


def _request_stop(stop: StopAsked, by: str, exit_code: int) -> None:
    first = stop.ask(by, exit_code)
    told = words("P-STOPPING", by=by, most_s=LONGEST_S) if first else words("P-STOPPING-STILL", most_s=LONGEST_S)
    echo(told, err=True)


def _install_handler(name: str, exit_code: int, ask: Ask) -> Any:
    def handler(_number: int, _frame: FrameType | None) -> None:
        ask("Ctrl-C" if name == "SIGINT" else name, exit_code)

    number = getattr(signal, name)
    if signal.getsignal(number) is signal.SIG_IGN:
        return signal.SIG_IGN  # nohup, or a shell's background job: whoever started us does not want it heard
    return signal.signal(number, handler)


if sys.platform == "win32":
    import ctypes

    # Close button, log-off, shutdown: the process ends once the handler returns, or when the system's patience does.
    _EVENTS = {2: "a closed console", 5: "a log-off", 6: words("S-STOP-SHUTDOWN")}

    @contextmanager
    def console_close(ask: Ask, over: threading.Event) -> Iterator[None]:
        """A console that is closed asks for the stop too, and is kept waiting as long as the system allows."""

        @ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_uint)
        def handler(event: int) -> int:
            if event not in _EVENTS:
                return 0
            ask(_EVENTS[event], TERMINATED)
            over.wait(LONGEST_S)
            return 1

        ctypes.windll.kernel32.SetConsoleCtrlHandler(handler, 1)
        try:
            yield
        finally:
            ctypes.windll.kernel32.SetConsoleCtrlHandler(handler, 0)
else:

    @contextmanager
    def console_close(_ask: Ask, _over: threading.Event) -> Iterator[None]:
        """Here a closed terminal is SIGHUP."""
        yield
