"""Set-up values into the numbers of the builder's cycle: refused, killed in between, read back wrong, and taken back.

The judge is the control's own memory: all old or all new, or a held transaction that says that nobody knows.
"""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import DeadlineExceeded, TrueflankError
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from gateway.domain.grinding_process import HeldValue, SetupProof
from gateway.errors import StoreError, WriteRefused
from gateway.push import SetupContext, hand_over_setup, restore_setup, setup_history, unfinished_setup
from gateway.push.journal import Journal
from simulators.nck import Nck
from tests.push.uaworld import UaWorld, ua_world
from tests.push.world import NAME

X = HeldValue("x", "R210", "mm", 12.5)
SIDE = HeldValue("dressing", "R211", "um", -4.0)
OLD = {210: -160.01, 211: 3.0}
NEW = {210: -160.01 + 0.0125, 211: 7.0}  # the dressing offset counts the other way: proved so below
Work = Callable[[UaWorld, SinumerikOpcUa, SetupContext, tuple[SetupProof, ...]], Awaitable[Any]]


def numbers(nck: Nck) -> dict[int, float]:
    return {one: float(nck.get(f"R[{one}]")) for one in OLD}  # type: ignore[arg-type]


def at_a_control(tmp_path: Path, keys: Path, work: Work, **options: Any) -> Any:
    async def main() -> Any:
        clock = LoopClock()
        async with ua_world(clock, keys) as at:
            for number, value in OLD.items():
                at.nck.set(f"R[{number}]", value, 0)
            device = at.driver()
            await device.open(5.0)
            try:
                machine = await device.identify()
                proofs = tuple(
                    SetupProof(machine, one.name, one.place, one.unit, sense, float(sense), 0.02, "2026-01-01")  # type: ignore[arg-type]
                    for one, sense in ((X, 1), (SIDE, -1))
                )
                given = {"risk_taken": True, "typed_name": NAME, **options}
                context = SetupContext(device, clock, tmp_path / "journal", machine, site_name=NAME, **given)
                return await work(at, device, context, proofs)
            finally:
                await device.close()

    return run_virtual(main)


def test_the_numbers_change_in_the_proved_sense_and_go_back(tmp_path: Path, keys: Path) -> None:
    told: list[int] = []

    async def work(at: UaWorld, _device: Any, context: SetupContext, proofs: tuple[SetupProof, ...]) -> None:
        context = replace(context, announce=lambda number, _values: told.append(number))
        done = await hand_over_setup((X, SIDE), proofs, context, part="p1")
        assert (done.outcome, done.part) == ("committed", "p1")
        assert numbers(at.nck) == pytest.approx(NEW, abs=1e-12)
        back = await restore_setup(context)
        assert (back.outcome, back.undoes) == ("committed", done.transaction)
        assert numbers(at.nck) == OLD
        with pytest.raises(WriteRefused) as caught:
            await restore_setup(context)
        assert caught.value.code == "E-HAND-NOTHING"
        assert told == [done.transaction, back.transaction]
        assert len(setup_history(context.journals, context.machine.serial)) == 2

    at_a_control(tmp_path, keys, work)


def test_nothing_is_written_against_any_reason(tmp_path: Path, keys: Path) -> None:
    async def work(at: UaWorld, _device: Any, context: SetupContext, proofs: tuple[SetupProof, ...]) -> None:
        async def refused(values: Any, senses: Any, asked: SetupContext) -> str:
            with pytest.raises(TrueflankError) as caught:
                await hand_over_setup(values, senses, asked)
            assert numbers(at.nck) == OLD
            said = caught.value.fields.get("reasons", ())
            return " ".join(one.code for one in said) if said else caught.value.code  # type: ignore[attr-defined]

        assert await refused((X, SIDE), proofs[:1], context) == "E-HAND-SENSE"
        other = replace(proofs[0], unit="um")
        assert await refused((X,), (other,), context) == "E-HAND-SENSE"
        elsewhere = replace(proofs[0], machine=replace(context.machine, serial="another"))
        assert await refused((X,), (elsewhere,), context) == "E-HAND-SENSE"
        assert await refused((replace(X, added=200.1),), proofs, context) == "E-HAND-LIMIT"
        shared = replace(SIDE, place=X.place)
        known = (proofs[0], replace(proofs[0], name=SIDE.name, unit=SIDE.unit))
        assert await refused((X, shared), known, context) == "E-HAND-SHARED"
        assert await refused((X,), proofs, replace(context, typed_name="miller")) == "E-INT-NAME"
        assert await refused((X,), proofs, replace(context, risk_taken=False)) == "E-INT-RISK"
        assert await refused((X,), proofs, replace(context, approvals_needed=2)) == "E-HAND-PEOPLE"
        assert await refused((X,), proofs, replace(context, audit_broken="line 3")) == "E-INT-AUDIT-BROKEN"
        both = replace(context, typed_name="", audit_broken="line 3")
        assert await refused((X,), proofs, both) == "E-INT-NAME E-INT-AUDIT-BROKEN"
        assert await refused((replace(X, place="R85"),), proofs, context) == "E-HELD-OURS"
        assert await refused((replace(X, place="R99999"),), proofs, context) == "E-HELD-PLACE"
        datum = "/NC/_N_AX_TEA_ACX/$MA_MM_ENC_COMP_MAX_POINTS[u1,1]"
        assert await refused((replace(X, place=datum),), proofs, context) == "E-HELD-PLACE"

        async def log_full(_number: int, _values: Any) -> None: ...

        def no_log(_number: int, _values: Any) -> None:
            raise StoreError("E-STORE-DISK", "audit", why="full")

        assert await refused((X,), proofs, replace(context, announce=no_log)) == "E-STORE-DISK"
        assert unfinished_setup(context.journals, context.machine.serial) is None

    at_a_control(tmp_path, keys, work)


class Killed(BaseException):
    """Nothing behind it runs but what the language forces to."""


def test_killed_at_every_step_it_is_old_or_new_and_the_way_back_is_open(
    tmp_path: Path, keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    append = Journal.append
    steps: list[str] = []
    at_step = -1

    def tick(name: str) -> None:
        steps.append(name)
        if len(steps) - 1 == at_step:
            monkeypatch.setattr(Journal, "append", dead)
            raise Killed(name)

    def dead(_self: Journal, kind: str, **_facts: object) -> None:
        raise Killed(kind)

    def appending(self: Journal, kind: str, **facts: object) -> None:
        tick(f"< {kind}")
        append(self, kind, **facts)
        tick(f"> {kind}")

    async def work(at: UaWorld, device: Any, context: SetupContext, proofs: tuple[SetupProof, ...]) -> list[str]:
        nonlocal at_step
        hold = device.hold_values

        async def holding(values: Any) -> None:
            tick("< write")
            await hold(values)
            tick("> write")

        device.hold_values = holding
        found = []
        while True:
            steps.clear()
            at_step += 1
            monkeypatch.setattr(Journal, "append", appending)
            with contextlib.suppress(Killed):
                await hand_over_setup((X, SIDE), proofs, context)
            last = steps[-1]
            seen = numbers(at.nck)
            assert seen in (pytest.approx(OLD, abs=1e-12), pytest.approx(NEW, abs=1e-12)), last
            monkeypatch.setattr(Journal, "append", append)
            left = unfinished_setup(context.journals, context.machine.serial)
            found.append(f"{last}: {'new' if seen[211] > 5.0 else 'old'}, {'open' if left else 'ended'}")
            if len(steps) <= at_step:
                assert left is None
                assert seen == pytest.approx(NEW, abs=1e-12)
                return found
            if left is not None:
                with pytest.raises(WriteRefused) as caught:
                    await hand_over_setup((X,), proofs, context)
                assert [one.code for one in caught.value.fields["reasons"]] == ["E-HAND-UNFINISHED"]  # type: ignore[attr-defined]
            if left is not None or seen != OLD:
                back = await restore_setup(context)
                assert back.outcome in ("rolled-back", "committed")
            assert numbers(at.nck) == OLD
            assert unfinished_setup(context.journals, context.machine.serial) is None

    found = at_a_control(tmp_path, keys, work)
    assert {"> write: new, open", "< write: old, open", "> COMMITTED: new, ended"} <= set(found)


def test_a_number_read_back_otherwise_leads_back_or_is_held(tmp_path: Path, keys: Path) -> None:
    async def work(at: UaWorld, device: Any, context: SetupContext, proofs: tuple[SetupProof, ...]) -> None:
        hold = device.hold_values
        whims: list[Callable[[dict[str, float]], dict[str, float]]] = [lambda v: {k: round(x, 2) for k, x in v.items()}]

        async def rounding(values: dict[str, float]) -> None:
            await hold(whims.pop(0)(values) if whims else values)

        device.hold_values = rounding
        done = await hand_over_setup((X, SIDE), proofs, context)
        assert (done.outcome, done.reasons[0].code) == ("rolled-back", "E-HAND-DIFFERS")
        assert numbers(at.nck) == OLD

        async def late(values: dict[str, float]) -> None:
            await hold({"R210": values["R210"]})  # half of it, and no answer
            raise DeadlineExceeded("E-UA-DEADLINE", "840D", what="write", timeout_s=5.0)

        device.hold_values = late
        done = await hand_over_setup((X, SIDE), proofs, context)
        # The way back meets the same wire, but what it wrote is what had been changed.
        assert done.outcome == "rolled-back"
        assert numbers(at.nck) == OLD

        async def stuck(values: dict[str, float]) -> None:
            if values["R210"] != OLD[210]:
                await hold({"R210": values["R210"]})

        device.hold_values = stuck
        done = await hand_over_setup((X, SIDE), proofs, context)
        assert done.outcome == "held"
        assert numbers(at.nck)[210] == pytest.approx(NEW[210])
        device.hold_values = hold
        at.nck.set("R[211]", 99.0, 0)
        with pytest.raises(WriteRefused) as caught:
            await restore_setup(context)
        assert caught.value.code == "E-HAND-FOREIGN"
        at.nck.set("R[211]", OLD[211], 0)
        assert (await restore_setup(context)).outcome == "rolled-back"
        assert numbers(at.nck) == OLD

    at_a_control(tmp_path, keys, work)


def test_what_somebody_wrote_since_is_not_written_over(tmp_path: Path, keys: Path) -> None:
    async def work(at: UaWorld, _device: Any, context: SetupContext, proofs: tuple[SetupProof, ...]) -> None:
        await hand_over_setup((X,), proofs, context)
        at.nck.set("R[210]", -160.0, 0)
        with pytest.raises(WriteRefused) as caught:
            await restore_setup(context)
        assert caught.value.code == "E-HAND-FOREIGN"
        assert numbers(at.nck)[210] == -160.0

    at_a_control(tmp_path, keys, work)
