"""Waiting while the operator restarts the NCK and references the axes after a table was switched on."""

from __future__ import annotations

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded
from drivers.sinumerik.ncprogram.pushing import activate_message
from drivers.sinumerik.opcua.dialogue import Dialogue, Glance
from drivers.types.machine import ChannelStatus

GRACE_S = 3.0


async def activation(
    dialogue: Dialogue, clock: Clock, axis: str, timeout_s: float, look_s: float, where: str, *, shown: bool = True
) -> None:
    """Return when the axis is referenced and the channel in reset, after the reference was seen to be lost.

    A look is taken every ``look_s``. The restart may still pass between two looks, so a state that stays as
    wanted for `GRACE_S` counts as well: whether the table acts is proved by its live values, not here. Where nothing
    will act, not ``shown``, only a restart that was seen counts.
    Raises DeadlineExceeded (E-NC-NO-ACTIVATION) and what the session raises.
    """
    end = clock.now() + timeout_s
    seen_down, settled_since = False, None
    dialogue.pace.again()
    while True:
        seen = await dialogue.look_through_restart()
        now = clock.now()
        seen_down = seen_down or seen is None or not seen.referenced
        if seen is None or not _is_back(axis, seen):
            settled_since = None
        else:
            settled_since = now if settled_since is None else settled_since
            if seen_down or (shown and now - settled_since >= GRACE_S):
                return
        if now >= end:
            raise DeadlineExceeded("E-NC-NO-ACTIVATION", where, axis=axis, timeout_s=timeout_s)
        await dialogue.wait(look_s)


def _is_back(axis: str, seen: Glance) -> bool:
    return seen.referenced and seen.channel is ChannelStatus.RESET and seen.message != activate_message(axis)
