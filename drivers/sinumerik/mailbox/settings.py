"""What a site file may say about a control behind a PLC mailbox."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from drivers.link import read_settings, wrong_setting
from drivers.sinumerik.mailbox.codec.packing import WordOrder

_CHARACTER_BITS = 11.0
_FAST_BAUD, _FAST_GAP_S = 19200, 0.00175


@dataclass(frozen=True, slots=True)
class ModbusSettings:
    """Keys under ``[controller.settings]``; the same list stands in docs/plc-mailbox.md.

    ``framer`` "tcp" or "rtu"; "" takes RTU for serial ports and socket://, TCP else. ``reply_s`` is the longest wait
    for one answer, ``command_s`` for a command to be done (its 60 s at the panel apart). ``poll_s`` while idle,
    ``fast_poll_s`` first in a transfer. ``encoder`` is the measuring system of `saved_tables`. ``needs_reference``: a
    new table acts only after NCK reset and reference, so people are waited for.
    """

    unit: int = 1
    framer: str = ""
    word_order: str = "high-first"
    baudrate: int = 115_200
    parity: str = "N"
    reply_s: float = 1.0
    poll_s: float = 0.2
    fast_poll_s: float = 0.001
    command_s: float = 30.0
    encoder: int = 0
    needs_reference: bool = True

    @classmethod
    def read(cls, settings: Mapping[str, Any], where: str) -> ModbusSettings:
        """From the site file. Raises ConfigError (E-CFG-SETTING, E-CFG-SETTING-VALUE)."""
        found = read_settings(cls, settings, where)
        for key, good, why in found.limits():
            if not good:
                raise wrong_setting(key, why, where)
        return found

    def limits(self) -> tuple[tuple[str, bool, str], ...]:
        """Key, whether its value is allowed, and what is allowed."""
        return (
            ("unit", 1 <= self.unit <= 247, "must be 1 .. 247: 0 would reach every device"),
            ("framer", self.framer in ("", "tcp", "rtu"), "must be tcp or rtu"),
            ("word_order", self.word_order in ("high-first", "low-first"), "must be high-first or low-first"),
            ("baudrate", 1200 <= self.baudrate <= 4_000_000, "must be 1200 or more"),
            ("parity", self.parity in ("N", "E", "O"), "must be N, E or O"),
            ("reply_s", 0.05 <= self.reply_s <= 30.0, "must be 0.05 .. 30 s"),
            ("poll_s", 0.2 <= self.poll_s <= 5.0, "must be 0.2 .. 5 s"),
            ("fast_poll_s", 0.001 <= self.fast_poll_s <= self.poll_s, "must be 0.001 s .. poll_s"),
            ("command_s", 5.0 <= self.command_s <= 600.0, "must be 5 .. 600 s"),
            ("encoder", self.encoder in (0, 1), "must be 0 or 1"),
        )

    @property
    def order(self) -> WordOrder:
        """The word order, checked by `read`."""
        return "high-first" if self.word_order == "high-first" else "low-first"

    def framing(self, url: str) -> str:
        """tcp or rtu for this url."""
        scheme = urlsplit(url).scheme if "://" in url else ""
        return self.framer or ("tcp" if scheme in ("tcp", "memory") else "rtu")

    @property
    def gap_s(self) -> float:
        """Silence before a request on a serial line: 3.5 characters, fixed above 19200 Bd (Serial Line V1.02)."""
        return _FAST_GAP_S if self.baudrate > _FAST_BAUD else 3.5 * _CHARACTER_BITS / self.baudrate
