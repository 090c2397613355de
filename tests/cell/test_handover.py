"""Approve, push, compare, take back: the commands around a push on a simulated machine, and the log they leave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.types.orders import SignProof
from gateway import audit
from gateway.approve import Approvals
from gateway.config import load_site
from gateway.domain.proposals import Proposal
from gateway.errors import WriteRefused
from gateway.push.transaction import push_table
from gateway.say import silence
from gateway.store import Store
from gateway.workflow.complete_run import run_site
from gateway.workflow.control.disable import disable_site
from gateway.workflow.control.push import approve_plan, show_plan
from gateway.workflow.control.rollback import roll_back_site
from gateway.workflow.control.verify import verify_table
from gateway.workflow.results.endings import select_tables
from gateway.workflow.run import audit_trail, stages
from gateway.workflow.run.context import open_context
from gateway.workflow.run.folder import store_of
from gateway.workflow.run.outcome import Outcome
from gateway.workflow.run.push_context import push_context
from simulators.cell import Cell
from simulators.cell.backdoor import BackDoor
from tests.cell.bench import short
from tests.selftested import cell_running


class Story:
    """One cell, one site and what is done to it; the machine's clock is virtual."""

    def __init__(self, cell: Cell, clock: LoopClock) -> None:
        self.cell, self.clock, self.path = cell, clock, cell.site_path
        source = self.path.with_name("c1.rta")
        cell.write_result_file("C1", source)
        edit = short(("C1",), 24, 2, file=str(source), file_datum=0.0, file_unit="mrad", accept=["machine=YK7350B"])
        self.path.write_text(edit(self.path.read_text(encoding="utf-8")), encoding="utf-8")
        self.site = load_site(self.path)
        self.root = store_of(self.site, self.path).root
        self.asked: dict[str, Any] = {"clock": clock, "say": silence}

    async def propose(self) -> None:
        made = await run_site(self.site, self.path, apply=False, machine_name="", **self.asked)
        self.folder = Store(self.root).open(made.run_folder)

    async def push(self, actor: str) -> str:
        change = self.folder.get(stages.PROPOSAL, Proposal).changes[0]
        async with open_context(self.site, self.path, self.folder, self.clock, silence) as at:
            moment = datetime.now(UTC).isoformat()
            proof = SignProof(at.machine, "axis", "C1", -1.0, 0.01, 1, moment)
            taken = audit_trail.consume_approvals(
                at, select_tables(self.folder.get(stages.PROPOSAL, Proposal), ("C1",))
            )
            context = audit_trail.with_consent(at, change, push_context(at, at.axis("C1"), None), taken[change.name])
            context = replace(context, actor=actor, proof=proof, approvals_needed=2)
            audit_trail.record_start(at, change, context)
            record = await push_table(change, context)
            assert audit_trail.record_end(at, change, record) == ""
        return record.outcome

    def runs(self) -> set[str]:
        """The run folders of the store."""
        return {run.run_id for run in Store(self.root).runs()}

    async def compare(self) -> Outcome:
        return await verify_table(self.site, self.path, table="C1", run=None, **self.asked)

    async def take_back(self, *, apply: bool) -> Outcome:
        name = self.site.site.name if apply else ""
        asked = {"apply": apply, "machine_name": name, **self.asked}
        return await roll_back_site(self.site, self.path, table="C1", **asked)

    async def switch_off(self, *, apply: bool, machine_name: str = "") -> Outcome:
        name = machine_name or (self.site.site.name if apply else "")
        asked = {"axis": "C1", "table": "", "apply": apply, "machine_name": name, **self.asked}
        return await disable_site(self.site, self.path, **asked)

    async def foreign_edit(self, point: int) -> None:
        """Somebody with a manufacturer's rights turns one value round, and back the next time."""
        name, switch = f"$AA_ENC_COMP[0,{point},C1]", "$MA_ENC_COMP_ENABLE[0,C1]"
        value = float(self.cell.nck.get(name))
        orders: list[dict[str, Any]] = [
            {"set": "variable", "name": switch, "value": 0},
            {"set": "nck_reset"},
            {"set": "variable", "name": name, "value": -value},
            {"set": "variable", "name": switch, "value": 1},
            {"set": "nck_reset"},
            *({"set": "reference", "axis": axis.name} for axis in self.cell.file.axes),
            {"set": "mode", "value": "AUTO"},
        ]
        for order in orders:
            assert await BackDoor(self.cell).answer(order) == {"done": True}, order
            await self.clock.sleep(120.0 if order["set"] == "nck_reset" else 0.0)
        await self.clock.sleep(60.0)  # no NC START is taken before every axis is referenced

    async def tables(self) -> Any:
        return await BackDoor(self.cell).answer({"ask": "tables"})


def told(tmp_path: Path, story: Callable[[Story], Any]) -> Any:
    async def job() -> Any:
        clock = LoopClock()
        async with cell_running("demo", tmp_path / "cell", clock, wires="memory", block_s=1.0, seed=3) as cell:
            return await story(Story(cell, clock))

    return run_virtual(job)


async def switched_off(at: Story) -> None:
    """Shown, refused without the name, done, and said again when it is off already; every value stays."""
    before, runs = (await at.tables())["tables"]["C1"], at.runs()
    looked = await at.switch_off(apply=False)
    assert (at.runs(), looked.run_folder) == (runs, "")
    assert (looked.data["enabled"], looked.data["off"], looked.data["refusals"]) == (True, False, [])
    assert (await at.tables())["tables"]["C1"] == before
    with pytest.raises(WriteRefused) as caught:
        await at.switch_off(apply=True, machine_name="another")
    assert caught.value.code == "E-RUN-NAME"
    done = await at.switch_off(apply=True)
    assert (done.data["outcome"], done.data["after"]) == ("off", 0.0)
    assert (await at.tables())["tables"]["C1"] == {**before, "enabled": False}
    assert (await at.compare()).data["kind"] == "switched-off"
    assert (await at.switch_off(apply=True)).data["outcome"] == "already-off"
    actions = [entry["action"] for entry in audit.read_entries(at.root)]
    done = ["disable-start", "disable-off", "table-differs", "verify-table-looked"]
    assert actions[-6:] == [*done, "disable-start", "disable-already-off"]


def test_approved_pushed_compared_taken_back(tmp_path: Path) -> None:
    async def story(at: Story) -> None:
        await at.propose()
        untouched = await at.tables()
        shown = await show_plan(at.folder, **at.asked)
        assert any("360.000" in str(line) for line in shown.points)
        assert [row[0] for row in shown.rows] == ["C1", "C1-reversal"]
        with pytest.raises(WriteRefused):
            await approve_plan(at.folder, table="C1", typed_name="another", clock=at.clock, actor="ann")
        given = await approve_plan(at.folder, table="C1", typed_name=at.site.site.name, clock=at.clock, actor="ann")
        assert await at.tables() == untouched
        assert Approvals(at.folder.path).read_unused() == given
        assert await at.push("bob") == "committed"
        assert Approvals(at.folder.path).read_unused() == ()

        runs = at.runs()
        live = await at.compare()
        assert (live.exit_code, live.data["kind"], live.run_folder) == (0, "as-approved", "")
        assert (await at.take_back(apply=False)).data["refusals"] == []
        assert at.runs() == runs
        await switched_off(at)
        await at.foreign_edit(7)
        live = await at.compare()
        assert (live.exit_code, live.data["kind"]) == (9, "differs")
        assert any(name.startswith("live-tables") for name in Store(at.root).open(live.run_folder).files)
        assert "at 1 of " in str(live.lines[1])
        (alarm,) = audit.read_log_state(at.root, at.site.controller.serial).alarms.values()
        assert "neither the approved nor" in str(alarm)
        edited = await at.tables()
        with pytest.raises(WriteRefused) as caught:
            await at.take_back(apply=True)
        assert "E-PUSH-UNDO-FOREIGN" in str(caught.value)
        assert await at.tables() == edited
        await at.foreign_edit(7)
        every = await verify_table(at.site, at.path, table="", run=None, **at.asked)
        assert (every.exit_code, [one["axis"] for one in every.data["tables"]]) == (0, ["C1"])
        assert audit.read_log_state(at.root, at.site.controller.serial).alarms == {}

        assert (await at.take_back(apply=True)).data["outcome"] == "committed"
        assert (await at.compare()).data["kind"] == "as-approved"
        back, first = (await at.tables())["tables"]["C1"], untouched["tables"]["C1"]
        assert (back["values"], back["enabled"]) == (first["values"], first["enabled"])
        with pytest.raises(WriteRefused) as caught:
            await at.take_back(apply=True)
        assert caught.value.code == "E-ROLLBACK-NOTHING"

        look, done = "verify-table-looked", [entry["action"] for entry in audit.read_entries(at.root)]
        assert done == [
            *("propose", "propose", "push-looked", "approve", "approval-used"),  # one of two is taken
            *("push-start", "push-begun", "push-ending", "push-committed"),
            *("table-as-pushed", look, "rollback-looked"),
            *("disable-looked", "disable-start", "disable-off", "table-differs", look, "disable-start"),
            *("disable-already-off", "table-differs", look),
            *("rollback-start", "push-begun", "rollback-refused", "table-as-pushed", look),
            *("rollback-start", "push-begun", "push-ending", "rollback-committed", "table-as-pushed", look),
        ]
        given_by, used, start = list(audit.read_entries(at.root))[3:6]
        assert used["details"]["approval"] == given_by["details"]["approval"]
        assert given_by["actor"] == "ann"
        assert (start["actor"], start["details"]["approved_by"]) == (audit.os_user(), "ann")
        assert given_by["plan_hash"] == start["plan_hash"]
        assert audit.is_sound(at.root)

    told(tmp_path, story)
