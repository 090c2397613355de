"""Seeded fault plans around any wire: what goes wrong, how often, and always the same way for one seed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from drivers.errors import TransportError
from drivers.transport import BentTransport, ByteTransport


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Faults of one wire, seen from the end that it is put around; all zero is a faultless wire.

    Probabilities are for each piece written: ``split`` cuts it at random places, ``flip`` turns one bit,
    ``lose`` swallows some of its bytes, ``garbage`` puts random bytes before it. ``cut_after`` cuts the
    wire after so many bytes (0: never). ``incoming`` plays the same on what is read.
    """

    seed: int = 0
    split: float = 0.0
    flip: float = 0.0
    lose: float = 0.0
    garbage: float = 0.0
    cut_after: int = 0
    incoming: bool = False

    @property
    def harmless(self) -> bool:
        """True when nothing goes wrong."""
        return not (self.split or self.flip or self.lose or self.garbage or self.cut_after)

    def around(self, wire: ByteTransport) -> ByteTransport:
        """The wire with these faults."""
        if self.harmless:
            return wire
        bent = _Bend(self, wire.description)
        if self.incoming:
            return BentTransport(wire, incoming=bent, outgoing=_Bend(self, wire.description))
        return BentTransport(wire, outgoing=bent)


class _Bend:
    """One direction of one connection."""

    def __init__(self, plan: FaultPlan, where: str) -> None:
        self._plan = plan
        self._where = where
        self._rng = np.random.default_rng(plan.seed)
        self._passed = 0

    def __call__(self, data: bytes) -> Iterable[bytes]:
        self._passed += len(data)
        if self._plan.cut_after and self._passed > self._plan.cut_after:
            raise TransportError("E-LINK-CLOSED", self._where, why="the fault plan cut the wire")
        for change in (self._lost, self._flipped, self._dirtied):
            data = change(data)
        return self._pieces(data)

    def _happens(self, chance: float) -> bool:
        return bool(self._rng.random() < chance)

    def _lost(self, data: bytes) -> bytes:
        if not data or not self._happens(self._plan.lose):
            return data
        first, last = sorted(self._rng.integers(0, len(data) + 1, 2).tolist())
        return data[:first] + data[min(last, first + 64) :]

    def _flipped(self, data: bytes) -> bytes:
        if not data or not self._happens(self._plan.flip):
            return data
        bent = bytearray(data)
        bent[int(self._rng.integers(len(bent)))] ^= 1 << int(self._rng.integers(8))
        return bytes(bent)

    def _dirtied(self, data: bytes) -> bytes:
        return self._rng.bytes(7) + data if self._happens(self._plan.garbage) else data

    def _pieces(self, data: bytes) -> list[bytes]:
        if len(data) < 2 or not self._happens(self._plan.split):
            return [data]
        cuts = np.unique(self._rng.integers(1, len(data), 3)).tolist()
        return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]
