"""Work beside the devices that must go on for months: a fault in it is kept and told, and it begins again."""

from __future__ import annotations

import logging
from collections.abc import Callable, Coroutine, Mapping

from drivers.clock import Clock
from drivers.errors import TrueflankError

AGAIN_S = 60.0
_LOG = logging.getLogger("trueflank.daemon")


def _nobody(_kind: str, _data: Mapping[str, object]) -> None:
    return None


async def lasting(
    name: str,
    begin: Callable[[], Coroutine[object, object, object]],
    clock: Clock,
    tell: Callable[[str, Mapping[str, object]], None] = _nobody,
) -> None:
    """Do ``begin()`` until it ends by itself; where a fault ends it, again a minute later.

    Without this a task that nobody awaits would end in silence, and with it what it looked after.
    """
    while True:
        try:
            await begin()
            return
        except Exception as error:  # noqa: BLE001 - whatever it is, this work must not stay undone
            _LOG.exception("%s ended by a fault and begins again in %g s", name, AGAIN_S)
            why = f"{name}: {type(error).__name__}"
            tell("failure", TrueflankError("E-WEB-FAULT", "service", why=why).as_record())
        await clock.sleep(AGAIN_S)
