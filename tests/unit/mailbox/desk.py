"""A driver in front of the scripted PLC, in virtual time, and the orders it is given."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from typing import Any

from drivers.sinumerik.mailbox.device import SinumerikModbus
from drivers.types.orders import PushOrder, SignProof
from drivers.types.tables import CompensationTable, LiveSet
from tests.batches import sets_of
from tests.unit.mailbox.rogue import Rogue, serving

VALUES = tuple(float(value) for value in (0, 3, -1.5, 2.001, 0, *range(-27, 28), 1, 0))


def table(values: tuple[float, ...] = VALUES, **changes: object) -> CompensationTable:
    """An EEC table of X1, zero where the scripted axis stands (0 mm)."""
    last = 10.0 * (len(values) - 1)
    given: dict[str, object] = {"minimum": 0.0, "maximum": last, "step": 10.0, "deviations": values}
    return CompensationTable("axis", "X1", "X1", **{**given, **changes})  # type: ignore[arg-type]


async def order_for(device: SinumerikModbus, wanted: CompensationTable | None = None, **changes: Any) -> PushOrder:
    """An order with a proof of this machine."""
    proof = SignProof(await device.identify(), "axis", "X1", 1.0, 0.01, 1, "2026-01-01T00:00:00+00:00")
    return PushOrder(
        **{
            "transaction": 17,
            "table": wanted or table(),
            "letter": "X",
            "rotary": False,
            "enable": True,
            "agreeing_position": 0.0,
            "purpose": "table",
            "proof": proof,
            **changes,
        }
    )


async def push(device: SinumerikModbus, order: PushOrder) -> tuple[LiveSet, LiveSet]:
    """The whole push."""
    await device.stage((order,))
    sets = sets_of(await device.read_back((order,), 100.0))
    await device.activate((order,), (order,))
    assert await device.confirm((order,), 100.0) == (True,)
    await device.finish_push((order,), "committed")
    return sets


def driver(rogue: Rogue, url: str, **settings: Any) -> SinumerikModbus:
    """A driver set up for the scripted PLC."""
    order = "low-first" if rogue.low_first else "high-first"
    given = {"framer": rogue.framer, "unit": rogue.unit, "word_order": order, "needs_reference": False}
    return SinumerikModbus("grinder", url, {**given, **settings}, rogue.clock)


@contextlib.asynccontextmanager
async def at_rogue(rogue: Rogue, *, opened: bool = True, **settings: Any) -> AsyncIterator[SinumerikModbus]:
    """A driver in front of the scripted PLC, for the length of a test."""
    async with serving(rogue) as url:
        device = driver(rogue, url, **settings)
        try:
            if opened:
                await device.open(5.0)
            yield device
        finally:
            await device.close()
