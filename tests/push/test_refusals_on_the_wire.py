"""Every rule that refuses, met by a real driver on a real wire: not one request that could change the machine."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.types.tables import CompensationTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange, TableFinding
from gateway.errors import BusyError
from gateway.interlocks import refusals
from gateway.push import controller_access
from gateway.push.context import PushContext
from gateway.push.journal import Journal, machine_folder, machine_lock
from gateway.push.transaction import push_table
from simulators.modbus import registers
from tests.push.mischief import Mischief
from tests.push.oracle import content_of
from tests.push.uaworld import ua_change, ua_context, ua_world
from tests.push.world import OTHER, Scene, World, change_of, context_for, table, world
from tests.steps import lines
from tests.unit.interlocks.test_every_code import ALL

# Nothing but looking: a selection, a session, a read-back, and the heart-beat beside them.
LOOKING = {1: "open", 7: "read back", 9: "close", 11: "select"}


@dataclass
class Counted(Mischief):
    """A sound wire that keeps every request which could change the machine."""

    changing: list[bytes] = field(default_factory=list)

    def asked(self, data: bytes) -> bytes:
        """A request passes."""
        address = int.from_bytes(data[8:10], "big")
        beat = data[7] == 6 and address == registers.PC_HEARTBEAT
        looks = data[7] == 16 and address == registers.COMMAND and int.from_bytes(data[13:15], "big") in LOOKING
        if data[7] != 3 and not beat and not looks:
            self.changing.append(data)
        return super().asked(data)


@dataclass
class Case:
    """What a push is to be made with; a rule's edit turns one thing wrong."""

    at: World
    change: TableChange
    context: PushContext
    root: Path
    order: Any = None


Edit = Callable[[Case], None]


def machine(**changes: Any) -> Edit:
    def edit(case: Case) -> None:
        case.context = replace(case.context, machine=replace(case.context.machine, **changes))

    return edit


def context(**changes: Any) -> Edit:
    def edit(case: Case) -> None:
        case.context = replace(case.context, **changes)

    return edit


def new(wanted: CompensationTable) -> Edit:
    def edit(case: Case) -> None:
        case.change = replace(case.change, new=wanted)

    return edit


def change(**changes: Any) -> Edit:
    def edit(case: Case) -> None:
        case.change = replace(case.change, **changes)

    return edit


def control(act: Callable[[World], Any]) -> Edit:
    def edit(case: Case) -> None:
        act(case.at)

    return edit


def proof(**changes: Any) -> Edit:
    def edit(case: Case) -> None:
        assert case.context.proof is not None
        case.context = replace(case.context, proof=replace(case.context.proof, **changes))

    return edit


def points(*values: float, **changes: Any) -> Edit:
    return new(replace(table(*values), **changes))


def unfinished(case: Case) -> None:
    folder = machine_folder(case.context.journals, case.context.machine.serial)
    folder.mkdir(parents=True)
    left = Journal.create(folder, 123)
    left.append("LEASED", axis="X1")
    left.close()


def foreign_marker(at: World) -> None:
    at.station.plc.memory.marker = (0x3737, 0x3737, 0, 0, 0, 0, 0, 0)
    at.station.plc.memory.marker_state = 1


def other_table(at: World) -> None:
    """Somebody has loaded another table since."""
    held = at.nck.core.memory.eec[0, 0]
    held.points = list(content_of(OTHER, len(held.points)).points)


def running(at: World) -> None:
    """Somebody has started a program."""
    path = "/_N_MPF_DIR/_N_OTHER_MPF"
    at.nck.files.write(path, b"G4 F600\nM30\n")
    at.nck.select(path)
    at.nck.nc_start()


def far(case: Case) -> None:
    """The axis travels."""
    case.at.nck.set_mode("JOG")
    case.at.nck.core.move({0: 90.0}, 60.0)


SHAPE = (0.0, 3.0, 7.0, 5.5, 2.0, 0.0, -3.0, -6.0, -7.25, -4.125, 0.0)
NAN = float("nan")
RULES: dict[str, tuple[str, Edit]] = {
    "another serial": ("E-INT-MACHINE", machine(serial="SN-9")),
    "another software": ("E-INT-MACHINE", machine(version="V1")),
    "other axes": ("E-INT-MACHINE", machine(axis_names=("X1", "Q1"))),
    "channel active": ("E-INT-CHANNEL", control(running)),
    "mode": ("E-INT-MODE", context(modes=("MDA",))),
    "alarm": ("E-INT-ALARM", control(lambda at: at.nck.drive_alarm(300504, "drive fault"))),
    "emergency stop": ("E-INT-ALARM", control(lambda at: at.nck.drive_alarm(3000, "emergency stop"))),
    "not referenced": ("E-INT-REFERENCE", control(lambda at: at.nck.lose_reference("X1"))),
    "moving": ("E-INT-MOVING", far),
    "key at 7": ("E-INT-ACCESS", control(lambda at: at.nck.set_access_level(7))),
    "no name": ("E-INT-NAME", context(typed_name="")),
    "another name": ("E-INT-NAME", context(typed_name="Mill")),
    "an unfinished push": ("E-INT-UNFINISHED", unfinished),
    "somebody else's push": ("E-INT-MARKER", control(foreign_marker)),
    "no proof": ("E-INT-NO-PROOF", context(proof=None)),
    "a proof of the other function": ("E-INT-NO-PROOF", proof(kind="cross")),
    "a proof of another axis": ("E-INT-NO-PROOF", proof(output_axis="Z1")),
    "a proof of the wrong sign": ("E-INT-SIGN", proof(sign=-1, slope=1.0)),
    "a weak proof": ("E-INT-BAD-PROOF", proof(slope=-1.4)),
    "an unsure proof": ("E-INT-BAD-PROOF", proof(slope_u=0.4)),
    "no base": ("E-INT-NO-BASE", change(base_digest="")),
    "changed since": ("E-INT-LOST-UPDATE", control(other_table)),
    "switched since": ("E-INT-LOST-UPDATE", control(lambda at: at.nck.set("$MA_ENC_COMP_ENABLE[0,X1]", 0, 0))),
    "backlash changed since": ("E-INT-LOST-UPDATE", control(lambda at: at.nck.set("$MA_BACKLASH[0,X1]", 0.01, 0))),
    "too many points": ("E-INT-POINTS", points(*SHAPE[:5], *(0.0,) * 5, *SHAPE[5:])),
    "step does not divide": ("E-INT-GRID", points(*SHAPE, step=17.0)),
    "maximum below minimum": ("E-INT-GRID", points(*SHAPE, minimum=90.0, maximum=-90.0)),
    "step zero": ("E-INT-GRID", points(*SHAPE, step=0.0)),
    "no number": ("E-INT-FINITE", points(*SHAPE[:3], NAN, *SHAPE[4:])),
    "infinite": ("E-INT-FINITE", points(*SHAPE[:3], float("inf"), *SHAPE[4:])),
    "too large": ("E-INT-VALUE", points(0.0, 0.0, 0.0, 201.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    "too steep": ("E-INT-SLOPE", points(0.0, 0.0, 0.0, 30.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    "too much at once": ("E-INT-CHANGE", points(0.0, 0.0, 0.0, 130.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    "not zero at the reference": ("E-INT-REF-VALUE", points(*(value + 0.5 for value in SHAPE))),
    "nowhere near zero": ("E-INT-NOWHERE", points(*(value + 20.0 for value in SHAPE))),
    "a modulo table that does not close": ("E-INT-MODULO", points(*SHAPE[:-1], 2.0, modulo=True)),
    "a modulo table that is no turn": ("E-INT-TURN", points(*SHAPE, modulo=True)),
    "another output axis": ("E-INT-OTHER-AXIS", points(*SHAPE, output_axis="Z1")),
    "another unit": ("E-INT-UNIT", points(*SHAPE, output_unit="deg")),
    "two people wanted": ("E-INT-APPROVAL-MISSING", context(approvals_needed=2)),
    "a broken audit": ("E-INT-AUDIT-BROKEN", context(audit_broken="entry 7 was altered")),
    "a finding": ("E-INT-FINDING", change(findings=(TableFinding.older("E-COMP-GAP: a point is missing"),))),
}


async def refused(at: World, counted: Counted, root: Path, edit: Edit) -> PushRecord:
    """The record of a push with one thing wrong, and nothing else on the wire than looking."""
    device = at.driver()
    await device.open(5.0)
    base = await device.saved_tables("X1")
    made = context_for(at.scene, device, at.clock, root, await device.identify(), say=_silent)
    case = Case(at, change_of(at.scene, base), made, root)
    edit(case)
    before = at.oracle.content
    at.oracle.writes = 0
    counted.changing.clear()
    record = await push_table(case.change, case.context)
    await device.close()
    assert counted.changing == []
    assert (at.oracle.content, at.oracle.writes) == (before, 0)
    return record


def _silent(_code: str, /, **_fields: object) -> None:
    """Nobody hears."""


def on_the_wire(scene: Scene, root: Path, edit: Edit) -> PushRecord:
    async def main() -> PushRecord:
        clock = LoopClock()
        counted = Counted(clock, random.Random(0))
        async with world(scene, clock, counted.around) as at:
            return await refused(at, counted, root, edit)

    return run_virtual(main)


@pytest.mark.parametrize("name", list(RULES))
def test_refused_with_nothing_but_looking_on_the_wire(tmp_path: Path, name: str) -> None:
    code, edit = RULES[name]
    record = on_the_wire(Scene(), tmp_path, edit)
    assert record.outcome == "refused"
    assert code in {step.split(":")[0] for step in lines(record)}, record.steps


def test_an_inch_machine_is_refused(tmp_path: Path) -> None:
    record = on_the_wire(Scene(nck={"unit_system": "inch"}), tmp_path, lambda _case: None)
    assert record.outcome == "refused"
    assert "E-INT-INCH" in {step.split(":")[0] for step in lines(record)}


def test_a_second_gateway_is_told_who_is_at_work(tmp_path: Path) -> None:
    def edit(case: Case) -> None:
        held.enter_context(machine_lock(machine_folder(case.context.journals, case.context.machine.serial)))

    with contextlib.ExitStack() as held, pytest.raises(BusyError) as caught:
        on_the_wire(Scene(), tmp_path, edit)
    assert "process" in str(caught.value.fields["holder"])


@pytest.fixture
def met(monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], None]:
    """Let the next push meet these facts, whatever the machine says."""

    def meet(facts: Any) -> None:
        async def found(*_args: Any, **_more: Any) -> Any:
            return facts

        monkeypatch.setattr(controller_access, "read_facts", found)

    return meet


def test_every_rule_there_is_on_the_mailbox(tmp_path: Path, met: Callable[[Any], None]) -> None:
    told: set[str] = set()

    async def main() -> None:
        clock = LoopClock()
        counted = Counted(clock, random.Random(0))
        async with world(Scene(), clock, counted.around) as at:
            for number, (code, facts) in enumerate(ALL):
                if code == "E-INT-NOTHING":
                    continue
                met(facts)
                record = await refused(at, counted, tmp_path / str(number), lambda _case: None)
                assert record.outcome == "refused"
                assert [step.split(":")[0] for step in lines(record)] == [one.code for one in refusals(facts)]
                told.add(code)

    run_virtual(main)
    assert len(told) >= 55
    assert len(ALL) + len(RULES) >= 60


def test_every_rule_there_is_over_opcua(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, met: Callable[[Any], None]
) -> None:
    told: set[str] = set()
    keys = tmp_path_factory.mktemp("server-keys")

    async def main() -> None:
        clock = LoopClock()
        async with ua_world(clock, keys) as at:
            device = at.driver()
            await device.open(5.0)
            base = await at.base(device)
            made = ua_context(device, clock, tmp_path, await device.identify())
            changing, before, at.oracle.writes = at.server.requests.changing, at.oracle.content, 0
            for code, facts in ALL:
                if code == "E-INT-NOTHING":
                    continue
                met(facts)
                record = await push_table(ua_change(base, at.new), made)
                assert record.outcome == "refused"
                assert at.server.requests.changing == changing, code
                told.add(code)
            assert (at.oracle.content, at.oracle.writes) == (before, 0)
            await device.close()

    run_virtual(main)
    assert len(told) >= 55


def test_the_machine_as_it_stands_over_opcua(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Refused by what the control itself says, before a program is sent."""
    keys = tmp_path_factory.mktemp("server-keys")
    acts: dict[str, Callable[[Any], Any]] = {
        "E-INT-ALARM": lambda nck: nck.drive_alarm(300504, "drive fault"),
        "E-INT-MODE": lambda nck: nck.change_mode_by_hand(),
        "E-INT-ACCESS": lambda nck: nck.set_access_level(7),
        "E-INT-REFERENCE": lambda nck: nck.lose_reference("X1"),
    }

    async def main(code: str) -> None:
        clock = LoopClock()
        async with ua_world(clock, keys) as at:
            device = at.driver()
            await device.open(5.0)
            base = await at.base(device)
            made = ua_context(device, clock, tmp_path / code, await device.identify())
            changing, at.oracle.writes = at.server.requests.changing, 0
            acts[code](at.nck)
            await clock.sleep(1.0)
            record = await push_table(ua_change(base, at.new), made)
            assert code in {step.split(":")[0] for step in lines(record)}
            assert at.server.requests.changing == changing
            assert at.oracle.writes == 0
            await device.close()

    for code in acts:
        run_virtual(partial(main, code))


def test_a_cross_table_without_proof_never_reaches_the_wire(tmp_path: Path) -> None:
    record = on_the_wire(Scene(cross=True), tmp_path, context(proof=None))
    assert record.outcome == "refused"
    assert "E-INT-NO-PROOF" in {step.split(":")[0] for step in lines(record)}
