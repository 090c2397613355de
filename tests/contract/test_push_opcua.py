"""The push transaction over OPC UA against the control's double: cross tables, both signs, markers, neighbours."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import TrueflankError
from drivers.types.abilities import Marker
from drivers.types.identity import MachineIdentity
from drivers.types.machine import ChannelStatus
from drivers.types.orders import PushOrder, SignProof
from drivers.types.stops import Stop, StopReached
from drivers.types.tables import CompensationTable, LiveSet
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.recovery_findings import PushFinding
from gateway.push.sign_proof import prove_sign
from gateway.push.transaction import push_table
from simulators.nck import NckSpec
from tests.contract.opcua_stage import AXES, Stage, on_stage, plan
from tests.placed import PLACES, placed
from tests.selftested import passed
from tests.signed import signed
from tests.sizes import few
from tests.steps import lines

SPEC = NckSpec(AXES, cec_points=(0, 10, 12, 10), access_level=2, files_max_bytes=65536)
X_AXIS = AxisRecord("X1", "X", "mm", False, False, (-250.0, 250.0), 0.0, 6000.0, dwell_s=0.2)
Z_AXIS = AxisRecord("Z1", "Z", "mm", False, False, (0.0, 600.0), 0.0, 6000.0, dwell_s=0.2)
C_AXIS = AxisRecord("C1", "C", "deg", True, True, (0.0, 360.0), 0.0, 3600.0, dwell_s=0.2)
WAVE = CompensationTable(
    "cross", "Z1", "X1", 0.0, 400.0, 50.0, (0.0, 3.0, 7.0, 9.0, 5.0, 1.0, -4.0, -2.0, 0.0), index=1
)
TURN = CompensationTable(
    "cross", "C1", "X1", 0.0, 360.0, 45.0, (0.0, 1.0, 2.0, 1.0, 0.0, -1.0, -2.0, -1.0, 0.0), True, 2, "deg"
)
NOTHING = np.zeros(0)


class Folder:
    def __init__(self, path: Path) -> None:
        self.path = path

    def write_text(self, name: str, text: str) -> Path:
        (self.path / name).write_text(text)
        return self.path / name


async def context_for(
    on: Stage, root: Path, proof: SignProof | None = None, moved: AxisRecord | None = Z_AXIS
) -> PushContext:
    """A push of X1, with an operator who presses NC START for whatever is selected."""
    controller = on.device
    machine = await controller.identify()
    controller.keep_to(PLACES)
    return PushContext(
        controller, on.clock, Folder(root), root / "journal", X_AXIS, machine, "mill", "mill",
        proof, start_timeout_s=200.0, input=moved, self_test=passed(machine), approvals_needed=1, risk_taken=True,
    )  # fmt: skip


@contextlib.asynccontextmanager
async def starting(on: Stage) -> AsyncIterator[None]:
    """An operator who presses NC START once for each program that was selected."""

    select, selected = on.nck.select, asyncio.Event()

    def noticing(path: str, channel: int = 1) -> int:
        answer = select(path, channel)
        if answer == 0:
            selected.set()
        return answer

    async def press() -> None:
        while True:
            await selected.wait()
            await on.clock.sleep(0.5)
            if on.nck.channel_status == 0 and not on.nck.booting:
                selected.clear()
                on.nck.nc_start()

    on.nck.select = noticing  # type: ignore[method-assign]
    task = asyncio.get_running_loop().create_task(press())
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        on.nck.select = select  # type: ignore[method-assign]


def proof(on: Stage, sign: int) -> SignProof:
    machine = identity_of(on)
    return SignProof(machine, "cross", "X1", -1.0 * sign, 0.02, 1 if sign > 0 else -1, "2026-11-21T09:00:00+00:00")


def identity_of(on: Stage) -> MachineIdentity:
    names = tuple(axis.name for axis in on.nck.spec.axes)
    return MachineIdentity(on.nck.spec.serial, on.nck.spec.nck_version, names)


def change_of(live: LiveSet, new: CompensationTable, sign: int) -> TableChange:
    old = table_in(signed(live, sign), new)
    return TableChange("X1", old.table, new, old.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)


async def live_of(on: Stage, root: Path) -> LiveSet:
    await on.walk(plan((Stop(0.0, -1),), axis="Z1", letter="Z", unit="mm", rotary=False, output_axis="X1"))
    return await on.device.saved_tables("X1")


@pytest.mark.parametrize("sign", few([-1, 1]))
async def test_cross_tables_one_after_the_other_make_the_machine_move_as_they_say(
    keys: Path, tmp_path: Path, sign: int
) -> None:
    async with on_stage(replace(SPEC, cec_sign=sign), folder=keys) as on:
        base = await live_of(on, tmp_path)
        context = await context_for(on, tmp_path, proof(on, sign))
        async with starting(on):
            first = await push_table(change_of(base, WAVE, sign), context)
            assert first.outcome == "committed", first.steps
            turned = replace(context, input=C_AXIS, pushed=(on.device.table_by(WAVE, context.sense, None),))
            second = await push_table(change_of(base, TURN, sign), turned)
            assert second.outcome == "committed", second.steps
        assert await on.device.marker() == Marker(second.transaction, "committed")
        # The truth: with Z where the table says 9 um of deviation, X stands 9 um less far.
        places: list[float] = []

        async def note(_stop: StopReached) -> None:
            places.append(float(on.nck.encoder("X1", np.array([on.clock.now()]))[0][0]))

        stops = (Stop(0.0, -1, 0, 0), Stop(150.0, 1, 0, 1))
        await on.walk(plan(stops, axis="Z1", letter="Z", unit="mm", rotary=False, output_axis="X1"), note)
        assert places[1] - places[0] == pytest.approx(-0.009, abs=2e-4)
        live = signed(await live_of(on, tmp_path), sign)
        assert [(one.table.index, one.enabled) for one in live.cross] == [(1, True), (2, True)]
        assert live.cross[0].table == WAVE
        assert live.cross[1].table == TURN


@pytest.mark.parametrize("sign", few([-1, 1]))
async def test_the_sign_is_measured_on_the_output_axis(keys: Path, tmp_path: Path, sign: int) -> None:
    async with on_stage(replace(SPEC, cec_sign=sign), folder=keys) as on:
        context = await context_for(on, tmp_path)

        async def read(_stop: Stop) -> tuple[float, float]:
            await on.clock.sleep(1.0)
            here = on.nck.encoder("X1", np.array([on.clock.now()]))[0][0]
            return float(here) * 1000.0, 0.05

        async with starting(on):
            found = await prove_sign(context, 0.0, 400.0, 50.0, lambda: nullcontext(read), kind="cross", index=1)
        assert (found.sign, found.kind, found.output_axis) == (sign, "cross", "X1")
        assert found.slope == pytest.approx(-sign, abs=0.05)
        assert (await live_of(on, tmp_path)).cross == ()
        left = await on.device.marker()
        assert left is not None
        assert left.state == "none"


async def test_a_mismatch_leads_back_and_the_neighbour_works_again(keys: Path, tmp_path: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        context = await context_for(on, tmp_path, proof(on, 1))
        async with starting(on):
            base = await live_of_running(on)
            assert (await push_table(change_of(base, TURN, 1), replace(context, input=C_AXIS))).outcome == "committed"
            base = await live_of_running(on)
            kept = on.nck.core.memory.kept
            calls: list[float] = []

            def wrong(value: float) -> float:
                calls.append(value)
                return float(kept(value)) + (2e-6 if len(calls) == 6 else 0.0)

            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(type(on.nck.core.memory), "kept", staticmethod(wrong))
                record = await push_table(change_of(base, WAVE, 1), context)
            assert record.outcome == "rolled-back", record.steps
            assert any("E-NC-MISMATCH" in step for step in lines(record))
            after = await live_of_running(on)
            assert after.cross == base.cross
            assert after.cross[0].enabled


def _new_point(on: Stage) -> None:
    on.nck.set("$AN_CEC[1,1]", 0.004, 0)


def _neighbour(on: Stage) -> None:
    on.nck.set("$AN_CEC[3,1]", 0.004, 0)


def _own_table(on: Stage) -> None:
    on.nck.set("$AA_ENC_COMP[0,1,X1]", 0.002, 0)


def _backlash(on: Stage) -> None:
    on.nck.set("$MA_BACKLASH[0,X1]", 0.002, 0)


@pytest.mark.parametrize("change", [_new_point, _neighbour, _own_table, _backlash])
async def test_what_somebody_changed_before_the_press_is_never_overwritten(
    keys: Path, tmp_path: Path, change: Callable[[Stage], None]
) -> None:
    """The program stands after its back-up until that is what was read: nothing was switched, moved or written."""
    async with on_stage(SPEC, folder=keys) as on:
        for index in (1, 3):
            for name, value in (("STEP", 50.0), ("MIN", 0.0), ("MAX", 100.0)):
                on.nck.set(f"$AN_CEC_{name}[{index}]", value, 0)
            on.nck.set(f"$AN_CEC_INPUT_AXIS[{index}]", "Z1", 0)
            on.nck.set(f"$AN_CEC_OUTPUT_AXIS[{index}]", "X1", 0)
        for name, value in (("STEP", 50.0), ("MIN", 0.0), ("MAX", 100.0)):
            on.nck.set(f"$AA_ENC_COMP_{name}[0,X1]", value, 0)
        base, said = await live_of(on, tmp_path), list[str]()

        def say(code: str, /, **_fields: object) -> None:
            said.append(code)
            if code == "P-PUSH-START":
                change(on)

        context = replace(await context_for(on, tmp_path, proof(on, 1)), say=say, read=base)
        await on.clock.sleep(float(on.nck.core.move({on.nck.core.axis("Z1").index: 40.0}, None)) + 0.5)
        async with starting(on):
            with pytest.raises(VerifyError, match="E-PUSH-LOST-UPDATE"):
                await push_table(change_of(base, WAVE, 1), context)
        assert said.count("P-NC-READ") == 0  # what was read a moment before is compared, not read once more
        assert on.nck.axis_state("Z1").set_position == 40.0
        assert (await on.device.state()).channel is ChannelStatus.RESET
        left = await on.device.marker()
        assert left is not None
        assert left.state == "none"
        assert unfinished_tables(tmp_path / "journal", context.machine.serial) == ()
        assert not on.nck.get("$MA_CEC_ENABLE[X1]")
        assert on.nck.get("$AN_CEC_MAX[1]") == 100.0
        found = await live_of(on, tmp_path)
        assert found.digest != base.digest  # the other's change is still there


async def live_of_running(on: Stage) -> LiveSet:
    """The live tables while `starting` presses the button."""
    plan_of_one = plan((Stop(0.0, -1),), axis="Z1", letter="Z", unit="mm", rotary=False, output_axis="X1")
    await on.device.prepare_stops(plan_of_one)
    counter = 0
    while (stop := await on.device.wait_stop(counter, 120.0)) is not None:
        counter = stop.counter
        await on.device.release_stop(counter)
    return await on.device.saved_tables("X1")


async def test_tables_that_would_wake_up_with_the_axis_switch_stop_the_program(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        for name, value in (("STEP", 50.0), ("MIN", 0.0), ("MAX", 100.0)):
            on.nck.set(f"$AN_CEC_{name}[2]", value, 0)
        on.nck.set("$AN_CEC_INPUT_AXIS[2]", "C1", 0)
        on.nck.set("$AN_CEC_OUTPUT_AXIS[2]", "X1", 0)
        on.nck.set("$AN_CEC[2,1]", 0.004, 0)
        on.nck.set("$SN_CEC_TABLE_ENABLE[2]", 1, 0)
        order = PushOrder(4711, WAVE, "Z", False, True, 0.0, "table", proof(on, 1))
        with pytest.raises(TrueflankError) as caught:
            await on.loaded(order)
        assert caught.value.code == "E-NC-WAKES"
        assert on.nck.get("$AN_CEC_STEP[1]") == 0.0
        assert (await on.device.state()).channel is ChannelStatus.RESET


async def test_the_marker_outlives_session_and_programs_until_it_is_recovered(keys: Path, tmp_path: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        base = await live_of(on, tmp_path)
        context = replace(await context_for(on, tmp_path, proof(on, 1)), start_timeout_s=20.0)
        on.restarts = False
        async with starting(on):
            record = await push_table(change_of(base, WAVE, 1), context)
        assert record.outcome == "held-on", record.steps
        await on.device.close()
        elsewhere = tmp_path / "another-pc"
        elsewhere.mkdir()
        other = placed(on.driver())
        await other.open(5.0)
        marker = await other.marker()
        assert marker is not None
        assert marker.state == "held"
        stranger = replace(context, controller=other, journals=elsewhere / "journal")
        refused = await push_table(change_of(base, WAVE, 1), stranger)
        assert any(step.startswith("E-INT-MARKER") for step in lines(refused)), refused.steps
        on.nck.channel_reset()
        on.restarts = True
        (found,) = unfinished_tables(tmp_path / "journal", context.machine.serial)
        mine = replace(context, controller=other, start_timeout_s=200.0)
        async with starting(on):
            finding = await inspect_unfinished(found, mine)
            assert finding.action == "restore", finding
            told: list[PushFinding] = []
            heard: list[str] = []
            mine = replace(mine, say=lambda code, /, **fields: heard.append(code))
            assert (await recover_table(found, mine, tell=told.append)).outcome == "rolled-back"
        assert told == [finding]
        assert [heard.count(code) for code in ("P-NC-READ", "P-PUSH-START")] == [
            2,
            1,
        ]  # before, between and after: 3 presses
        marker = await other.marker()
        assert marker is not None
        assert marker.state == "none"
        await other.close()


async def test_limits_of_a_cross_table_come_from_its_own_machine_data(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        limits = await on.device.table_limits("X1", "cross", 2)
        assert (limits.reserved_points, limits.max_sum) == (12, 1.0)
        assert (await on.device.table_limits("X1", "cross", 0)).reserved_points == 0
        assert (await on.device.table_limits("X1")).max_sum is None
        assert on.device.capabilities.stops
        order = PushOrder(1, WAVE, "Z", False, True, 0.0, "table", proof(on, 1))
        for head in (0, 1, 0xFEDC_BA98_7654_3210, 2**64 - 1):
            await on.device.finish_push((replace(order, transaction=987_600_001, head=head),), "committed")
            marker = await on.device.marker()
            assert marker == Marker(987_600_001, "committed")
            assert marker.head == head
        with pytest.raises(TrueflankError) as caught:
            await on.device.switch(order, True, 1.0)
        assert caught.value.code == "E-NC-NO-SWITCHING"
