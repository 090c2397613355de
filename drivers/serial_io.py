"""Serial ports (and pyserial's socket://): a reader thread hands blocks of bytes over to the event loop."""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from errno import EACCES, EBUSY
from pathlib import Path
from typing import Any

import serial
from serial.tools import list_ports

from drivers.clock import Clock, SharedTimeLoop
from drivers.errors import TransportError
from drivers.message import Message

BLOCK_BYTES = 1 << 18
QUEUE_BYTES = 64 << 20
POLL_S = 0.05
WRITE_S = 1.0
# A port that gives this much at once has more at once: it is waited for, so that the loop wakes up less often.
FAST_BYTES = 1024
MORE_S = 0.001
USB = "usb://"


def _raw_socket(port: serial.Serial) -> socket.socket | None:
    # pyserial keeps it private, and leaves it open when the peer has hung up before close().
    found = getattr(port, "_socket", None)
    return found if isinstance(found, socket.socket) else None


def _close_port(port: serial.Serial) -> None:
    raw = _raw_socket(port)
    if raw is not None:
        # pyserial would sleep a third of a second here.
        raw.close()
        port.is_open = False
        return
    with contextlib.suppress(OSError, serial.SerialException):
        port.close()


def _read_block(port: serial.Serial) -> bytes:
    """Wait at most POLL_S for one byte, then take all that is there without waiting."""
    first: bytes = port.read(1)
    if not first:
        return b""
    waiting = min(port.in_waiting, BLOCK_BYTES)
    return first + port.read(waiting) if waiting else first


def _read_descriptor(number: int) -> bytes:
    """The same by the port's file number, without a call for each byte; a fast port fills a whole block."""
    pieces: list[bytes] = []
    size, patience = 0, POLL_S
    while size < BLOCK_BYTES and select.select([number], [], [], patience)[0]:
        try:
            data = os.read(number, BLOCK_BYTES - size)
        except BlockingIOError:
            break
        if not data:
            if pieces:
                break  # the end is met again by the next call
            raise serial.SerialException("the device is gone")
        pieces.append(data)
        size += len(data)
        patience = MORE_S if len(data) >= FAST_BYTES else 0.0
    return b"".join(pieces)


def _reader_of(port: serial.Serial) -> Callable[[], bytes]:
    if sys.platform != "win32" and hasattr(port, "fileno"):
        number = port.fileno()
        return lambda: _read_descriptor(number)
    return lambda: _read_block(port)


def _resolved(url: str) -> str:
    """The port that a USB serial number has right now. Raises TransportError (E-LINK-ABSENT)."""
    wanted = url.removeprefix(USB)
    if wanted == url:
        return url
    seen = {str(port.serial_number): str(port.device) for port in list_ports.comports() if port.serial_number}
    if wanted not in seen:
        raise TransportError("E-LINK-ABSENT", url, wanted=wanted, known=", ".join(sorted(seen)) or "none")
    return seen[wanted]


def _hardware(path: str) -> str:
    """The USB serial number of an open port; "" where it has none."""
    if "://" in path:
        return ""
    real = {path, str(Path(path).resolve())}
    return next((str(port.serial_number or "") for port in list_ports.comports() if port.device in real), "")


def _keep_others_out(port: serial.Serial) -> None:
    """Ask the system too: pyserial's own lock holds back only those who ask for it."""
    if sys.platform == "win32" or _raw_socket(port) is not None or not hasattr(port, "fileno"):
        return
    import fcntl  # noqa: PLC0415 - not there on Windows
    import termios  # noqa: PLC0415

    with contextlib.suppress(OSError):
        fcntl.ioctl(port.fileno(), termios.TIOCEXCL)


class _Opening:
    """A port being opened in a thread; whoever gives up waiting has it closed when it comes."""

    def __init__(self, url: str, **line: Any) -> None:
        self._url = url
        self._line = line
        self.port: serial.Serial | None = None
        self.hardware = ""

    def run(self) -> serial.Serial:
        path = _resolved(self._url)
        exclusive = None if "://" in path else True
        self.port = serial.serial_for_url(
            path, **self._line, timeout=POLL_S, write_timeout=WRITE_S, exclusive=exclusive
        )
        _keep_others_out(self.port)
        self.hardware = _hardware(path)
        self.port.reset_input_buffer()
        return self.port

    def undo(self) -> None:
        if self.port is not None:
            _close_port(self.port)


class SerialTransport:
    """An open port: one thread reads, one writes, the loop only takes and gives bytes.

    ``hardware`` is the port's USB serial number, "" where it has none. A socket whose bytes are not taken holds
    its peer back; a real port cannot, so there too much waiting is an error.
    """

    def __init__(self, url: str, port: serial.Serial, workers: ThreadPoolExecutor, hardware: str = "") -> None:
        self.hardware = hardware
        self._url = url
        self._port = port
        self._workers = workers
        self._loop = asyncio.get_running_loop()
        self._held_time = contextlib.ExitStack()
        if isinstance(self._loop, SharedTimeLoop):  # nobody counts the bytes of a port: time waits a moment for them
            self._held_time.enter_context(self._loop.uncounted_wire())
        self._news = asyncio.Event()
        self._room = threading.Condition()
        self._pieces: deque[bytes] = deque()
        self._waiting = 0
        self._failure: TransportError | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._pump, name=f"reader of {url}", daemon=True)
        self._thread.start()

    @property
    def description(self) -> str:
        """The url or port name."""
        return self._url

    def _pump(self) -> None:
        patient = _raw_socket(self._port) is not None
        try:
            read = _reader_of(self._port)
            while not self._stopping.is_set():
                data = read()
                if data and not self._hand_over(data, patient=patient):
                    return
        except (serial.SerialException, OSError, ValueError) as error:
            self._fail(TransportError("E-LINK-CLOSED", self._url, why=str(error)))
        finally:
            # The thread that reads also closes: pyserial breaks when closed under a read.
            _close_port(self._port)

    def _hand_over(self, data: bytes, *, patient: bool) -> bool:
        with self._room:
            self._pieces.append(data)
            self._waiting += len(data)
        if not self._wake():
            return False
        with self._room:
            while patient and self._waiting > QUEUE_BYTES and not self._stopping.is_set():
                self._room.wait(POLL_S)
            full = self._waiting > QUEUE_BYTES
        if full and not self._stopping.is_set():
            self._fail(TransportError("E-LINK-OVERFLOW", self._url, limit=f"{QUEUE_BYTES} bytes"))
        return not full

    def _fail(self, error: TransportError) -> None:
        self._failure = error
        self._wake()

    def _wake(self) -> bool:
        try:
            self._loop.call_soon_threadsafe(self._news.set)
        except RuntimeError:  # the loop is closed: nobody listens any more
            return False
        return True

    async def read(self, max_bytes: int) -> bytes:
        """Return 1 .. max_bytes bytes; TransportError (E-LINK-CLOSED, E-LINK-OVERFLOW)."""
        while True:
            self._news.clear()
            failure = self._failure
            data = self._taken(max_bytes)
            if data:
                return data
            if failure is not None:
                raise failure
            self._check_open()
            await self._news.wait()

    def _taken(self, max_bytes: int) -> bytes:
        with self._room:
            taken: list[bytes] = []
            size = 0
            while self._pieces and size < max_bytes:
                piece = self._pieces.popleft()
                if size + len(piece) > max_bytes:
                    self._pieces.appendleft(piece[max_bytes - size :])
                    piece = piece[: max_bytes - size]
                taken.append(piece)
                size += len(piece)
            self._waiting -= size
            self._room.notify()
        return taken[0] if len(taken) == 1 else b"".join(taken)

    def _check_open(self) -> None:
        if self._stopping.is_set():
            raise TransportError("E-LINK-CLOSED", self._url, why=Message.of("W-LINK-CLOSED"))

    async def write(self, data: bytes) -> None:
        """Write in a thread, at most WRITE_S; TransportError (E-LINK-WRITE, E-LINK-CLOSED)."""
        self._check_open()
        await self._in_thread(self._write, data)

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise TransportError("E-LINK-WRITE", self._url, timeout_s=WRITE_S) from error
        except (serial.SerialException, OSError, ValueError) as error:
            # ValueError: the thread that reads has closed the port meanwhile, and its file number is -1.
            raise TransportError("E-LINK-CLOSED", self._url, why=str(error)) from error

    async def _in_thread(self, work: Callable[..., None], *arguments: object) -> None:
        await self._loop.run_in_executor(self._workers, work, *arguments)

    async def close(self) -> None:
        """Stop the threads and close the port; waits until both are done."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        self._news.set()
        try:
            await self._in_thread(self._thread.join)
        finally:
            self._workers.shutdown()
            self._held_time.close()


def _refusal(url: str, error: Exception) -> TransportError:
    number = getattr(error, "errno", None)
    text = str(error)
    taken = number in (EBUSY, EACCES) or "exclusively lock" in text or "PermissionError" in text
    return TransportError("E-LINK-TAKEN" if taken else "E-LINK-CONNECT", url, why=text)


async def open_serial(
    url: str,
    clock: Clock,
    timeout_s: float,
    *,
    baudrate: int,
    parity: str = "N",
    data_bits: int = 8,
    stop_bits: int = 1,
) -> SerialTransport:
    """Open COM3, /dev/ttyUSB0, usb://SERIAL-NUMBER or socket://host:port.

    What waited in the port from before is thrown away. A USB serial number is looked for afresh each time, so the
    same device is found under whatever name it has after it was unplugged. Raises TransportError (E-LINK-CONNECT,
    E-LINK-TAKEN, E-LINK-ABSENT) or DeadlineExceeded.
    """
    workers = ThreadPoolExecutor(max_workers=1, thread_name_prefix=f"writer of {url}")
    opening = _Opening(url, baudrate=baudrate, parity=parity, bytesize=data_bits, stopbits=stop_bits)
    loop = asyncio.get_running_loop()
    try:
        async with clock.deadline(timeout_s, url):
            port = await loop.run_in_executor(workers, opening.run)
        return SerialTransport(url, port, workers, opening.hardware)
    except TransportError:
        workers.submit(opening.undo)
        workers.shutdown(wait=False)
        raise
    except (serial.SerialException, OSError, ValueError) as error:
        workers.shutdown()
        raise _refusal(url, error) from error
    except BaseException:
        workers.submit(opening.undo)
        workers.shutdown(wait=False)
        raise
