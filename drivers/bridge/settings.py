"""What a site file may say about an instrument behind the bridge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.link import read_settings, wrong_setting


@dataclass(frozen=True, slots=True)
class BridgeSettings:
    """``turn_timeout_s`` bounds a turn, hold or track; ``stale_s`` a silent stream; battery in per cent."""

    baudrate: int = 115_200
    turn_timeout_s: float = 60.0
    stale_s: float = 5.0
    battery_refuse_pct: float = 10.0
    battery_warn_pct: float = 20.0

    @classmethod
    def read(cls, settings: Mapping[str, Any], where: str) -> BridgeSettings:
        """From the site file. Raises ConfigError (E-CFG-SETTING, E-CFG-SETTING-VALUE)."""
        found = read_settings(cls, settings, where)
        for key in ("baudrate", "turn_timeout_s", "stale_s"):
            if getattr(found, key) <= 0:
                raise wrong_setting(key, "must be above 0", where)
        return found
