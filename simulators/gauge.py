"""Displays of gauges as their manuals print them: each answers its question, and what it does not know with an error.

Written from the manuals of Mahr Millimar C1216 (p. 70) and C1202 (p. 82), TESA TT80 (p. 95) and Sylvac (p. 10, 22). The
reading is that of a probe at a true position in mm; resolution, unit and tolerance are those set at the display.
``python -m simulators.gauge --make sylvac`` answers on a pseudo terminal and prints its name.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from drivers.errors import TransportError
from drivers.transport import ByteTransport

Make = Literal["mahr", "mahr-c1202", "tesa", "sylvac"]
MM_PER_INCH = 25.4
FEATURE_OFF, UNKNOWN = 6, 23
READ_BYTES = 256


@dataclass(slots=True)
class GaugeDisplay:
    """One display. ``position_mm`` is asked at each question; ``inch`` its unit; ``step`` in that unit."""

    make: Make
    position_mm: Callable[[], float]
    step: float = 0.001
    inch: bool = False
    feature_on: bool = True
    tolerance_mm: float = 0.1
    silent: bool = False
    noisy: bool = False

    def answer(self, question: str) -> bytes:
        """The bytes of one answer; b"" while it is switched off."""
        if self.silent:
            return b""
        if self.noisy:  # another baud rate at the display
            return b"\x81\xff~\r\n"
        asked = question.strip().upper()
        known = {"mahr": ("?",), "mahr-c1202": ("?", "M1?"), "tesa": ("?",), "sylvac": ("?", "PRI")}[self.make]
        if asked == "UNI?" and self.make in ("tesa", "sylvac"):
            return (b"IN" if self.inch else b"MM") + b"\r\n"
        if asked not in known:
            return f"ERR{UNKNOWN}\r\n".encode()
        if not self.feature_on:
            return f"ERR{FEATURE_OFF}\r\n".encode()
        return self._reading() + b"\r\n"

    def _reading(self) -> bytes:
        value = self.position_mm() / (MM_PER_INCH if self.inch else 1.0)
        shown = round(value / self.step) * self.step + 0.0
        decimals = max(len(f"{self.step:.6f}".rstrip("0").partition(".")[2]), 1)
        unit = "IN" if self.inch else "MM"
        if self.make == "mahr":
            return f"{shown:+.{decimals}f} {unit.lower()}".encode()
        if self.make == "mahr-c1202":
            mark = "=" if abs(self.position_mm()) <= self.tolerance_mm else "<" if shown < 0.0 else ">"
            return f"{shown:+.{decimals}f} {mark}".encode()
        if self.make == "tesa":
            return f"{shown:+09.{decimals}f}".encode()
        # Sylvac: the minus stands next to the digits, a plus is a blank.
        return f"{shown: .{decimals}f}".rjust(10).encode()

    async def converse(self, wire: ByteTransport) -> None:
        """Serve one client until it leaves."""
        rest = b""
        with contextlib.suppress(TransportError):
            while data := await wire.read(READ_BYTES):
                *questions, rest = (rest + data).replace(b"\n", b"\r").split(b"\r")
                for one in filter(None, questions):
                    answer = self.answer(one.decode("ascii", "replace"))
                    if answer:
                        await wire.write(answer)


class PtyGauge:
    """A display on a pseudo terminal, which a serial driver opens by its ``path``. Not on Windows."""

    def __init__(self, display: GaugeDisplay) -> None:
        import pty  # noqa: PLC0415 - there is none on Windows
        import tty  # noqa: PLC0415

        self._display = display
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._rest = b""

    def start(self) -> None:
        """Answer from now on, in the running loop."""
        asyncio.get_running_loop().add_reader(self._master, self._asked)

    def _asked(self) -> None:
        try:
            data = os.read(self._master, READ_BYTES)
        except OSError:
            return
        *questions, self._rest = (self._rest + data).replace(b"\n", b"\r").split(b"\r")
        for one in filter(None, questions):
            os.write(self._master, self._display.answer(one.decode("ascii", "replace")))

    def close(self) -> None:
        """Unplug it."""
        if self._master >= 0:
            asyncio.get_running_loop().remove_reader(self._master)
            os.close(self._master)
            os.close(self._slave)
            self._master = self._slave = -1


async def _serve(display: GaugeDisplay) -> None:
    """Answer on a pseudo terminal until somebody ends it."""
    port = PtyGauge(display)
    port.start()
    sys.stdout.write(f"{port.path}\n")
    sys.stdout.flush()
    try:
        await asyncio.Event().wait()
    finally:
        port.close()


def main(words: list[str] | None = None) -> None:
    """Serve one display; Ctrl-C ends it."""
    parser = argparse.ArgumentParser(prog="python -m simulators.gauge", description="A gauge display on a serial port.")
    parser.add_argument("--make", choices=get_args(Make), default="mahr")
    parser.add_argument("--position-mm", type=float, default=0.0)
    parser.add_argument("--step", type=float, default=0.001, help="resolution, in the unit of the display")
    parser.add_argument("--inch", action="store_true")
    told = parser.parse_args(words)
    display = GaugeDisplay(told.make, lambda: told.position_mm, step=told.step, inch=told.inch)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(display))


if __name__ == "__main__":
    main()
