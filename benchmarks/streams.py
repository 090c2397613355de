"""The live streams: 50 kHz frames and counter lines, each against its own floor in the same run."""

from __future__ import annotations

import asyncio
import os
import pty
import resource
import socket
import subprocess
import sys
import tempfile
import tty
from collections.abc import Callable
from contextlib import aclosing
from pathlib import Path
from statistics import median
from time import perf_counter, process_time

import numpy as np
import serial

from benchmarks import compiled
from benchmarks.report import Report, main, spent
from drivers.bridge.device import BridgeInstrument
from drivers.clock import LoopClock
from drivers.umd.codec import CODE, DATA, DISPLACEMENT, SEQUENCE, VELOCITY, UmdCodec, encode_rows
from drivers.umd.counting import UmdCounting
from drivers.umd.device import UmdCounter
from drivers.umd.settings import UmdSettings
from gateway.daemon.stream import LiveObserver
from gateway.store.raw_stream import RawRecorder, StreamFacts

BLOCK = 1 << 18
READLINES = 8_000
REPEATS = 3
WIRE_LINES_PER_S = 1_000  # what a counter on its USB port sends at most: a line a millisecond


def counter_lines(count: int) -> bytes:
    """Lines of a one-axis counter on a moving axis, low-speed codes included."""
    numbers = np.arange(count)
    rows = np.zeros((count, 8), np.int64)
    velocity = np.rint(400 * np.sin(numbers / 5000.0)).astype(np.int64)
    rows[:, DISPLACEMENT[0]] = 1_234_567 + np.cumsum(velocity)
    rows[:, VELOCITY[0]] = velocity
    rows[:, SEQUENCE] = 100_000 + numbers
    for slot, code, data in (
        (1, 10, 126),
        (2, 8, 100_000),
        (3, 3, 2150),
        (4, 4, 2020),
        (5, 5, 100_010),
        (13, 20, 1025),
    ):
        rows[numbers % 32 == slot, CODE], rows[numbers % 32 == slot, DATA] = code, data
    return encode_rows(rows)


SENDER = """
import os, socket, sys, time
path, kind, place, first = sys.argv[1:]
data = open(path, "rb").read()
first = int(first)

def pour(write):
    write(data[:first])
    sys.stdin.read(1)
    write(data[first:])

if kind == "tcp":
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        for _ in range(int(place)):
            peer, _who = server.accept()
            with peer:
                try:
                    time.sleep(0.1)  # what waits at the opening is thrown away
                    pour(peer.sendall)
                    peer.recv(1)
                except OSError:
                    pass
else:
    number = int(place)
    print(0, flush=True)
    sys.stdin.read(1)

    def write(piece):
        at = 0
        while at < len(piece):
            at += os.write(number, piece[at:at + 65536])

    pour(write)
    sys.stdin.read(1)
"""
HEAD_LINES = 1000


class Sender:
    """A process of its own that pours a file into whoever connects."""

    def __init__(self, data: bytes, kind: str, place: str, first: int = 0) -> None:
        self._file = tempfile.NamedTemporaryFile()  # noqa: SIM115 - closed in __exit__
        self._file.write(data)
        self._file.flush()
        command = [sys.executable, "-c", SENDER, self._file.name, kind, place, str(first)]
        keep = (int(place),) if kind == "pty" else ()
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, pass_fds=keep)  # noqa: S603
        assert self._process.stdout is not None  # noqa: S101
        self.port = int(self._process.stdout.readline())

    def go(self) -> None:
        """Let a pty's sender begin, or end."""
        assert self._process.stdin is not None  # noqa: S101
        self._process.stdin.write(b"g")
        self._process.stdin.flush()

    def __enter__(self) -> Sender:
        return self

    def __exit__(self, *_exc: object) -> None:
        self._process.kill()
        self._process.communicate()
        self._file.close()


async def counted(url: str, lines: int, go: Callable[[], None], *, ask: bool) -> float:
    """Seconds from the second ``go`` until the driver has given the samples of all lines after the head."""
    device = UmdCounter("laser", url, {"stale_s": 30.0}, LoopClock())
    opening = asyncio.create_task(device.open(30.0))
    if ask:
        await LoopClock().sleep(0.2)
        go()
    await opening
    async with aclosing(device.blocks()) as stream:  # type: ignore[type-var]
        first = asyncio.ensure_future(anext(stream))
        await LoopClock().sleep(0.1)
        start = perf_counter()
        go()
        block = await first
        while block.time_s[-1] * 1000.0 < 100_000 + lines - 2:
            block = await anext(stream)
        seconds = perf_counter() - start
    await device.close()
    return seconds


def on_pty(work: Callable[[str, Callable[[], None]], float], data: bytes, first: int = 0) -> float:
    """Seconds of some reader on a pty into which a process pours."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    tty.setraw(master)
    path = os.ttyname(slave)
    with Sender(data, "pty", str(master), first) as sender:
        try:
            return work(path, sender.go)
        finally:
            os.close(slave)
            os.close(master)


def split_reader(path: str, go: Callable[[], None], size: int) -> float:
    """Block read and split, nothing else."""
    with serial.Serial(path, timeout=1) as port:
        go()
        go()
        port.read(1)
        start, got, rest = perf_counter(), 1, b""
        while got < size:
            data = port.read(max(port.in_waiting, 1))
            got += len(data)
            *_lines, rest = (rest + data).split(b"\n")
        return perf_counter() - start


def line_reader(path: str, go: Callable[[], None], lines: int) -> float:
    """One readline after the other."""
    with serial.Serial(path, timeout=1) as port:
        go()
        go()
        port.read(1)
        start = perf_counter()
        for _ in range(lines):
            port.readline()
        return perf_counter() - start


def decoded(data: bytes) -> None:
    """Codec and counting alone, from memory."""
    codec, counting = UmdCodec("client"), UmdCounting(UmdSettings(), "laser")
    for at in range(0, len(data), BLOCK):
        for message in codec.receive(data[at : at + BLOCK]):
            counting.take(message)


def damaged(data: bytes) -> bytes:
    """One line in a thousand with a letter in it."""
    lines = data.split(b"\r\n")
    for at in range(500, len(lines) - 1, 1000):
        lines[at] = lines[at][:9] + b"x" + lines[at][10:]
    return b"\r\n".join(lines)


def counter(report: Report) -> None:
    """Everything about the quadrature counter."""
    count = report.pick(300_000, 5_000)
    data = counter_lines(count)
    clean = spent(lambda: decoded(data))
    report.at_least(
        "uMD: lines checked and counted in one processor second / what the wire brings",
        count / clean / WIRE_LINES_PER_S,
        100.0,
    )
    report.at_most("uMD: one damaged line in 1000, cost / clean", spent(lambda: decoded(damaged(data))) / clean, 5.0)
    if compiled.library() is None:
        report.leave_out("uMD: codec and counting / a compiled byte loop", "no C compiler here")
    else:
        floor = spent(lambda: compiled.integers(data, 8 * count))
        report.at_most(
            "uMD: codec, checks and counting / a compiled loop that only reads the numbers", clean / floor, 15.0
        )
    if not report.smoke:
        over_wires(report, count)


def over_wires(report: Report, count: int) -> None:
    """The driver over a socket and a pty, by the wall: how many lines a second come through."""
    data, head = counter_lines(count), len(counter_lines(HEAD_LINES))
    with Sender(data, "tcp", str(REPEATS), head) as sender:
        url = f"socket://127.0.0.1:{sender.port}"
        socket_s = min(asyncio.run(counted(url, count, sender.go, ask=False)) for _ in range(REPEATS))
    report.say("uMD: driver over socket://, wall time", count / socket_s / 1e6, "M/s")
    splits, drivers = [], []
    for _ in range(REPEATS):
        # A pty's speed depends on how its two ends happen to be scheduled: the middle of several is compared.
        splits.append(on_pty(lambda path, go: split_reader(path, go, len(data)), data))
        drivers.append(on_pty(lambda path, go: asyncio.run(counted(path, count, go, ask=True)), data, head))
    slow = on_pty(lambda path, go: line_reader(path, go, READLINES), counter_lines(READLINES + 10)) / READLINES
    report.at_least(
        "uMD: driver on a pty / block read and split, rates, wall time", median(splits) / median(drivers), 0.3
    )
    report.at_least("uMD: driver on a pty / readline loop, rates, wall time", slow * count / median(drivers), 20.0)


BRIDGE = """
import json, socket, struct, sys, zlib
rate, samples, frames, copies = map(int, sys.argv[1:])
IDENTITY = {"protocol": 1, "kind": "laser", "maker": "Example", "model": "L", "serial": "1", "sample_rate_hz": rate,
            "compensated_for": "nothing", "channels": ["displacement_mm"], "framings": ["json", "binary"]}
payloads = [struct.pack("<%dd" % samples, *((slot * samples + at) * 1e-6 for at in range(samples)))
            for slot in range(16)]
sums = [zlib.crc32(payload) for payload in payloads]
with socket.create_server(("127.0.0.1", 0)) as server:
    print(server.getsockname()[1], flush=True)
    for _ in range(copies):
        peer, _who = server.accept()
        with peer:
            try:
                for line in peer.makefile("rb"):
                    asked = json.loads(line)
                    result = IDENTITY if asked["method"] == "bridge.identify" else {"framing": "binary"}
                    answer = {"jsonrpc": "2.0", "id": asked["id"], "result": result}
                    peer.sendall(json.dumps(answer).encode() + b"\\n")
                    if asked["method"] != "stream.start":
                        continue
                    for number in range(0, frames, 8):
                        out = []
                        for frame in range(number, min(number + 8, frames)):
                            slot = frame % 16
                            head = struct.pack("<4sBBHQIIddI", b"\\xfaTFS", 1, 0, 1, frame * samples, samples, 0,
                                               frame * samples / rate, 1 / rate, sums[slot])
                            out += [head, struct.pack("<I", zlib.crc32(head)), payloads[slot]]
                        peer.sendall(b"".join(out))
            except OSError:
                pass
"""
RATE_HZ = 50_000
FRAME = 2_500
HOUR_FRAMES = 3600 * RATE_HZ // FRAME


class Bridge:
    """A process of its own that answers as a bridge and pours frames as fast as they are taken."""

    def __init__(self, frames: int, copies: int) -> None:
        command = [sys.executable, "-c", BRIDGE, str(RATE_HZ), str(FRAME), str(frames), str(copies)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE)  # noqa: S603
        assert self._process.stdout is not None  # noqa: S101
        self.port = int(self._process.stdout.readline())

    def __enter__(self) -> Bridge:
        return self

    def __exit__(self, *_exc: object) -> None:
        self._process.kill()
        self._process.communicate()


def floor_of_frames(port: int, folder: Path, frames: int) -> float:
    """Processor seconds of recv_into, np.frombuffer and a file write of the same frames, unchecked."""
    size = FRAME * 8 + 48
    buffer = bytearray(size)
    view = memoryview(buffer)
    total = 0.0
    with socket.create_connection(("127.0.0.1", port)) as peer, (folder / "floor").open("wb", buffering=0) as file:
        peer.sendall(b'{"jsonrpc":"2.0","id":1,"method":"stream.start","params":{"framing":"binary"}}\n')
        while peer.recv(1) != b"\n":
            pass
        used = process_time()
        for _ in range(frames):
            got = 0
            while got < size:
                got += peer.recv_into(view[got:])
            values = np.frombuffer(buffer, "<f8", FRAME, 48)
            file.write(values.data)
            total += float(values[0])
        return process_time() - used


async def stored(port: int, folder: Path, name: str, frames: int) -> float:
    """Processor seconds until driver and recorder have read, checked and stored every frame."""
    device = BridgeInstrument("laser", f"tcp://127.0.0.1:{port}", {}, LoopClock())
    await device.open(30.0)
    facts = StreamFacts(RATE_HZ, "um", 1000.0)
    used = process_time()
    with RawRecorder(folder, name, facts) as recorder:
        async with aclosing(device.blocks()) as stream:  # type: ignore[type-var]
            async for block in stream:
                recorder.append(block.values[:, 0], block.lost)
                if recorder.count >= frames * FRAME:
                    break
            used = process_time() - used
    await device.close()
    if recorder.count != frames * FRAME or recorder.path.stat().st_size != 8 * frames * FRAME:
        raise SystemExit("frames were lost")
    recorder.path.unlink()
    return used


async def watched(port: int, frames: int) -> float:
    """Megabytes grown while frames pass through driver and live picture, the first tenth not counted."""
    device = BridgeInstrument("laser", f"tcp://127.0.0.1:{port}", {}, LoopClock())
    await device.open(30.0)
    seen, before = 0, 0.0
    looking = LiveObserver(lambda _kind, _told: None, LoopClock())
    async with aclosing(device.blocks()) as stream:  # type: ignore[type-var]
        async for block in stream:
            looking.samples("laser", block)
            seen += len(block)
            if not before and seen >= frames * FRAME // 10:
                before = most_memory_mb()
            if seen >= frames * FRAME:
                break
    await device.close()
    return most_memory_mb() - before


def most_memory_mb() -> float:
    """The most this process has ever held, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def frames(report: Report) -> None:
    """Everything about the framed 50 kHz stream of doubles."""
    count, repeats = report.pick(2_400, 40), report.pick(REPEATS, 1)
    with tempfile.TemporaryDirectory() as name, Bridge(count, 2 * repeats) as bridge:
        folder = Path(name)
        floors, ours = [], []
        for number in range(repeats):
            floors.append(floor_of_frames(bridge.port, folder, count))
            ours.append(asyncio.run(stored(bridge.port, folder, f"stream{number}", count)))
    real_s = count * FRAME / RATE_HZ
    report.at_least("frames: real time / processor time to read, check and store", real_s / min(ours), 100.0)
    report.at_most("frames: the same / recv_into, frombuffer and a file write", min(ours) / min(floors), 3.0)
    hour = report.pick(HOUR_FRAMES, 100)
    with Bridge(hour, 1) as bridge:
        grown = asyncio.run(watched(bridge.port, hour))
    report.at_most(f"frames: memory grown while {hour * FRAME / RATE_HZ:.0f} s of frames pass", grown, 64.0, "MB")


def measure(report: Report) -> None:
    """All figures of this file."""
    frames(report)
    counter(report)


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
