"""The push transaction over LinuxCNC: the same steps, a person's restart, and the column of each direction at work."""

from __future__ import annotations

import asyncio
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.errors import TransportError, TrueflankError
from drivers.linuxcnc.device import LinuxCnc
from drivers.types.abilities import Marker
from drivers.types.stops import Stop, StopPlan
from gateway.errors import VerifyError
from gateway.push import inspect_unfinished, prove_sign, push_table, recover_table, unfinished_tables
from tests.contract.linuxcnc_pushing import BENT, change_of, person
from tests.contract.linuxcnc_stage import on_stage
from tests.steps import lines


async def test_a_table_acts_after_the_restart_in_each_direction_by_its_column(tmp_path: Path) -> None:
    (tmp_path / "host").mkdir()
    async with on_stage(tmp_path / "host") as on:
        heard: list[str] = []
        async with person(on, tmp_path, heard) as context:
            record = await push_table(change_of(await on.device.saved_tables("X"), BENT), context)
            assert record.outcome == "committed", record.steps
            assert heard.count("P-PUSH-NEXT-START") == 1
        assert await on.device.marker() == Marker(record.transaction, "committed")
        on.machine.move(0, 0.0)
        on.machine.move(0, 250.0)
        assert on.machine.trim[0] == pytest.approx(-0.0045, abs=1e-12)
        on.machine.move(0, 150.0)
        assert on.machine.trim[0] == pytest.approx(-0.0055, abs=1e-12)


async def test_after_a_gateway_that_died_before_the_restart_the_old_table_comes_back(tmp_path: Path) -> None:
    (tmp_path / "host").mkdir()
    async with on_stage(tmp_path / "host") as on:
        heard: list[str] = []
        async with person(on, tmp_path, heard) as context:
            first = replace(BENT, deviations=(0.0, 1.0, 2.0, 1.0, 0.0), reverse=())
            record = await push_table(change_of(await on.device.saved_tables("X"), first), context)
            assert record.outcome == "committed", record.steps
            before = await on.device.saved_tables("X")
            dying = asyncio.ensure_future(push_table(change_of(before, BENT), context))
            heard.append("away")
            while (tmp_path / "host" / "x.comp").read_text() == before.native:
                assert not dying.done(), dying.result().steps
                await on.clock.sleep(0.05)
            dying.cancel()
            await asyncio.gather(dying, return_exceptions=True)
            on.new_agent()
            assert on.machine.rows[0][1][1] == -0.001  # the old table acts until the restart
            (work,) = unfinished_tables(context.journals, context.machine.serial)
            assert (await inspect_unfinished(work, context)).code == "R-PUSH-WAITS"
            assert (await recover_table(work, context)).outcome == "rolled-back"  # nobody needs to restart for that
            assert heard.count("P-PUSH-NEXT-START") == 2
            live = await on.device.saved_tables("X")
            assert live.digest == before.digest
            assert (tmp_path / "host" / "x.comp").read_text() == before.native


async def test_where_nobody_restarts_nothing_unproved_waits_for_the_next_start(tmp_path: Path) -> None:
    (tmp_path / "host").mkdir()
    async with on_stage(tmp_path / "host") as on:
        heard = ["away"]
        async with person(on, tmp_path, heard) as context:
            base = await on.device.saved_tables("X")
            record = await push_table(change_of(base, BENT), context)
            assert record.outcome == "rolled-back", "\n".join(lines(record))
            marker = await on.device.marker()
            assert marker is not None
            assert marker.state == "none"
            on.machine.restart()
            assert not on.machine.rows[0]


async def test_a_run_of_stops_is_counted_released_and_ended(tmp_path: Path) -> None:
    stops = (Stop(0.0, 1, 0, 0), Stop(100.0, 1, 0, 1), Stop(100.0, -1, 1, 1), Stop(0.0, -1, 1, 0))
    moves: dict[str, float] = {"feed": 6000.0, "overrun": 2.0, "dwell_s": 0.1}
    plan = StopPlan("TFMEASX", "X", "X", "mm", rotary=False, stops=stops, setup="mount (the) optics", **moves)  # type: ignore[arg-type]
    async with on_stage(tmp_path) as on:
        await on.device.prepare_stops(plan)
        assert "(MSG, mount [the] optics)" in on.machine.shown()
        on.machine.cycle_start()
        for number, stop in enumerate(stops, 1):
            found = await on.device.wait_stop(number - 1, 5.0)
            assert found is not None
            assert (found.counter, found.target, found.approach, found.label) == (
                number,
                stop.target,
                stop.approach,
                stop.label,
            )
            assert on.machine.position[0] == stop.target
            await on.device.release_stop(number)
        assert await on.device.wait_stop(len(stops), 5.0) is None
        await on.device.prepare_stops(plan)
        on.machine.cycle_start()
        assert await on.device.wait_stop(0, 5.0) is not None
        await on.device.abort_program()
        assert await on.device.wait_stop(1, 5.0) is None


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        ("edited", "E-LCNC-EDITED"),
        ("token", "E-LCNC-TOKEN"),
        ("kinematics", "E-LCNC-KINS"),
        ("down", "E-LCNC-DOWN"),
        ("linked", "E-LCNC-PIN"),
    ],
)
async def test_what_cannot_be_trusted_is_refused_by_name(tmp_path: Path, spoil: str, code: str) -> None:
    async with on_stage(tmp_path) as on:
        if spoil == "edited":
            on.machine.life = replace(on.machine.life, began_s=0.0)  # type: ignore[type-var]
        elif spoil == "token":
            on.token.write_text("another-token-0123")
        elif spoil == "kinematics":
            on.machine.ini_path.write_text(on.machine.ini_path.read_text().replace("XYA", "XXA"))
            on.machine.restart()
        elif spoil == "down":
            on.machine.stop()
        else:
            on.machine.linked.add("motion.digital-in-00")
        device = on.other()
        try:
            with pytest.raises(TrueflankError) as caught:
                await _used(device)
            assert caught.value.code == code
            assert isinstance(caught.value, TransportError) == (spoil == "down")
        finally:
            await device.close()


async def _used(device: LinuxCnc) -> None:
    """Open, read, write."""
    await device.open(5.0)
    await device.saved_tables("X")
    await device.abort_program()


@pytest.mark.parametrize("direction", [1.0, pytest.param(-1.0, marks=pytest.mark.long)])
async def test_a_sign_is_proved_by_the_same_stops_before_and_after_a_restart(tmp_path: Path, direction: float) -> None:
    """What acted before counts in; the old file is back at the end, also where the axis moves the wrong way."""
    (tmp_path / "host").mkdir()
    async with on_stage(tmp_path / "host") as on:
        (tmp_path / "host" / "x.comp").write_text("0 0 0\n400 -0.008 -0.008\n")
        on.machine.restart()
        heard: list[str] = []

        async def read_stop(stop: Stop) -> tuple[float, float]:
            """A laser that lost its datum at the restart: the slide stands where screw and trim put it."""
            trim = direction * on.machine.trim[0] * 1e3
            return 7.0 * on.machine.starts + 0.01 * stop.target + trim, 0.01

        async with person(on, tmp_path, heard) as context:
            base = await on.device.saved_tables("X")
            proving = prove_sign(context, 0.0, maximum=400.0, step=50.0, reading=lambda: nullcontext(read_stop))
            if direction > 0.0:
                proof = await proving
                assert (proof.sign, proof.slope) == (1, pytest.approx(-1.0, abs=1e-6))
            else:
                with pytest.raises(VerifyError) as caught:
                    await proving
                assert caught.value.code == "E-PUSH-SIGN"
            assert heard.count("P-PUSH-SIGN-STOPS") == heard.count("P-PUSH-NEXT-START") == 2
            assert (await on.device.saved_tables("X")).own == base.own
        assert unfinished_tables(context.journals, context.machine.serial) == ()
