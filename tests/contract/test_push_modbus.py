"""The push transaction over the PLC mailbox, a road without programs: the operator jogs, the panel agrees."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.types.abilities import Marker
from drivers.types.orders import SignProof
from drivers.types.stops import Stop
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from gateway.push.sign_proof import prove_sign
from gateway.push.transaction import push_table
from tests.contract.modbus_stage import Stage, cross, on_stage, table
from tests.placed import PLACES
from tests.signed import signed
from tests.sizes import few

X_AXIS = AxisRecord("X1", "X", "mm", False, False, (-190.0, 340.0), 0.0, 6000.0)
C_AXIS = AxisRecord("C1", "C", "deg", True, True, (0.0, 360.0), 0.0, 3600.0)
NOTHING = np.zeros(0)


class Folder:
    def __init__(self, path: Path) -> None:
        self.path = path

    def write_text(self, name: str, text: str) -> Path:
        (self.path / name).write_text(text)
        return self.path / name


@contextlib.asynccontextmanager
async def people(
    on: Stage, root: Path, proof: SignProof | None, moved: AxisRecord | None
) -> AsyncIterator[PushContext]:
    """A context with somebody who jogs where MSG says and presses the panel's button when it lights."""
    asked: list[tuple[str, float]] = []

    def say(code: str, /, **fields: Any) -> None:
        if code == "P-PUSH-JOG":
            asked.append((str(fields["axis"]), float(fields["position"]) + 0.002))

    async def work() -> None:
        while True:
            await on.bench.clock.sleep(0.3)
            on.plc.confirm()
            while asked:
                axis, position = asked.pop()
                await on.bench.clock.sleep(_jog(on, axis, position) + 0.5)

    task = asyncio.get_running_loop().create_task(work())
    on.device.keep_to(PLACES)
    try:
        yield PushContext(
            on.device, on.bench.clock, Folder(root), root / "journal", X_AXIS, await on.device.identify(), "mill",
            "mill", proof, start_timeout_s=120.0, say=say, input=moved, approvals_needed=1, risk_taken=True,
        )  # fmt: skip
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


def _jog(on: Stage, axis: str, position: float) -> float:
    """Seconds until the axis is there."""
    nck = on.bench.nck
    assert nck.set_mode("JOG")
    return float(nck.core.move({nck.core.axis(axis).index: position}, None))


def change_of(live: LiveSet, new: CompensationTable, sign: int = 1) -> TableChange:
    old = table_in(signed(live, sign), new)
    return TableChange("X1", old.table, new, old.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)


async def proof_of(on: Stage, function: Any, sign: Any = 1) -> SignProof:
    machine = await on.device.identify()
    return SignProof(machine, function, "X1", -1.0 * sign, 0.01, sign, "2026-01-01T00:00:00+00:00")


@pytest.mark.parametrize("sign", few([-1, 1]))
async def test_an_axis_own_table_and_a_cross_table_one_after_the_other(tmp_path: Path, sign: int) -> None:
    async with on_stage(spec={"cec_sign": sign}) as on:
        base = await on.device.saved_tables("X1")
        own, other = table(), cross()
        async with people(on, tmp_path, await proof_of(on, "axis"), None) as context:
            first = await push_table(change_of(base, own), context)
            assert first.outcome == "committed", first.steps
            proof = await proof_of(on, "cross", sign)
            turned = replace(context, input=C_AXIS, proof=proof, pushed=(own,))
            second = await push_table(change_of(base, other, sign), turned)
            assert second.outcome == "committed", second.steps
        live = signed(await on.device.saved_tables("X1"), sign)
        assert live.own == LiveTable(own, enabled=True)
        assert live.cross == (LiveTable(other, enabled=True),)
        assert on.get("$AN_CEC[0,9]") == pytest.approx(sign * 0.004)
        assert await on.device.marker() == Marker(second.transaction, "committed")
        assert len(first.effect) == len(second.effect) == 3


@pytest.mark.parametrize("sign", few([-1, 1]))
async def test_the_sign_is_measured_while_the_panel_switches(tmp_path: Path, sign: int) -> None:
    async with on_stage(spec={"cec_sign": sign}) as on:

        async def read(_stop: Stop) -> tuple[float, float]:
            await on.bench.clock.sleep(1.0)
            here = on.bench.nck.encoder("X1", np.array([on.bench.clock.now()]))[0][0]
            return float(here) * 1000.0, 0.05

        async with people(on, tmp_path, None, C_AXIS) as context:
            found = await prove_sign(context, 0.0, 360.0, 10.0, lambda: nullcontext(read), kind="cross", index=1)
        assert (found.sign, found.kind, found.output_axis) == (sign, "cross", "X1")
        assert found.slope == pytest.approx(-sign, abs=0.05)
        left = (await on.device.saved_tables("X1")).cross
        assert not any(one.enabled or any(one.table.deviations) for one in left)
        assert await on.device.marker() == Marker(0, "none")


async def test_nobody_at_the_panel_leads_back_or_is_held_but_never_enabled(tmp_path: Path) -> None:
    async with on_stage() as on:
        base = await on.device.saved_tables("X1")
        async with people(on, tmp_path, await proof_of(on, "axis"), None) as context:
            on.plc.confirm = lambda: False
            record = await push_table(change_of(base, table()), context)
        assert record.outcome in ("rolled-back", "held"), record.steps
        assert not (await on.device.saved_tables("X1")).own.enabled
