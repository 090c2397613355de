"""What a way back puts back: two readings must agree on it, one before the push and the back-up of its first half."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.types.tables import LiveTable
from gateway.errors import VerifyError
from gateway.push import conversation
from gateway.push.readback import keep_backup
from gateway.push.unexpected import foreseen
from gateway.push.work import Work
from gateway.table.comparison import differences

SETTLE_S = 4.0


async def confirm(work: Work, found: LiveTable) -> None:
    """Two readings must agree on what to go back to: what was live before, and the back-up of the first half.

    The back-up may not have been read yet, because the push failed or the gateway died before: it is fetched now, by
    the transaction's number. Where ``found``, read now, still has the values from before, that is the second reading:
    nothing else would be put back than what stands there.
    Raises VerifyError (E-PUSH-UNCONFIRMED): nothing may be put back, compensation stays off.
    """
    if work.confirmed or not differences(work.restore_to.table, found.table, work.allowed):
        return
    order = work.order(work.change.new, False, "restore", work.whole.number)
    try:
        (backup,) = await work.context.controller.backup_of((order,))
    except TrueflankError as error:
        raise VerifyError("E-PUSH-UNCONFIRMED", work.axis, axis=work.axis, why=error.message) from error
    keep_backup(work, order, backup)
    if not work.confirmed:
        raise VerifyError("E-PUSH-UNCONFIRMED", work.axis, axis=work.axis, why=Message.of("W-PUSH-TWO-READS"))


async def second_readings(works: Sequence[Work]) -> None:
    """The back-ups of all tables of a transaction before the first way back replaces the files they stand in.

    What cannot be had is told when that table's turn comes. Raises StoreError alone.
    """
    if len(works) < 2 or all(work.confirmed for work in works):
        return
    context = works[0].context
    with contextlib.suppress(TrueflankError), foreseen(context.axis.name):
        await conversation.reach(context)
        await works[0].only_ours()
        await conversation.leave_program(context)
        await context.clock.sleep(SETTLE_S)
    for work in works:
        if not work.confirmed:
            await _second_reading(work)


async def _second_reading(work: Work) -> None:
    order = work.order(work.change.new, False, "restore", work.whole.number)
    try:
        with foreseen(work.axis):
            (backup,) = await work.context.controller.backup_of((order,))
    except TrueflankError:
        return
    keep_backup(work, order, backup)
