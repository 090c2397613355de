"""What is signed is what is carried: `program` prints, byte for byte, the file that lies there to be taken along."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError
from drivers.offline_exchange import PieceOfWork, ToCarry, exchange_files_for
from gateway.domain.proposals import Proposal
from gateway.workflow.control.disable import disable_site
from gateway.workflow.programs import numbers_in, programs
from gateway.workflow.run import stages
from gateway.workflow.run.outcome import Outcome
from gateway.workflow.run.paper_control import ProgramKind
from gateway.workflow.run.self_test import self_test_site
from simulators.cell import cell_running
from tests.offline.test_site_by_files import MOST, Site

OPTIONS: dict[str, Any] = {"wires": "memory", "block_s": 1.0, "seed": 3, "road": "carried"}


def at_a_site(tmp_path: Path, story: Callable[[Site], Awaitable[None]]) -> None:
    async def job() -> None:
        clock = LoopClock()
        async with cell_running("demo", tmp_path / "cell", clock, **OPTIONS) as cell:
            await story(Site(cell, clock))

    run_virtual(job)


def is_printed(site: Site, waits: ToCarry, what: ProgramKind, proposal: Proposal | None = None) -> bool:
    """Whether `check programs --like` prints the very bytes that are to be carried now."""
    lies = waits.folder / waits.program
    found = programs(site.tree, site.path, (what,), proposal, numbers=numbers_in(site.tree, lies))
    return lies.read_bytes() in [one.program.text.encode("ascii") for one in found]


def test_a_self_test_is_carried_as_it_is_printed(tmp_path: Path) -> None:
    async def story(site: Site) -> None:
        with pytest.raises(ConfigError, match="E-PROGRAM-LIKE"):
            numbers_in(site.tree, site.path)
        await site.tested()  # from here on it is known what the control has reserved
        again = PieceOfWork("self-test again", "go-on", ends=True)
        with pytest.raises(ToCarry) as waits, exchange_files_for(again):
            await self_test_site(site.tree, site.path, axis="", **site.asked)
        assert waits.value.program == "TFSELF_C1.MPF"
        assert is_printed(site, waits.value, "self-test")

    at_a_site(tmp_path, story)


def test_an_order_to_switch_off_is_carried_as_it_is_printed(tmp_path: Path) -> None:
    """Somebody has switched the table on since files last came back: they read off, and the order goes in any case."""

    async def story(site: Site) -> None:
        await site.tested()
        site.cell.nck.set("$MA_ENC_COMP_ENABLE[0,C1]", 1, 0)
        asked = {"axis": "C1", "table": "", "machine_name": site.tree.site.name, **site.asked}
        (told, *_) = (await disable_site(site.tree, site.path, apply=False, **asked)).lines
        assert "C1 read off when files last came back" in str(told)
        seen = []
        work = PieceOfWork("disable C1", "go-on", ends=True)

        async def once() -> Outcome:
            try:
                return await disable_site(site.tree, site.path, apply=True, **asked)
            except ToCarry as waits:
                seen.append((waits.program, is_printed(site, waits, "off")))
                raise

        done = await site.carried(work, once)
        assert seen == [("TFOFF_C1.MPF", True)]
        assert done.data["outcome"] == "off"
        assert site.cell.nck.get("$MA_ENC_COMP_ENABLE[0,C1]") is False

    at_a_site(tmp_path, story)


@pytest.mark.long
def test_a_push_is_carried_as_it_is_printed(tmp_path: Path) -> None:
    async def story(site: Site) -> None:
        folder = await site.proposed()
        await site.tested()
        site.proved()
        proposal = folder.get(stages.PROPOSAL, Proposal)
        # The first program reads what is live before, the last one visits the places of the proof of effect.
        kinds: tuple[ProgramKind, ...] = ("measure", "load", "load", "effect")
        seen = []
        for count in range(MOST):
            try:
                await site.push(folder, resume=count > 0)
                break
            except ToCarry as waits:
                printed = is_printed(site, waits, kinds[count], proposal)
                seen.append((waits.program, printed))
                await site.clock.sleep(900.0)
        names = ("TFMEAS_C1.MPF", "TFLOAD_C1.MPF", "TFENAB_C1.MPF", "TFMEAS_C1.MPF")
        assert seen == [(name, True) for name in names]
        with pytest.raises(ToCarry) as compared, exchange_files_for(PieceOfWork("verify-table C1", "go-on", ends=True)):
            await site.compared_once()
        assert is_printed(site, compared.value, "backup")  # what the push's end left to be told goes along

    at_a_site(tmp_path, story)
