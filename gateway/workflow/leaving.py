"""How a run leaves the machine: what it sent is asked to end, its words are given back, and what is left is told."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any, ClassVar

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.leftover import NOTHING, Leavable, LeftOver
from drivers.message import Message
from gateway import audit, stopping
from gateway.say import Say
from gateway.store import RunFolder, Store
from gateway.supervisor import Supervisor

# Of the 30 s that a stop may take; the rest is for closing the devices.
WITHDRAW_S = 20.0
STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class LeftFinding:
    """Something of ours that an earlier gateway left in the control, before and after it was asked to end."""

    found: LeftOver
    after: LeftOver | None = None
    still_on: ClassVar[bool] = False

    @property
    def action(self) -> str:
        """What is offered."""
        now = self.found if self.after is None else self.after
        return "none" if now.clear else "end"

    @property
    def stands(self) -> bool:
        """Whether it was asked to end and is still there: a person at the control ends it."""
        return self.after is not None and not self.after.clear

    @property
    def words(self) -> str:
        """The finding as people read it."""
        return self.found.words if self.after is None else self.after.words

    @property
    def said(self) -> tuple[Message, ...]:
        """The finding: what is left, and what to press."""
        left = self.found if self.after is None else self.after
        return (left.said.message,)

    @property
    def said_at_last(self) -> tuple[Message, ...]:
        """How it stands now."""
        return self.said

    @property
    def at_last(self) -> str:
        """How it stands now."""
        return self.words

    def as_data(self) -> dict[str, Any]:
        """The finding as JSON data."""
        now = self.found if self.after is None else self.after
        return {"left_over": now.as_data(), "action": self.action, "what": self.words}


async def leave(
    supervisor: Supervisor, folder: RunFolder, store: Store, clock: Clock, say: Say, why: BaseException
) -> None:
    """After a failure or a stop: end what was sent, within `WITHDRAW_S`, and say what a person must press."""
    stop = stopping.current()
    with stop.leaving():
        left = await withdrawn(supervisor)
        was_stopped = isinstance(why, asyncio.CancelledError)
        if left.kind != "nothing" and (was_stopped or not left.clear):
            stop.tell(left.sentence)
            if not was_stopped:  # else the last word of the command says it
                say("P-LEFT", words=left.said.message)
        if was_stopped:
            _note(folder, store, clock, say, stop, left)


async def withdrawn(supervisor: Supervisor) -> LeftOver:
    """What is left after it was asked to end."""
    controller = supervisor.controller
    return await controller.withdraw(WITHDRAW_S) if isinstance(controller, Leavable) else NOTHING


def _note(folder: RunFolder, store: Store, clock: Clock, say: Say, stop: stopping.StopAsked, left: LeftOver) -> None:
    """The run's state, and for each transaction that was cut short the end of its audit record."""
    try:
        folder.set_state(STOPPED, error=stop.error().as_record())
    except TrueflankError as error:
        stop.tell(str(error))
    told = {"run": folder.run_id, "by": stop.by, "left": left.words}
    for number in stop.transactions:
        problem = audit.note(store.root, "push-stopped", clock=clock, transaction=number, details=told)
        if problem:
            say("P-AUDIT", problem=problem)
    stop.transactions.clear()


async def clear(supervisor: Supervisor, timeout_s: float) -> LeftOver:
    """End it; ``timeout_s`` is the time for a person to press what was said."""
    controller = supervisor.controller
    return await controller.clear_left_over(timeout_s) if isinstance(controller, Leavable) else NOTHING
