"""What a site file may say about an instrument behind the bridge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.link import read_settings, wrong_setting


@dataclass(frozen=True, slots=True)
class BridgeSettings:
    """``turn_timeout_s`` bounds a turn, hold or track; ``stale_s`` a silent stream; battery in per cent.

    ``framing`` "": binary frames where the bridge offers them; "json" or "binary" insists.
    ``echo``: the line gives our own questions back. ``gear_quiet_s`` bounds the silence of a gear inspection
    machine between two chunks of points.
    """

    baudrate: int = 115_200
    turn_timeout_s: float = 60.0
    stale_s: float = 5.0
    battery_refuse_pct: float = 10.0
    battery_stop_pct: float = 5.0
    battery_warn_pct: float = 20.0
    framing: str = ""
    echo: bool = False
    gear_quiet_s: float = 120.0

    @classmethod
    def read(cls, settings: Mapping[str, Any], where: str) -> BridgeSettings:
        """From the site file. Raises ConfigError (E-CFG-SETTING, E-CFG-SETTING-VALUE)."""
        found = read_settings(cls, settings, where)
        for key in ("baudrate", "turn_timeout_s", "stale_s", "gear_quiet_s"):
            if getattr(found, key) <= 0:
                raise wrong_setting(key, "must be above 0", where)
        if found.framing not in ("", "json", "binary"):
            raise wrong_setting("framing", 'must be "json", "binary" or left out', where)
        return found
