"""A bridge for an instrument whose maker gives a programming kit: speak docs/instrument-bridge.md, call the kit.

Copy this file, write your kit's calls into `YourKit` (and nowhere else), start it beside the instrument:

    python shim.py --port 9311

It needs Python 3.9 or later and nothing else. It serves one client at a time, on this computer alone.
"""

from __future__ import annotations

import argparse
import json
import math
import socket
import struct
import sys
import threading
import time
import zlib

BLOCKS_PER_SECOND = 20
LONGEST_LINE = 1 << 20
METHOD_NOT_FOUND, INVALID_PARAMS, PARSE_ERROR = -32601, -32602, -32700
BUSY, BEAM_OBSTRUCTED, NOT_REFERENCED, UNSUPPORTED, BATTERY_LOW, UNSTABLE = range(-32001, -32007, -1)


class Refused(Exception):
    """Raise this where the instrument cannot do what is asked: a code of the page and a sentence for the operator."""

    def __init__(self, code: int, sentence: str) -> None:
        super().__init__(sentence)
        self.code = code


# ======================================================================================================================
# YOUR KIT'S CALLS GO HERE. What is written now is a pretended laser that stands still, so that you can try the line.
# ======================================================================================================================
class YourKit:
    """One instrument. Calls come from one thread at a time."""

    KIND = "laser"
    CHANNELS = ("displacement_mm",)
    RATE_HZ = 1000.0
    COMPENSATED_FOR = "nothing"  # or "air", "air+material": what is already in the lengths
    NOTICES = ("bridge skeleton: these readings are pretended",)

    def open(self) -> dict[str, str]:
        """Connect; who is there. The serial number is what trueflank knows the instrument by."""
        return {"maker": "Example", "model": "L-1", "serial": "0001", "firmware": "1.0"}

    def close(self) -> None:
        """Let go."""

    def start(self) -> None:
        """Begin to sample. Raise Refused(NOT_REFERENCED, ...) or Refused(BATTERY_LOW, ...) where it cannot."""
        self._taken = 0
        self._began = time.monotonic()

    def stop(self) -> None:
        """Sample no more."""

    def read(self) -> tuple[list[tuple[float, ...]], float, bool, int, list[tuple[str, float]]]:
        """Samples since the last call: (rows of channel values, time of the first in s, valid, lost before, events).

        Times are the instrument's own. ``valid`` False from a lost beam until the next datum, for all rows returned:
        return earlier where it changes. ``lost``: how many the kit or the instrument skipped. Events as on the page:
        ("beam_obstructed", at_s). Never repeat or make up a sample.
        """
        due = int((time.monotonic() - self._began) * self.RATE_HZ) - self._taken
        first = self._taken / self.RATE_HZ
        self._taken += due
        return [(0.0,)] * due, first, True, 0, []

    def datum(self) -> None:
        """The present reading is good again. Raise Refused(BEAM_OBSTRUCTED, ...) while there is no light."""

    def environment(self) -> dict[str, object]:
        """None where there is no sensor, never an assumed value; Refused(UNSUPPORTED, ...) where there are none."""
        raise Refused(UNSUPPORTED, "no sensors")

    def optics(self) -> str:
        """linear, angular, straightness, rotary or unknown."""
        return "unknown"


# ======================================================================================================================
# Nothing below needs to be changed.
# ======================================================================================================================
HEADER = struct.Struct("<4sBBHQIIddI")
MOST_VALUES = (1 << 20) // 8


def frame(sequence: int, t0_s: float, dt_s: float, rows: list[tuple[float, ...]], valid: bool, lost: int) -> bytes:
    """A binary frame of section 5; rows must not be empty."""
    flat = [value for row in rows for value in row]
    payload = struct.pack(f"<{len(flat)}d", *flat)
    flags = 0 if valid else 1
    crc = zlib.crc32(payload)
    head = HEADER.pack(b"\xfaTFS", 1, flags, len(rows[0]), sequence, len(rows), lost, t0_s, dt_s, crc)
    return head + struct.pack("<I", zlib.crc32(head)) + payload


def line(message: dict[str, object]) -> bytes:
    """A JSON line; NaN and Infinity are refused."""
    return json.dumps({"jsonrpc": "2.0", **message}, allow_nan=False, separators=(",", ":")).encode("utf-8") + b"\n"


class Conversation:
    """One client from its first line to its last."""

    def __init__(self, kit: YourKit, who: dict[str, str], peer: socket.socket) -> None:
        self.kit, self.who, self.peer = kit, who, peer
        self.lock = threading.RLock()  # the kit and the line belong to one thread at a time
        self.running = threading.Event()
        self.ended = threading.Event()
        self.binary = False
        self.sequence = 0

    def serve(self) -> None:
        """Answer until the client leaves."""
        sampler = threading.Thread(target=self.sample, daemon=True)
        sampler.start()
        try:
            for raw in self.lines():
                answer = self.answered(raw)
                with self.lock:
                    self.peer.sendall(line(answer))
        except OSError:
            pass
        finally:
            self.ended.set()
            sampler.join()
            if self.running.is_set():
                self.kit.stop()

    def lines(self):
        """The client's lines; one that is longer than any may be ends the conversation."""
        with self.peer.makefile("rb") as stream:
            while True:
                raw = stream.readline(LONGEST_LINE)
                if not raw.endswith(b"\n"):
                    return
                if raw.strip():
                    yield raw

    def answered(self, raw: bytes) -> dict[str, object]:
        """One answer to one question, with its id."""
        number = None
        try:
            asked = json.loads(raw)
            number, method, params = asked["id"], asked["method"], asked.get("params", {})
            with self.lock:
                return {"id": number, "result": self.do(method, params)}
        except Refused as refused:
            return {"id": number, "error": {"code": refused.code, "message": str(refused)}}
        except (ValueError, KeyError, TypeError) as error:
            return {"id": number, "error": {"code": PARSE_ERROR, "message": str(error)}}

    def do(self, method: str, params: dict[str, object]) -> object:
        """What the page says to each method."""
        if method == "bridge.identify":
            return self.identity()
        if method == "stream.start":
            return self.start(params)
        if method == "stream.stop":
            return self.stop()
        if method == "stream.datum":
            return self.kit.datum() or {}
        if method == "environment.read":
            return self.kit.environment()
        if method == "optics.read":
            return {"kind": self.kit.optics()}
        raise Refused(METHOD_NOT_FOUND, f"no method {method}")

    def identity(self) -> dict[str, object]:
        kit = self.kit
        return {
            "protocol": 1,
            "kind": kit.KIND,
            **self.who,
            "channels": list(kit.CHANNELS),
            "sample_rate_hz": kit.RATE_HZ,
            "compensated_for": kit.COMPENSATED_FOR,
            "notices": list(kit.NOTICES),
            "framings": ["json", "binary"],
        }

    def start(self, params: dict[str, object]) -> dict[str, str]:
        self.stop()
        self.kit.start()
        self.binary = params.get("framing") == "binary"
        self.sequence = 0
        self.running.set()
        return {"framing": "binary" if self.binary else "json"}

    def stop(self) -> dict[str, str]:
        if self.running.is_set():
            self.running.clear()
            self.kit.stop()
        return {}

    def sample(self) -> None:
        """Hand samples over as they come, until the client leaves."""
        while not self.ended.wait(1.0 / BLOCKS_PER_SECOND):
            try:
                with self.lock:
                    if self.running.is_set():
                        self.hand_over(*self.kit.read())
            except (OSError, ValueError, Refused) as error:
                # The line is cut, so that trueflank hears of it at once.
                print(f"stream ended: {error}", file=sys.stderr, flush=True)
                self.hang_up()
                return

    def hang_up(self) -> None:
        try:
            self.peer.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass

    def hand_over(self, rows, t0_s, valid, lost, events) -> None:
        told = [{"kind": kind, "at_s": at_s} for kind, at_s in events]
        if told:
            self.peer.sendall(line({"method": "stream.events", "params": {"events": told}}))
        most = MOST_VALUES // len(self.kit.CHANNELS) if self.binary else 2000
        dt_s = 1.0 / self.kit.RATE_HZ
        self.sequence += lost
        for start in range(0, len(rows), most):
            part = rows[start : start + most]
            if not all(math.isfinite(value) for row in part for value in row):
                raise ValueError("the kit gave a value that is no number")
            self.send(part, t0_s + start * dt_s, dt_s, valid, lost if start == 0 else 0)
            self.sequence += len(part)

    def send(self, part, t0_s, dt_s, valid, lost) -> None:
        if self.binary:
            self.peer.sendall(frame(self.sequence, t0_s, dt_s, part, valid, lost))
            return
        values = {name: [row[at] for row in part] for at, name in enumerate(self.kit.CHANNELS)}
        params = {"sequence": self.sequence, "t0_s": t0_s, "dt_s": dt_s, "values": values, "lost": lost}
        if not valid:
            params["valid"] = [False] * len(part)
        self.peer.sendall(line({"method": "stream.samples", "params": params}))


def serve(kit: YourKit, port: int, say=print) -> None:
    """Listen for one client after the other, for ever."""
    who = kit.open()
    try:
        with socket.create_server(("127.0.0.1", port)) as server:
            say(f"tcp://127.0.0.1:{server.getsockname()[1]}", flush=True)
            while True:
                peer, _address = server.accept()
                with peer:
                    peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    Conversation(kit, who, peer).serve()
    finally:
        kit.close()


def main() -> int:
    """Read the port and serve."""
    parser = argparse.ArgumentParser(description="Instrument bridge for trueflank.")
    parser.add_argument("--port", type=int, default=9311, help="0 for any free one, which is printed")
    try:
        serve(YourKit(), parser.parse_args().port)
    except KeyboardInterrupt:
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
