"""Keeps what passes on a device's wire in files of bounded size; a full disk ends the trace, never the measuring."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal

from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.local.names import allowed, is_name, shown
from drivers.local.ownfiles import made_folder, opened
from drivers.local.scrub import without_secrets
from drivers.replay.tracefile import Record, encode, head

FILE_BYTES = 16 << 20
FILES = 4


class TraceRecorder:
    """A device's ``trace``: called with ">" or "<" and bytes. NAME.trace is the newest file, NAME.trace.3 the oldest.

    ``failure`` says why it stopped, "" while it works. Raises ConfigError (E-NAME) when NAME is none.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        clock: Clock,
        about: Mapping[str, Any],
        *,
        file_bytes: int = FILE_BYTES,
        files: int = FILES,
    ) -> None:
        if not is_name(name):
            raise ConfigError("E-NAME", str(folder), name=shown(name), allowed=allowed())
        self.path = folder / f"{name}.trace"
        self.failure = ""
        self._clock = clock
        self._file_bytes = file_bytes
        self._files = files
        said = {**about, "device": name, "started_utc": clock.utc().isoformat(timespec="milliseconds")}
        self._head = head({**said, "settings": without_secrets(about.get("settings", {}))})
        self._file: BinaryIO | None = None
        self._size = 0
        with self._kept():
            made_folder(folder)
            self._begin()

    def _kept(self) -> contextlib.AbstractContextManager[None]:
        return _Kept(self)

    def stop(self, why: str) -> None:
        """Record no more."""
        self.failure = self.failure or why
        self.close()

    def _begin(self) -> None:
        self._file = opened(self.path, "wb")
        self._size = self._file.write(self._head)

    def session(self) -> None:
        """Mark that the device is opened (again)."""
        self._put(Record("#", self._clock.now(), b""))

    def __call__(self, direction: Literal["<", ">"], data: bytes) -> None:
        """Keep a piece."""
        self._put(Record(direction, self._clock.now(), data))

    def _put(self, record: Record) -> None:
        if self._file is None:
            return
        with self._kept():
            self._size += self._file.write(encode(record))
            if self._size >= self._file_bytes:
                self._rotate()

    def _rotate(self) -> None:
        self.close()
        for number in range(self._files - 1, 0, -1):
            older = self._numbered(number)
            newer = self._numbered(number - 1)
            if newer.exists():
                newer.replace(older)
        self._begin()

    def _numbered(self, number: int) -> Path:
        return self.path if number == 0 else self.path.with_name(f"{self.path.name}.{number}")

    def close(self) -> None:
        """Let go of the file; may be called twice."""
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(OSError):
                file.close()


class _Kept(contextlib.AbstractContextManager[None]):
    """What the disk refuses ends the trace."""

    def __init__(self, recorder: TraceRecorder) -> None:
        self._recorder = recorder

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> bool:
        if not isinstance(error, OSError):
            return False
        self._recorder.stop(str(error))
        return True
