"""kill -9 of the gateway and of the agent at every write: old or new acts, and what is left is taken back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.linuxcnc.agent import screwfiles
from drivers.linuxcnc.wire import AgentWire
from drivers.types.tables import CompensationTable
from gateway.push.context import PushContext
from gateway.push.journal import Journal
from gateway.push.recovery import recover_table, unfinished_tables
from gateway.push.transaction import push_table
from tests.contract.linuxcnc_pushing import BENT, change_of, person
from tests.contract.linuxcnc_stage import Killed, Stage, on_stage
from tests.sizes import few

OLD = CompensationTable("axis", "X", "X", 0.0, 400.0, 100.0, (0.0, 1.0, 2.0, 1.0, 0.0))
OLD_ROWS = [
    (0.0, 0.0, 0.0),
    (100.0, -0.001, -0.001),
    (200.0, -0.002, -0.002),
    (300.0, -0.001, -0.001),
    (400.0, 0.0, 0.0),
]
NEW_ROWS = [
    *((0.0, 0.0002, -0.0002), (100.0, -0.003, -0.0035), (200.0, -0.007, -0.0075)),
    *((300.0, -0.002, -0.0024), (400.0, -0.001, -0.0015)),
]
WRITES = ("begin", "put", "commit", "finish")
GATEWAY = [("commit", "after"), *((do, when) for do in WRITES for when in ("before", "after"))][:-1]


async def _with_old(on: Stage, context: PushContext) -> None:
    """The old table acts."""
    record = await push_table(change_of(await on.device.saved_tables("X"), OLD), context)
    assert record.outcome == "committed", record.steps
    assert on.machine.rows[0] == OLD_ROWS


def _dying(monkeypatch: pytest.MonkeyPatch, do: str, when: str) -> None:
    """From this write on the gateway does nothing any more: nothing over the wire, nothing into the journal."""
    write, append, dead = AgentWire.write, Journal.append, False

    async def told(self: AgentWire, asked: str, **fields: Any) -> Any:
        nonlocal dead
        if dead or (asked, when) == (do, "before"):
            dead = True
            raise Killed
        found = await write(self, asked, **fields)
        if (asked, when) == (do, "after"):
            dead = True
            raise Killed
        return found

    def noted(self: Journal, kind: str, **facts: object) -> None:
        if dead:
            raise Killed
        append(self, kind, **facts)

    monkeypatch.setattr(AgentWire, "write", told)
    monkeypatch.setattr(Journal, "append", noted)


async def _recovered(on: Stage, context: PushContext, ended: tuple[str, ...] = ("none", "committed")) -> None:
    for _ in range(3):
        for work in unfinished_tables(context.journals, context.machine.serial):
            assert (await recover_table(work, context)).outcome in ("rolled-back", "committed")
    assert unfinished_tables(context.journals, context.machine.serial) == ()
    marker = await on.device.marker()
    assert marker is not None
    assert marker.state in ended
    assert (await on.device.saved_tables("X")).own.enabled  # what acts is what stands


@pytest.mark.parametrize("restarted", few([False, True]), ids=["same life", "restarted meanwhile"])
@pytest.mark.parametrize(("do", "when"), few(GATEWAY))
async def test_a_gateway_killed_at_a_write_leaves_old_or_new_and_a_way_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, do: str, when: str, restarted: bool
) -> None:
    (tmp_path / "host").mkdir()
    async with on_stage(tmp_path / "host") as on:
        heard: list[str] = []
        async with person(on, tmp_path, heard) as context:
            await _with_old(on, context)
            change = change_of(await on.device.saved_tables("X"), BENT)
            with monkeypatch.context() as patched:
                _dying(patched, do, when)
                with pytest.raises(Killed):
                    await push_table(change, context)
            if restarted:
                on.machine.restart()
            assert on.machine.rows[0] in (OLD_ROWS, NEW_ROWS)
            assert await on.device.identify() == context.machine
            await _recovered(on, context)
            for _ in range(2):
                assert on.machine.rows[0] == OLD_ROWS
                on.machine.restart()


def _killed_at(monkeypatch: pytest.MonkeyPatch, place: int, after: bool) -> Callable[[], int]:
    """The agent dies at its ``place``-th change of the disk, before or after it; how many there were."""
    durable, count = screwfiles.write_durably, 0

    def told(path: Path, data: bytes) -> None:
        nonlocal count
        count += 1
        if count == place and not after:
            raise Killed
        durable(path, data)
        if count == place:
            raise Killed

    monkeypatch.setattr(screwfiles, "write_durably", told)
    return lambda: count


@pytest.mark.parametrize(
    ("place", "after"), few([(5, False), *((n, late) for n in range(1, 8) for late in (False, True))])
)
async def test_an_agent_killed_at_a_change_of_its_disk_leaves_old_or_new_as_the_push_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: int, after: bool
) -> None:
    (tmp_path / "host").mkdir()
    async with on_stage(tmp_path / "host") as on:
        heard: list[str] = []
        async with person(on, tmp_path, heard) as context:
            await _with_old(on, context)
            change = change_of(await on.device.saved_tables("X"), BENT)
            with monkeypatch.context() as patched:
                changes = _killed_at(patched, place, after)
                record = await push_table(change, context)
                assert changes() >= place
            # The marker's last word alone may be missing: the journal knows that number.
            await _recovered(on, context, ("none", "committed", "in-progress") if place == 7 else ("none", "committed"))
            assert record.outcome in ("committed", "rolled-back"), record.steps
            wanted = NEW_ROWS if record.outcome == "committed" else OLD_ROWS
            for _ in range(2):
                assert on.machine.rows[0] == wanted, record.steps
                on.machine.restart()
