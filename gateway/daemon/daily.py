"""Once a day the live tables are compared with what was pushed: done here where nobody is needed, else told."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.message import Message
from gateway.daemon.desk import Desk
from gateway.daemon.jobs import RunStarter

LOOK_EVERY_S = 60.0
TRY_AGAIN_S = 3600.0


@dataclass(slots=True)
class Daily:
    """What is to be compared each day from ``hour`` o'clock (UTC) on.

    ``due`` names the tables not compared since; ``job`` compares them all. Whether it may is what ``alone`` says: false
    where the road needs a person, and then it is only said and never started; None as long as that is not known.
    """

    hour: int
    due: Callable[[], tuple[str, ...]]
    job: RunStarter
    alone: Callable[[], bool | None]
    tables: tuple[str, ...] = field(default=(), init=False)

    @property
    def due_message(self) -> Message | None:
        """What a person must do; None where there is nothing, or this program does it."""
        if not self.tables or self.alone() is not False:
            return None
        return Message.of("W-VERIFY-DUE", hour=f"{self.hour:02d}", tables=self.tables)


async def each_day(desk: Desk, daily: Daily, clock: Clock) -> None:
    """Look every minute, for ever, whether something is due; one that fails is tried again after an hour."""
    tried_at = -TRY_AGAIN_S
    while True:
        with contextlib.suppress(TrueflankError):
            daily.tables = daily.due()
        if daily.tables and daily.alone() and desk.run is None and clock.now() - tried_at >= TRY_AGAIN_S:
            tried_at = clock.now()
            with contextlib.suppress(TrueflankError):  # the desk shows why a job failed
                await desk.start(daily.job)
        await clock.sleep(LOOK_EVERY_S)
