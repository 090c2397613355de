"""What a site file may say about an IDS3010."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.link import read_settings, wrong_setting


@dataclass(frozen=True, slots=True)
class AttocubeSettings:
    """``axis`` 1..3; ``poll_hz`` samples asked for a second; ``block_s`` how much of them one block holds.

    ``refractive_index`` 0: ask the device which index its lengths hold; else it is this one.
    """

    axis: int = 1
    poll_hz: float = 100.0
    block_s: float = 0.1
    refractive_index: float = 0.0
    timeout_s: float = 2.0

    @classmethod
    def read(cls, settings: Mapping[str, Any], where: str) -> AttocubeSettings:
        """From the site file. Raises ConfigError (E-CFG-SETTING, E-CFG-SETTING-VALUE)."""
        found = read_settings(cls, settings, where)
        for key, good, why in (
            ("axis", found.axis in (1, 2, 3), "must be 1, 2 or 3"),
            ("poll_hz", 0 < found.poll_hz <= 1000, "must be above 0, 1000 at most"),
            ("block_s", 0 < found.block_s <= 5, "must be above 0, 5 at most"),
            (
                "refractive_index",
                found.refractive_index == 0 or 1 <= found.refractive_index < 1.01,
                "must be 0 or an index",
            ),
            ("timeout_s", found.timeout_s > 0, "must be above 0"),
        ):
            if not good:
                raise wrong_setting(key, why, where)
        return found
