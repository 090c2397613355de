"""What is signed is what is sent: `program` prints, byte for byte, what a run and a push send to the control."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError
from drivers.programs import DayNumbers
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable
from gateway.capture.targets import targets_of
from gateway.config import AxisSection, load_site
from gateway.domain.proposals import Proposal, TableChange
from gateway.push.compare import table_in
from gateway.say import silence
from gateway.tooth import SetupValues
from gateway.workflow.axes.measure import fetch_tables
from gateway.workflow.complete_run import run_site
from gateway.workflow.control.disable import disable_site
from gateway.workflow.control.push import apply_proposal
from gateway.workflow.programs import PrintedProgram, programs
from gateway.workflow.run import audit_trail, stages
from gateway.workflow.run.context import RunContext, open_context
from gateway.workflow.run.folder import new_run, store_of
from gateway.workflow.run.paper_control import ProgramKind
from gateway.workflow.run.self_test import self_test_site
from gateway.workflow.tooth.grinding import grind_site
from simulators.cell import Cell, cell_running
from simulators.cellfile import CellFile, load_cell, with_plan
from tests.sizes import few

NOTHING = np.zeros(0)
GRIDS = {"Z1": (0.0, 300.0, 30.0, "mm"), "C1": (0.0, 360.0, 45.0, "deg")}


def number_of(site_path: Path, text: str) -> int:
    """The number that a program was sent with: it shows it in the eighth of its R parameters."""
    first = int(load_site(site_path).controller.settings.get("r_first", 80))
    found = re.search(rf"^R{first + 7}=(\d+)$", text, re.MULTILINE)
    assert found is not None
    return int(found[1])


def sent(site_path: Path, purpose: str) -> list[str]:
    """Programs that went to the control in the newest runs, oldest first."""
    root = store_of(load_site(site_path), site_path).root
    return [path.read_text(encoding="utf-8") for path in sorted(root.rglob(f"sent-*-{purpose}_*"))]


async def until_sent(site_path: Path, purpose: str, work: Awaitable[object], *, says: str = "") -> str:
    """Do the work until it has sent a program of this purpose which says this; then it is stopped."""
    task, before = asyncio.ensure_future(work), len(sent(site_path, purpose))
    while not any(says in text for text in sent(site_path, purpose)[before:]):
        if task.done():
            await task
            raise AssertionError("it ended and sent nothing")
        await LoopClock().sleep(0.5)
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError, Exception):
        await task
    found = [text for text in sent(site_path, purpose)[before:] if says in text]
    return found[0]  # what comes after it ends the program


def printed(site_path: Path, what: ProgramKind, text: str, proposal: Proposal | None = None) -> list[PrintedProgram]:
    """What `program` prints with the number of the program that was sent."""
    return list(
        programs(
            load_site(site_path), site_path, (what,), proposal, numbers=DayNumbers(order=number_of(site_path, text))
        )
    )


def table(source: str, index: int) -> CompensationTable:
    low, high, step, unit = GRIDS[source]
    count = round((high - low) / step) + 1
    values = [0.0, *(round(2.0 * np.sin(place), 3) for place in range(1, count - 1)), 0.0]
    grid = {"modulo": unit == "deg", "index": index, "input_unit": unit}
    return CompensationTable("cross", source, "X1", low, high, step, tuple(map(float, values)), **grid)  # type: ignore[arg-type]


async def proposed(at: RunContext) -> Proposal:
    """Two cross tables of X whose sense is proved, in the first places that are free."""
    live = await fetch_tables(at, at.axis("X1"))
    first = len([one for one in live.cross if one.enabled])
    tables = (table("Z1", first), table("C1", first + 1))
    changes = tuple(
        TableChange("X1", table_in(live, one).table, one, False, live.digest, NOTHING, NOTHING, NOTHING, base=live)
        for one in tables
    )
    at.proofs.save(SignProof(at.machine, "cross", "X1", -1.0, 0.01, 1, at.clock.utc().isoformat()))
    return Proposal(at.machine, changes, (), at.clock.utc().isoformat())


def builders() -> CellFile:
    """The demo machine with a table of its builder on: it too moves X as Z goes."""
    file = load_cell("demo")
    curve = {"kind": "polynomial", "coefficients": [0.0, 1.0], "center": 150.0, "scale": 150.0}
    one = {"input": "Z1", "output": "X1", "minimum": 0.0, "maximum": 300.0, "step": 50.0, "values": [curve]}
    return CellFile.model_validate(file.model_dump() | {"machine": file.machine.model_dump() | {"cross": [one]}})


def at_a_cell(folder: Path, job: Callable[[Cell, LoopClock], Awaitable[None]], *, file: CellFile | None = None) -> None:
    async def main() -> None:
        clock = LoopClock()
        async with cell_running(file or load_cell("demo"), folder, clock, wires="memory", block_s=1.0) as cell:
            path = cell.site_path
            await self_test_site(load_site(path), path, axis="", clock=clock, say=silence)
            await job(cell, clock)

    run_virtual(main)


def test_a_run_sends_what_program_prints_and_the_self_test_is_printed_too(tmp_path: Path) -> None:
    async def job(cell: Cell, clock: LoopClock) -> None:
        path = cell.site_path
        for text in sent(path, "TFSELF"):
            assert text in [one.program.text for one in printed(path, "self-test", text)]
        run = run_site(load_site(path), path, apply=False, machine_name="", clock=clock, say=silence)
        text = await until_sent(path, "TFMEAS", run)
        one, *_ = printed(path, "measure", text)
        assert one.program.text == text
        assert "IF $AA_IM[Y1]" in text  # the dresser's axis, which is no axis of the site, is guarded
        assert "$AN_CEC" in text

    at_a_cell(tmp_path, job)


@pytest.mark.parametrize("beside", few([True, False]))
def test_a_push_sends_what_program_prints(tmp_path: Path, beside: bool) -> None:
    """Two tables at once, alone on their output and beside one that must be on again at the end."""

    async def job(cell: Cell, clock: LoopClock) -> None:
        path = cell.site_path
        site = load_site(path)
        folder = new_run(site, path)
        async with open_context(site, path, folder, clock, silence) as at:
            proposal = await proposed(at)
            folder.put(stages.PROPOSAL, proposal)
            assert audit_trail.record_proposal(at, proposal) == ""
            text = await until_sent(path, "TFPUSH", apply_proposal(at, proposal, {}))
        (one,) = printed(path, "load", text, proposal)
        assert one.program.text == text
        assert "UTABLE2[0]=SET(" in text
        assert ("GOTOF TF_WAKES" in text) != beside

    at_a_cell(tmp_path, job, file=builders() if beside else None)


def test_a_part_and_an_order_to_switch_off_are_sent_as_printed(
    tmp_path: Path,
) -> None:
    async def job(cell: Cell, clock: LoopClock) -> None:
        path = cell.site_path
        site = load_site(path)
        name, asked = site.site.name, {"clock": clock, "say": silence}
        part = grind_site(site, path, part="part", setup=SetupValues(), machine_name=name, **asked)
        text = await until_sent(path, "TFGRIND", part)
        (one,) = printed(path, "grind", text)
        assert one.program.text == text
        assert "UDEPTH[0]=SET(" in text

        cell.nck.set("$MA_ENC_COMP_ENABLE[0,C1]", 1, 0)
        await disable_site(site, path, axis="C1", table="", apply=True, machine_name=name, **asked)
        told = await disable_site(site, path, axis="C1", table="", apply=False, machine_name="", **asked)
        assert (len(told.lines), told.data["off"]) == (1, True)  # nothing is left that --apply could switch off
        with pytest.raises(ConfigError, match="E-DISABLE-TABLE"):
            await disable_site(site, path, axis="X1-cec9", table="", apply=False, machine_name="", **asked)
        (text,) = sent(path, "TFOFF")
        assert text in [one.program.text for one in printed(path, "off", text)]

    at_a_cell(tmp_path, job, file=with_plan(load_cell("demo")))


@pytest.mark.long
@pytest.mark.parametrize("what", ["proof", "load"])
def test_a_sign_proof_and_the_layer_of_axis_tables_are_sent_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: ProgramKind
) -> None:
    monkeypatch.setattr("gateway.workflow.control.push.verification_plans", lambda *_, **__: [])  # nothing was measured

    async def job(cell: Cell, clock: LoopClock) -> None:
        text, proposal = await pushed(cell.site_path, "Z1", clock, proved=what == "load")
        assert text in [one.program.text for one in printed(cell.site_path, what, text, proposal)]
        assert "$AA_ENC_COMP" in text

    at_a_cell(tmp_path, job)


async def pushed(path: Path, axis: str, clock: LoopClock, *, proved: bool) -> tuple[str, Proposal]:
    """The first program of a push of one table of an axis, whose sense is proved first or known."""
    site = load_site(path)
    async with open_context(site, path, new_run(site, path), clock, silence) as at:
        change = await own_table(at, axis)
        if proved:
            at.proofs.save(SignProof(at.machine, "axis", axis, -1.0, 0.01, 1, at.clock.utc().isoformat()))
        proposal = Proposal(at.machine, (change,), (), at.clock.utc().isoformat())
        at.folder.put(stages.PROPOSAL, proposal)
        assert audit_trail.record_proposal(at, proposal) == ""
        return await until_sent(path, "TFPUSH", apply_proposal(at, proposal, {})), proposal


def compensated(cell: Cell, axis: AxisSection) -> None:
    """A table of its own is on for an axis: 0 but for a rise of 8 um in its first half."""
    grid, name = axis.table, axis.name
    count = round((grid.maximum - grid.minimum) / grid.step) + 1
    values = [0.008 if count // 8 < place < count // 3 else 0.0 for place in range(count)]
    of_grid = {"STEP": grid.step, "MIN": grid.minimum, "MAX": grid.maximum}
    for word, value in of_grid.items():
        cell.nck.set(f"$AA_ENC_COMP_{word}[0,{name}]", value, 0)
    for place, value in enumerate(values):
        cell.nck.set(f"$AA_ENC_COMP[0,{place},{name}]", value, 0)
    cell.nck.set(f"$MA_ENC_COMP_ENABLE[0,{name}]", 1, 0)


async def own_table(at: RunContext, name: str) -> TableChange:
    """A table of its own for an axis."""
    axis = at.axis(name)
    live, grid = await fetch_tables(at, axis), axis.table
    count = round((grid.maximum - grid.minimum) / grid.step) + 1
    values = (0.0, *(round(2.0 * np.sin(place), 3) for place in range(1, count - 1)), 0.0)
    new = CompensationTable("axis", name, name, grid.minimum, grid.maximum, grid.step, tuple(map(float, values)))
    old, targets = table_in(live, new), targets_of(axis)
    return TableChange(name, old.table, new, old.enabled, live.digest, targets, NOTHING, NOTHING, base=live)


@pytest.mark.parametrize("own", few([True, False]))
def test_the_proof_of_effect_and_what_follows_it_are_sent_as_printed(tmp_path: Path, own: bool) -> None:
    """Behind an axis' own table it is measured again, and the tables of the next layer are read; behind those nothing.

    The table that is replaced helps to choose where the control is asked: beside none the places are others.
    """

    async def job(cell: Cell, clock: LoopClock) -> None:
        path = cell.site_path
        site = load_site(path)
        if own:
            compensated(cell, site.axes[0])
        folder = new_run(site, path)
        async with open_context(site, path, folder, clock, silence) as at:
            proposal = await proposed(at)
            if own:
                at.proofs.save(SignProof(at.machine, "axis", "X1", -1.0, 0.01, 1, at.clock.utc().isoformat()))
                proposal = replace(proposal, changes=(await own_table(at, "X1"), *proposal.changes))
            folder.put(stages.PROPOSAL, proposal)
            assert audit_trail.record_proposal(at, proposal) == ""
            known = len(sent(path, "TFMEAS"))
            text = await until_sent(path, "TFMEAS", apply_proposal(at, proposal, {}), says="TFEFFECT")
        assert text in [one.program.text for one in printed(path, "effect", text, proposal)]
        assert ("TFSENSEX" in text) == own
        first = proposal.changes[0]
        assert first.old_enabled == own
        never = replace(proposal, changes=(replace(first, old_enabled=False), *proposal.changes[1:]))
        assert (text in [one.program.text for one in printed(path, "effect", text, never)]) != own
        before, *_ = [each for each in sent(path, "TFMEAS")[known:] if "TFEFFECT" not in each]
        of: ProgramKind = "backup" if own else "effect"
        assert before in [one.program.text for one in printed(path, of, before, proposal)]
        assert "tables that were live before" in text

    at_a_cell(tmp_path, job, file=builders())


async def cross_table(at: RunContext, one: CompensationTable) -> TableChange:
    """A cross table in a free place, of an output axis whose sense is proved."""
    live = await fetch_tables(at, at.axis(one.output_axis))
    at.proofs.save(SignProof(at.machine, "cross", one.output_axis, -1.0, 0.01, 1, at.clock.utc().isoformat()))
    old = table_in(live, one)
    return TableChange(one.output_axis, old.table, one, old.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)


def standing_still() -> CellFile:
    """The demo machine with absolute encoders: no axis is driven to its reference after a restart."""
    file = load_cell("demo").model_dump()
    return CellFile.model_validate(file | {"axes": [axis | {"absolute_encoder": True} for axis in file["axes"]]})


def along_z(index: int, output: str, high: float, *, low: float) -> CompensationTable:
    """A cross table over Z that is 4 um or arcsec in one part of the travel and zero outside it."""
    values = tuple(4.0 if low <= 30.0 * place <= high else 0.0 for place in range(11))
    units: dict[str, Any] = {"input_unit": "mm", "output_unit": "deg" if output == "C1" else "mm"}
    return CompensationTable("cross", "Z1", output, 0.0, 300.0, 30.0, values, index=index, **units)


@pytest.mark.long
def test_a_layer_in_three_transactions_is_sent_as_printed(tmp_path: Path) -> None:
    """Each table may be switched at a place of Z where the next one may not: so each is a transaction of its own.

    The last one is switched beside the first of the same output axis, which is on by then.
    """

    async def job(cell: Cell, clock: LoopClock) -> None:
        path = cell.site_path
        kept = path.read_text(encoding="utf-8")
        path.write_text(re.sub(r"\bZ1 = \[[^]]*\]", "Z1 = [60.0, 240.0]", kept, count=1), encoding="utf-8")
        await cell.operator.jog("Z1", 150.0)
        site = load_site(path)
        assert site.moves.places.ranges["Z1"] == (60.0, 240.0)
        folder = new_run(site, path)
        async with open_context(site, path, folder, clock, silence) as at:
            first, last = along_z(0, "X1", 120.0, low=30.0), along_z(2, "X1", 120.0, low=30.0)
            changes = [await cross_table(at, one) for one in (first, along_z(1, "C1", 270.0, low=150.0), last)]
            proposal = Proposal(at.machine, tuple(changes), (), at.clock.utc().isoformat())
            folder.put(stages.PROPOSAL, proposal)
            assert audit_trail.record_proposal(at, proposal) == ""
            known = len(sent(path, "TFMEAS"))
            await apply_proposal(at, proposal, {})
        loads = sent(path, "TFPUSH")
        assert ["GOTOF TF_WAKES" in text for text in loads] == [True, True, False]
        for place, text in enumerate(loads):
            assert text == printed(path, "load", text, proposal)[place].program.text
        read = sent(path, "TFMEAS")[known:]
        assert len([text for text in read if "TFEFFECT" in text]) == 3
        for text in read:
            both = [*printed(path, "effect", text, proposal), *printed(path, "backup", text, proposal)]
            assert text in [one.program.text for one in both]

    at_a_cell(tmp_path, job, file=standing_still())
