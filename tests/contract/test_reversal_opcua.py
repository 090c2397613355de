"""The constant reversal over OPC UA against the control's double: sign, push, the control's factor, the way back."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import TrueflankError
from drivers.types.orders import SignProof
from drivers.types.stops import Stop
from drivers.types.tables import reversal_of
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.push import PushContext, prove_sign, push_table
from tests.contract.opcua_stage import Stage, on_stage
from tests.contract.test_push_opcua import NOTHING, SPEC, context_for, identity_of, live_of_running, starting
from tests.sizes import few

NEW = reversal_of("X1", "mm", -2.4)


def proof(on: Stage) -> SignProof:
    return SignProof(identity_of(on), "reversal", "X1", -1.0, 0.02, 1, "2026-11-21T09:00:00+00:00")


async def pushed(on: Stage, root: Path, value: float = -2.4, **facts: Any) -> PushRecord:
    context = replace(await context_for(on, root, proof(on), None), **facts)
    live = await live_of_running(on)
    old = live.reversal
    new = reversal_of("X1", "mm", value)
    change = TableChange("X1", old.table, new, old.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)
    return await push_table(change, context)


def lead(on: Stage, way: int) -> float:
    """How far the encoder goes ahead of the machine part after travel this way, um: the control's own truth."""
    return 1000.0 * on.nck.core._setpoints.take_up(0).total(way)


@pytest.mark.long
async def test_a_reversal_acts_as_documented_and_is_taken_back(keys: Path, tmp_path: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on, starting(on):
        record = await pushed(on, tmp_path)
        assert record.outcome == "committed", record.steps
        # An axis that stays 2.4 um behind when it comes from the other side: the encoder must lead by as much.
        assert on.nck.get("$MA_BACKLASH[0,X1]") == pytest.approx(0.0024, abs=1e-9)
        assert lead(on, 1) - lead(on, -1) == pytest.approx(2.4, abs=1e-6)
        assert on.nck.get("$MA_BACKLASH_MODE[0,X1]") == 2, "no cross table may take it up where the axis stands"
        again = await pushed(on, tmp_path)
        assert again.outcome == "already-applied"
        other = await pushed(on, tmp_path, 1.0)
        assert other.outcome == "committed", other.steps
        assert on.nck.get("$MA_BACKLASH[0,X1]") == pytest.approx(-0.001, abs=1e-9)


async def test_the_factor_of_the_control_is_no_part_of_the_reversal(keys: Path, tmp_path: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on, starting(on):
        on.nck.set("$MA_BACKLASH_FACTOR[0,X1]", 2.0, 0)
        told: list[tuple[str, object]] = []
        say = lambda code, /, **fields: told.append((code, fields.get("axis")))  # noqa: E731
        assert (await pushed(on, tmp_path, say=say)).outcome == "committed"
        assert ("P-PUSH-END", "X1-reversal") in told, "X1 is the axis' table"
        assert on.nck.get("$MA_BACKLASH[0,X1]") == pytest.approx(0.0012, abs=1e-9)
        assert lead(on, 1) - lead(on, -1) == pytest.approx(2.4, abs=1e-6)
        live = await live_of_running(on)
        assert live.reversal.table.deviations == pytest.approx((-2.4,))


@pytest.mark.parametrize("before", few([0.004, 0.0], 1))
async def test_a_reversal_that_is_not_released_leads_back(keys: Path, tmp_path: Path, before: float) -> None:
    async with on_stage(SPEC, folder=keys) as on, starting(on):
        on.nck.set("$MA_BACKLASH[0,X1]", before, 0)
        device: Any = on.device
        enabled = device.confirm

        async def once(batch: Any, timeout_s: float) -> Any:
            if batch[0].purpose == "table":
                on.nck.channel_reset()
            return await enabled(batch, timeout_s)

        device.confirm = once
        record = await pushed(on, tmp_path)
        assert record.outcome == "rolled-back", record.steps
        assert on.nck.get("$MA_BACKLASH[0,X1]") == pytest.approx(before, abs=1e-9)


@pytest.mark.long
async def test_a_reversal_that_is_locked_is_told_and_changes_nothing(keys: Path, tmp_path: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on, starting(on):
        on.nck.set("$MA_BACKLASH[0,X1]", 0.004, 0)
        on.nck.set_access_level(3)
        record = await pushed(on, tmp_path, access_level_needed=4)
        assert record.outcome in ("rolled-back", "held-on"), record.steps
        assert on.nck.get("$MA_BACKLASH[0,X1]") == pytest.approx(0.004, abs=1e-9)


async def sign_of(on: Stage, context: PushContext, turn: float = 1.0) -> SignProof:
    async def read(_stop: Stop) -> tuple[float, float]:
        await on.clock.sleep(1.0)
        here = on.nck.encoder("X1", np.array([on.clock.now()]))[0][0]
        return turn * float(here) * 1000.0, 0.05

    return await prove_sign(context, 0.0, 400.0, 50.0, lambda: nullcontext(read), kind="reversal")


@pytest.mark.long
async def test_the_sign_of_a_reversal_is_measured_from_both_sides(keys: Path, tmp_path: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on, starting(on):
        on.nck.set("$MA_BACKLASH[0,X1]", 0.001, 0)
        context = replace(await context_for(on, tmp_path, None, None), proof=None)
        found = await sign_of(on, context)
        assert (found.kind, found.sign) == ("reversal", 1)
        assert on.nck.get("$MA_BACKLASH[0,X1]") == pytest.approx(0.001, abs=1e-9)


@pytest.mark.parametrize(
    ("hostile", "code"),
    few([({"backlash_sign": -1}, "E-PUSH-SIGN"), ({"backlash_activation": "nck_reset"}, "E-PUSH-NO-PROOF")], 1),
    ids=str,
)
async def test_a_control_that_does_not_do_as_its_manual_says_gets_no_reversal(
    keys: Path, tmp_path: Path, hostile: dict[str, Any], code: str
) -> None:
    async with on_stage(replace(SPEC, **hostile), folder=keys) as on, starting(on):
        context = replace(await context_for(on, tmp_path, None, None), proof=None)
        with pytest.raises(TrueflankError) as caught:
            await sign_of(on, context)
        assert caught.value.code == code
        assert on.nck.get("$MA_BACKLASH[0,X1]") == 0.0
