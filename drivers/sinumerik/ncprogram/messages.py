"""What a program of ours shows while it waits for a person, found in its own blocks; pure."""

from __future__ import annotations

import re

from drivers.programs import Moment
from drivers.sinumerik.ncprogram.grinding import LOAD, UNLOAD
from drivers.sinumerik.ncprogram.pushing import ACTIVATE
from drivers.sinumerik.ncprogram.selftest import PRESS

_WAITS = re.compile(r'^(?:N\d+ )?MSG\("([^"]*)"\)\n(?:N\d+ )?M0$', re.MULTILINE)
_BEGINS: dict[Moment, str] = {
    "restart": ACTIVATE,
    "clamp": LOAD,
    "unclamp": UNLOAD,
    "self-test": PRESS,
}


def messages(text: str) -> tuple[str, ...]:
    """Every message that a program shows at an M0, in its order."""
    return tuple(_WAITS.findall(text))


def message(text: str, moment: Moment) -> str:
    """The message of one moment; "" where the program does not wait then."""
    return next((one for one in messages(text) if one.startswith(_BEGINS[moment])), "")
