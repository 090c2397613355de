"""`python -m simulators.cell CELL`: runs a cell until its stdin closes, a stop file appears or Ctrl-C.

A line on stdin, or on the judge's loopback port, is what a person does at the machine (`simulators.cell.console`), or a
question or an order to the judge as JSON.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import functools
import json
import os
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from drivers.clock import HostedTimeLoop, LoopClock
from drivers.errors import TransportError, TrueflankError
from drivers.transport import ByteTransport, serve
from simulators.cell import Cell
from simulators.cell.backdoor import BackDoor
from simulators.cell.console import WORDS, panel_url, parse_order, serve_panel
from simulators.cell.paced_loop import PacedLoop
from simulators.cell.setup_files import write_site_of_files
from simulators.cellfile import limit_sample_rate, list_cells, load_cell, with_site

BLOCK_WALL_S = 0.002
# As fast as kept up, nobody watches blocks come, and each costs all processes a turn. Of this length one block holds
# the settling and averaging of the shipped cells (0.5 s and 1 s): a reading takes two, no longer than with short ones.
KEPT_UP_BLOCK_S = 1.6
# A counter's thousand lines a second are a quarter of all work then, and an average of a second is as good to 2 nm with
# so many.
KEPT_UP_HZ = 250.0
# The wires are loopback and the PC may be busy: a lost answer is a closed socket, never a late one.
PATIENCE_S = 60.0
LOOK_S = 0.2
LINE_BYTES = 1 << 20


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m simulators.cell", description=__doc__)
    parser.add_argument("cell", help="a cell that comes with trueflank (demo, zero) or the path of a cell file")
    parser.add_argument("--list", action="store_true", help="print the cells that come with trueflank and end")
    parser.add_argument("--name", default="", help="what the machine is called in the site file")
    parser.add_argument("--site", type=Path, help="where to write the site file (default: a new folder)")
    parser.add_argument(
        "--speed", type=float, default=1.0, help="machine seconds in one second; 0: as fast as kept up, with --shared"
    )
    parser.add_argument("--shared", action="store_true", help="who opens its site file shares its clock")
    parser.add_argument("--seed", type=int, help="draw another machine of the same kind")
    parser.add_argument("--flip", action="store_true", help="reverse the sign of every error")
    parser.add_argument("--plan", action="store_true", help="name every set-up and the work in the site file")
    parser.add_argument("--filed", action="store_true", help="with --plan: all set-ups come from tables")
    parser.add_argument(
        "--road", choices=("opcua", "modbus", "both", "carried"), default="", help="ways into the control"
    )
    parser.add_argument("--framer", choices=("tcp", "rtu"), help="the PLC speaks Modbus TCP or RTU (socket://)")
    parser.add_argument("--plc-port", help="the PLC's TCP port (default: a free one) or serial port (then RTU)")
    parser.add_argument("--plc-client-url", help="what the site file names instead, e.g. the cable's other end")
    parser.add_argument("--panel", action="store_true", help="serve the machine's panel as a page of this computer")
    parser.add_argument("--stop-file", type=Path, help="end when this file appears")
    parser.add_argument("--ignore-stdin", action="store_true", help="do not end with the parent's pipe")
    options = parser.parse_args(given)
    if options.speed < 0 or not (options.speed or options.shared):
        parser.error("--speed is more than 0; with --shared it may be 0")
    return options


def plc_settings(options: argparse.Namespace) -> dict[str, Any]:
    """What the command line says of the PLC, as keys of [machine.modbus]."""
    settings: dict[str, Any] = {"framer": options.framer} if options.framer else {}
    settings |= {"client_url": options.plc_client_url} if options.plc_client_url else {}
    port = options.plc_port
    if port:
        settings |= {"port": int(port)} if port.isdecimal() else {"port": port, "framer": "rtu"}
    return settings


async def run(options: argparse.Namespace) -> None:
    """Run the cell; one JSON line on stdout when it is ready, then one for each question on stdin."""
    site = (options.site or Path(tempfile.mkdtemp(prefix="trueflank-cell-")) / "site.toml").resolve()
    clock = LoopClock(1.0 if options.shared else options.speed)
    asked = {"plan": True} if options.plan else {}
    asked |= {"name": options.name} if options.name else {}
    file = with_site(load_cell(options.cell), patience_s=PATIENCE_S, **asked)
    cell = Cell(
        file if options.speed else limit_sample_rate(file, KEPT_UP_HZ),
        site.parent,
        clock,
        seed=options.seed,
        flip=options.flip,
        block_s=max(0.1, BLOCK_WALL_S * options.speed) if options.speed else KEPT_UP_BLOCK_S,
        paced=options.shared,
        site_path=site,
        road=options.road,
        modbus=plc_settings(options),
    )
    judge = BackDoor(cell)
    try:
        await cell.start()
        if options.filed:
            write_site_of_files(cell, site)
        door = await serve("tcp://127.0.0.1:0", lambda wire: _visit(judge, wire), LoopClock())
        panel = await serve_panel(cell, functools.partial(answered, judge)) if options.panel else None
        try:
            more = {"panel": panel_url(panel)} if panel else {}
            with _kept_up():
                _tell(_ready(site, door.url, options, site.with_suffix(".cell.json")) | more)
                await _until_told(options, judge)
        finally:
            _remember(cell, site.with_suffix(".judgement.json"))
            await door.close()
            if panel is not None:
                await panel.close()
    finally:
        await cell.stop()


def _kept_up() -> contextlib.AbstractContextManager[None]:
    """The machine is ready: those who share its clock say from now on how fast time goes."""
    loop = asyncio.get_running_loop()
    return loop.keeping_up() if isinstance(loop, HostedTimeLoop) else contextlib.nullcontext()


def _ready(site: Path, judge_url: str, options: argparse.Namespace, copy: Path) -> dict[str, Any]:
    ready = {"site": str(site), "pid": os.getpid(), "judge": judge_url, "speed": options.speed}
    loop = asyncio.get_running_loop()
    ready |= {"clock": loop.address} if isinstance(loop, HostedTimeLoop) else {}
    copy.write_text(json.dumps(ready) + "\n", encoding="utf-8")
    return ready


def _tell(answer: dict[str, Any]) -> None:
    # The parent may be gone already; its closed stdin will end us, not this line.
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


def _remember(cell: Cell, path: Path) -> None:
    """What the truth says of each axis at the end, for those who come too late to ask."""
    names = [axis.name for axis in cell.file.axes if axis.measure is not None]
    figures = {name: {"raw": cell.figures(name, live=False), "live": cell.figures(name, live=True)} for name in names}
    with contextlib.suppress(OSError):
        path.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


async def _until_told(options: argparse.Namespace, judge: BackDoor) -> None:
    lines: asyncio.Queue[bytes | None] = asyncio.Queue()
    if not options.ignore_stdin:
        _listen_stdin(asyncio.get_running_loop(), lines.put_nowait)
    over = threading.Event()
    if options.stop_file:
        _watch(options.stop_file, asyncio.get_running_loop(), lines.put_nowait, over)
    try:
        await _answer_all(lines, judge)
    finally:
        over.set()


async def _answer_all(lines: asyncio.Queue[bytes | None], judge: BackDoor) -> None:
    while (line := await lines.get()) is not None:
        if line.strip():
            _tell(await answered(judge, line))


async def answered(judge: BackDoor, line: bytes) -> dict[str, Any]:
    """What a line says: a key, an order, or a question; {"error": ...} when it is none of them."""
    typed = line.decode("utf-8", "replace").strip()
    order = parse_order(typed)
    if order is not None:
        pressed = {"pressed": order["key"]} if order.get("set") == "press" else {}
        return {**await judge.answer(order), **pressed}
    if not typed.startswith("{"):
        unknown = {} if typed.lower() == "help" else {"error": f"{typed[:40]!r} is none of: {', '.join(WORDS)}"}
        return unknown or dict(WORDS)
    try:
        question = json.loads(line)
    except ValueError as error:
        return {"error": f"not JSON: {error}"}
    return await judge.answer(question)


def _listen_stdin(loop: asyncio.AbstractEventLoop, put: Callable[[bytes | None], None]) -> None:
    """Read stdin in a thread of its own: pipes cannot be awaited on every system; None at its end."""

    def listen() -> None:
        pending = b""
        with contextlib.suppress(OSError, RuntimeError):
            while data := os.read(sys.stdin.fileno(), 65536):
                *lines, pending = (pending + data).split(b"\n")
                for line in lines:
                    loop.call_soon_threadsafe(put, line)
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(put, None)

    threading.Thread(target=listen, daemon=True, name="stdin").start()


def _watch(
    file: Path, loop: asyncio.AbstractEventLoop, put: Callable[[bytes | None], None], over: threading.Event
) -> None:
    """Look for the stop file in a thread of its own, by the wall's clock: the machine's may stand still."""

    def look() -> None:
        while not file.exists():
            if over.wait(LOOK_S):
                return
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(put, None)

    threading.Thread(target=look, daemon=True, name="stop file").start()


async def _visit(judge: BackDoor, wire: ByteTransport) -> None:
    """One judge on the loopback port: a JSON object a line, an answer a line."""
    pending = b""
    while True:
        *lines, pending = (pending + await wire.read(65536)).split(b"\n")
        if len(pending) > LINE_BYTES:
            raise TransportError("E-LINK-CLOSED", "judge", why="an endless line")
        for line in lines:
            await wire.write(json.dumps(await answered(judge, line)).encode() + b"\n")


def main() -> int:
    """Entry point: 0 when told to end, the error's own exit code otherwise."""
    options = arguments()
    if options.list:
        _tell(list_cells())
        return 0
    try:
        shared = functools.partial(HostedTimeLoop, options.speed or None)
        with asyncio.Runner(loop_factory=shared if options.shared else PacedLoop) as runner:
            runner.run(run(options))
    except KeyboardInterrupt:
        return 0
    except TrueflankError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
