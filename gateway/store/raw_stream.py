"""A stream of doubles on disk: raw float64 and what it means beside it, readable at any moment, after a kill too.

NAME.f64 holds little-endian doubles and nothing else; NAME.json is whole before the first of them; NAME.gaps
gets one line "index lost" as soon as a gap is known. A half double at the end of a killed file is left out.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import numpy as np

from drivers.local.ownfiles import open_own
from drivers.recordings import FloatArray, Recording, RecordingGap
from drivers.units import DeviationUnit
from gateway.errors import CorruptRecord
from gateway.store.disk import checked_name, disk_errors, read_whole, write_whole

SAMPLE = 8


@dataclass(frozen=True, slots=True)
class StreamFacts:
    """What the doubles mean: ``raw * scale`` is in ``unit``, ``rate_hz`` samples a second."""

    rate_hz: float
    unit: DeviationUnit
    scale: float = 1.0
    trigger: int | None = None
    header: Mapping[str, str] | None = None


class RawRecorder:
    """Appends blocks to a stream's files; memory use does not grow with its length.

    Raises StoreError (E-STORE-DISK) when the disk refuses: what was written before stays readable.
    """

    def __init__(self, folder: Path, name: str, facts: StreamFacts) -> None:
        path = folder / checked_name(name)
        self.path = path.with_name(f"{path.name}.f64")
        self.count = 0
        said: dict[str, object] = {
            "rate_hz": facts.rate_hz,
            "unit": facts.unit,
            "scale": facts.scale,
            "trigger": facts.trigger,
        }
        said["header"] = dict(facts.header or {})
        write_whole(path.with_name(f"{path.name}.json"), json.dumps(said, indent=1).encode())
        self._gaps = path.with_name(f"{path.name}.gaps")
        with disk_errors(self.path):
            self._file: BinaryIO = open_own(self.path, "xb", buffering=0)

    def append(self, block: FloatArray, lost: int = 0) -> None:
        """Add samples (n,); ``lost`` are missing just before them."""
        if lost:
            with disk_errors(self._gaps), open_own(self._gaps, "ab") as file:
                file.write(f"{self.count} {lost}\n".encode("ascii"))
        data = np.ascontiguousarray(block, dtype="<f8").data.cast("B")
        with disk_errors(self.path):
            while len(data):
                data = data[self._file.write(data) or 0 :]
        self.count += len(block)

    def close(self) -> None:
        """Let go of the file; may be called twice."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: object, _trace: TracebackType | None) -> None:
        self.close()


def open_stream(path: Path) -> Recording:
    """A stream by its .f64 file, mapped. Raises StoreError (E-STORE-DISK), CorruptRecord (E-STORE-STREAM)."""
    beside = path.with_suffix(".json")
    text = read_whole(beside)
    facts = _facts(text, beside)
    with disk_errors(path):
        count = path.stat().st_size // SAMPLE
        raw = np.memmap(path, dtype="<f8", mode="r", shape=(count,)) if count else np.zeros(0)
    gaps = _read_gaps(path.with_suffix(".gaps"), count)
    return Recording(
        raw=raw,
        rate_hz=facts.rate_hz,
        unit=facts.unit,
        scale=facts.scale,
        trigger=facts.trigger,
        gaps=gaps,
        header=facts.header or {},
    )


def _facts(text: bytes, where: Path) -> StreamFacts:
    try:
        said = json.loads(text)
        facts = StreamFacts(
            rate_hz=float(said["rate_hz"]),
            unit=said["unit"],
            scale=float(said["scale"]),
            trigger=said["trigger"],
            header=dict(said["header"]),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise CorruptRecord("E-STORE-STREAM", str(where), why=str(error)) from error
    if facts.unit not in ("um", "arcsec") or not facts.rate_hz > 0:
        raise CorruptRecord("E-STORE-STREAM", str(where), why=f"{facts.rate_hz:g} Hz in {facts.unit!r}")
    return facts


def _read_gaps(path: Path, count: int) -> tuple[RecordingGap, ...]:
    """Whole lines only: the last one may have been torn."""
    if not path.exists():
        return ()
    with disk_errors(path):
        lines = path.read_text(encoding="ascii", errors="replace").split("\n")[:-1]
    try:
        gaps = [RecordingGap(*(int(number) for number in line.split())) for line in lines]
    except (ValueError, TypeError) as error:
        raise CorruptRecord("E-STORE-STREAM", str(path), why=str(error)) from error
    return tuple(gap for gap in gaps if gap.index <= count)
