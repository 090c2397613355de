"""Serial ports (and pyserial's socket://): a reader thread hands blocks of bytes over to the event loop."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from errno import EACCES, EBUSY

import serial

from drivers.clock import Clock
from drivers.errors import TransportError

BLOCK_BYTES = 1 << 16
QUEUE_BYTES = 64 << 20
POLL_S = 0.05
WRITE_S = 1.0


def _raw_socket(port: serial.Serial) -> socket.socket | None:
    # pyserial keeps it private, and leaves it open when the peer has hung up before close().
    found = getattr(port, "_socket", None)
    return found if isinstance(found, socket.socket) else None


def _close_port(port: serial.Serial) -> None:
    raw = _raw_socket(port)
    with contextlib.suppress(OSError, serial.SerialException):
        port.close()
    if raw is not None:
        raw.close()


def _read_block(port: serial.Serial) -> bytes:
    """Wait at most POLL_S for one byte, then take all that is there without waiting."""
    first: bytes = port.read(1)
    if not first:
        return b""
    if _raw_socket(port) is None:
        waiting = min(port.in_waiting, BLOCK_BYTES)
        return first + port.read(waiting) if waiting else first
    # socket:// knows only "something waits": ask for a whole block and take what comes at once.
    port.timeout = 0
    try:
        return first + port.read(BLOCK_BYTES) if port.in_waiting else first
    finally:
        port.timeout = POLL_S


class _Opening:
    """A port being opened in a thread; whoever gives up waiting has it closed when it comes."""

    def __init__(self, url: str, baudrate: int) -> None:
        self._url = url
        self._baudrate = baudrate
        self.port: serial.Serial | None = None

    def run(self) -> serial.Serial:
        exclusive = None if "://" in self._url else True
        self.port = serial.serial_for_url(
            self._url, baudrate=self._baudrate, timeout=POLL_S, write_timeout=WRITE_S, exclusive=exclusive
        )
        self.port.reset_input_buffer()
        return self.port

    def undo(self) -> None:
        if self.port is not None:
            _close_port(self.port)


class SerialTransport:
    """An open port: one thread reads, one writes, the loop only takes and gives bytes."""

    def __init__(self, url: str, port: serial.Serial, workers: ThreadPoolExecutor) -> None:
        self._url = url
        self._port = port
        self._workers = workers
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._guard = threading.Lock()
        self._buffer = bytearray()
        self._failure: TransportError | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._pump, name=f"reader of {url}", daemon=True)
        self._thread.start()

    @property
    def description(self) -> str:
        """The url or port name."""
        return self._url

    def _pump(self) -> None:
        try:
            while not self._stopping.is_set():
                data = _read_block(self._port)
                if data and not self._hand_over(data):
                    return
        except (serial.SerialException, OSError) as error:
            self._fail(TransportError("E-LINK-CLOSED", self._url, why=str(error)))
        finally:
            # The thread that reads also closes: pyserial breaks when closed under a read.
            _close_port(self._port)

    def _hand_over(self, data: bytes) -> bool:
        with self._guard:
            self._buffer += data
            full = len(self._buffer) > QUEUE_BYTES
        if full:
            self._fail(TransportError("E-LINK-OVERFLOW", self._url, limit=f"{QUEUE_BYTES} bytes"))
            return False
        return self._wake()

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
            with self._guard:
                data = bytes(self._buffer[:max_bytes])
                del self._buffer[:max_bytes]
            if data:
                return data
            if failure is not None:
                raise failure
            self._check_open()
            await self._news.wait()

    def _check_open(self) -> None:
        if self._stopping.is_set():
            raise TransportError("E-LINK-CLOSED", self._url, why="this end is closed")

    async def write(self, data: bytes) -> None:
        """Write in a thread, at most WRITE_S; TransportError (E-LINK-WRITE, E-LINK-CLOSED)."""
        self._check_open()
        await self._in_thread(self._write, data)

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise TransportError("E-LINK-WRITE", self._url, timeout_s=WRITE_S) from error
        except (serial.SerialException, OSError) as error:
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


def _refusal(url: str, error: Exception) -> TransportError:
    number = getattr(error, "errno", None)
    text = str(error)
    taken = number in (EBUSY, EACCES) or "exclusively lock" in text or "PermissionError" in text
    return TransportError("E-LINK-TAKEN" if taken else "E-LINK-CONNECT", url, why=text)


async def open_serial(url: str, clock: Clock, timeout_s: float, baudrate: int) -> SerialTransport:
    """Open COM3, /dev/ttyUSB0 or socket://host:port; what waited in the port from before is thrown away.

    Raises TransportError (E-LINK-CONNECT, E-LINK-TAKEN) or DeadlineExceeded.
    """
    workers = ThreadPoolExecutor(max_workers=1, thread_name_prefix=f"writer of {url}")
    opening = _Opening(url, baudrate)
    loop = asyncio.get_running_loop()
    try:
        async with clock.deadline(timeout_s, url):
            port = await loop.run_in_executor(workers, opening.run)
        return SerialTransport(url, port, workers)
    except (serial.SerialException, OSError, ValueError) as error:
        workers.shutdown()
        raise _refusal(url, error) from error
    except BaseException:
        workers.submit(opening.undo)
        workers.shutdown(wait=False)
        raise
