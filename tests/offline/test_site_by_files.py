"""A whole site without a wire, by what the commands call: proposal, self-test, push, compare, go back."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError
from drivers.offline_exchange import PieceOfWork, ToCarry, exchange_files_for
from drivers.types.orders import SignProof
from gateway import audit
from gateway.config import SiteFile, load_site
from gateway.domain.proposals import Proposal
from gateway.say import silence
from gateway.store import RunFolder, Store
from gateway.store.machine_books import ProofBook
from gateway.supervisor import DevicesFailed
from gateway.workflow.complete_run import run_site
from gateway.workflow.control.push import push_run
from gateway.workflow.control.rollback import roll_back_site
from gateway.workflow.control.verify import verify_table
from gateway.workflow.run import stages
from gateway.workflow.run.folder import store_of
from gateway.workflow.run.push_context import push_by_files
from gateway.workflow.run.self_test import self_test_site
from simulators.cell import Cell, cell_running
from tests.cell.bench import short
from tests.selftested import machine_of

Done = TypeVar("Done")
MOST = 12


class Site:
    """A cell whose operator carries files, and what is done there."""

    def __init__(self, cell: Cell, clock: LoopClock) -> None:
        self.cell, self.clock, self.path = cell, clock, cell.site_path
        source = self.path.with_name("c1.rta")
        cell.write_result_file("C1", source)
        edit = short(("C1",), 24, 2, file=str(source), file_datum=0.0, file_unit="mrad")
        self.path.write_text(edit(self.path.read_text(encoding="utf-8")), encoding="utf-8")
        self.tree: SiteFile = load_site(self.path)
        self.root = store_of(self.tree, self.path).root
        self.asked: dict[str, Any] = {"clock": clock, "say": silence}

    async def carried(self, work: PieceOfWork, once: Callable[[], Awaitable[Done]]) -> Done:
        """A command, repeated each time the operator has been at the machine."""
        for _ in range(MOST):
            try:
                with exchange_files_for(work):
                    return await once()
            except ToCarry:
                await self.clock.sleep(900.0)
        raise AssertionError(self.path)

    async def proposed(self) -> RunFolder:
        """Measured by a file; the live tables come by one way to the machine."""
        made = await run_site(self.tree, self.path, apply=False, machine_name="", **self.asked)
        return Store(self.root).open(made.run_folder)

    async def tested(self) -> None:
        """The self-test, carried."""
        work = PieceOfWork("self-test", "go-on", ends=True)
        await self.carried(work, lambda: self_test_site(self.tree, self.path, axis="", **self.asked))

    def proved(self) -> None:
        """The sign of C1's own table was proved some other day."""
        machine, moment = machine_of(self.cell.file), datetime.now(UTC).isoformat()
        ProofBook(self.root).save(SignProof(machine, "axis", "C1", -1.0, 0.01, 1, moment))

    async def push(self, folder: RunFolder, *, resume: bool) -> Any:
        """One call of `push --offline`."""
        name = self.tree.site.name
        with push_by_files(offline=True, resume=resume):
            return await push_run(folder, apply=True, machine_name=name, **self.asked)

    async def pushed(self, folder: RunFolder) -> tuple[Any, int]:
        """Begun, then resumed to its end; and how many ways to the machine it took."""
        for count in range(MOST):
            try:
                return await self.push(folder, resume=count > 0), count
            except ToCarry:
                await self.clock.sleep(900.0)
        raise AssertionError(self.path)

    async def compared_once(self) -> Any:
        """The live table against the last push, as far as the files go."""
        return await verify_table(self.tree, self.path, table="C1", run=None, **self.asked)

    async def compared(self) -> Any:
        """The live table against the last push."""
        return await self.carried(PieceOfWork("verify-table C1", "go-on", ends=True), self.compared_once)


def told(tmp_path: Path, story: Callable[[Site], Any]) -> Any:
    async def job() -> Any:
        clock = LoopClock()
        options: dict[str, Any] = {"wires": "memory", "block_s": 1.0, "seed": 3, "road": "carried"}
        async with cell_running("demo", tmp_path / "cell", clock, **options) as cell:
            return await story(Site(cell, clock))

    return run_virtual(job)


@pytest.mark.long
def test_a_table_goes_in_by_files_and_comes_out_again(tmp_path: Path) -> None:
    """Every command on the same road, in the same words as by a wire."""

    async def story(site: Site) -> None:
        folder = await site.proposed()
        await site.tested()
        site.proved()
        before = site.cell.figures("C1")["M"]
        outcome, ways = await site.pushed(folder)
        assert ways == 4
        with pytest.raises(DevicesFailed, match="E-OFF-NOTHING"):
            await site.push(folder, resume=True)
        change = folder.get(stages.PROPOSAL, Proposal).changes[0]
        assert folder.facts["stages"][stages.push(change.name)]
        assert site.cell.figures("C1")["M"] < 0.7 * before
        assert outcome.exit_code == 0
        assert (await site.compared()).data["kind"] == "as-approved"
        asked = {"apply": True, "machine_name": site.tree.site.name, **site.asked}
        await roll_back_site(site.tree, site.path, table="C1", **asked)
        assert site.cell.figures("C1")["M"] == pytest.approx(before, abs=0.01)
        entries = audit.read_entries(site.root)
        actions = [entry["action"] for entry in entries]
        assert actions.count("push-start") == actions.count("push-committed") == 1
        assert audit.check_log(site.root, ()).problem is None

    told(tmp_path, story)


@pytest.mark.long
def test_what_waits_for_its_files_is_not_begun_twice(tmp_path: Path) -> None:
    """A second push, and any other command, are told what waits; nothing to resume is told too."""

    async def story(site: Site) -> None:
        folder = await site.proposed()
        site.proved()
        await site.tested()
        with pytest.raises(DevicesFailed, match="E-OFF-NOTHING"):
            await site.push(folder, resume=True)
        with pytest.raises(ToCarry):
            await site.push(folder, resume=False)
        for again in (site.push(folder, resume=False), site.proposed()):
            with pytest.raises(DevicesFailed, match="E-OFF-BEGUN"):
                await again
        await site.clock.sleep(900.0)
        with pytest.raises(ToCarry) as second:
            await site.push(folder, resume=True)
        assert second.value.program.startswith("TFLOAD")

    told(tmp_path, story)


def test_the_options_of_a_push_by_files_are_judged(tmp_path: Path) -> None:
    """`--resume` alone means nothing."""
    del tmp_path
    with pytest.raises(ConfigError, match="E-OFF-RESUME"), push_by_files(offline=False, resume=True):
        pass
