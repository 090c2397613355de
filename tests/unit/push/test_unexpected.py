"""What nobody foresaw in a push: before the first write it ends with nothing written, after it it leads home."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import run_virtual
from drivers.errors import DeviceRefused
from drivers.types.tables import LiveTable
from gateway.errors import StoreError, Unexpected
from gateway.push import journal
from gateway.push.state import wrap_unexpected
from gateway.push.transaction import push_table
from gateway.workflow.run.audit_trail import error_words, outcome_word
from tests.unit.push.double import NEW, OLD, bench, change_of, journals_of

OLD_ON = LiveTable(OLD, enabled=True)
SURPRISES: tuple[BaseException, ...] = (
    TypeError("a bug"),
    OverflowError("a bug"),
    OSError(28, "No space left on device"),
    asyncio.CancelledError("our own"),
    ExceptionGroup("two", [KeyError("one"), ValueError("two")]),
)
AFTER = ("stage", "read_back", "activate", "confirm", "restarted")
BEFORE = ("table_limits", "identify", "state", "live_tables")


def failing(at: Any, name: str, error: BaseException) -> Any:
    """The context with a controller whose call of that name fails once."""
    real, left = getattr(at.context.controller, name), [error]

    class Once:
        def __getattr__(self, asked: str) -> Any:
            return getattr(at.context.controller, asked)

    async def once(*args: Any, **more: Any) -> Any:
        if left:
            raise left.pop()
        return await real(*args, **more)

    made = Once()
    setattr(made, name, once)
    return replace(at.context, controller=made)


@pytest.mark.parametrize(("call", "error"), list(zip(AFTER, SURPRISES, strict=True)))
def test_after_the_first_announced_write_it_goes_back(tmp_path: Path, call: str, error: BaseException) -> None:
    at = bench(tmp_path, OLD_ON)
    record = run_virtual(lambda: push_table(change_of(at.machine), failing(at, call, error)))
    assert record.outcome == "rolled-back"
    assert at.machine.own == OLD_ON
    (found,) = journals_of(tmp_path)
    assert found.kinds[-1] == "ROLLED_BACK"
    assert type(error).__name__ in str(found.latest("why"))


@pytest.mark.parametrize(("call", "error"), list(zip(BEFORE, SURPRISES[1:], strict=True)))
def test_before_it_nothing_is_written(tmp_path: Path, call: str, error: BaseException) -> None:
    at = bench(tmp_path, OLD_ON)
    with pytest.raises(Unexpected, match="E-PUSH-UNEXPECTED"):
        run_virtual(lambda: push_table(change_of(at.machine), failing(at, call, error)))
    assert at.machine.own == OLD_ON
    assert at.machine.writes == []
    assert all(found.is_ended for found in journals_of(tmp_path))


def test_a_voice_that_is_gone_stops_no_push(tmp_path: Path) -> None:
    def say(code: str, /, **fields: object) -> None:
        raise BrokenPipeError(code, fields)

    at = bench(tmp_path, OLD_ON)
    heard = at.context.say

    def gone(code: str, /, **fields: object) -> None:
        heard(code, **fields)
        say(code, **fields)

    record = run_virtual(lambda: push_table(change_of(at.machine), replace(at.context, say=gone)))
    assert record.outcome == "committed"
    assert at.machine.own == LiveTable(NEW, enabled=True)


def test_a_cancel_from_outside_passes_and_the_journal_stays_open(tmp_path: Path) -> None:
    at = bench(tmp_path, OLD_ON)

    async def main() -> None:
        task = asyncio.ensure_future(push_table(change_of(at.machine), at.context))
        at.context.controller.read_back = lambda *_: _stopped(task)
        await asyncio.wait([task])
        assert task.cancelled()

    run_virtual(main)
    (found,) = journals_of(tmp_path)
    assert found.kinds[-2:] == ("DISABLE", "STOPPED")
    assert not found.is_ended


async def _stopped(task: asyncio.Task[Any]) -> None:
    task.cancel()
    await asyncio.Event().wait()


def test_a_cancel_of_our_own_is_an_error_and_one_from_outside_is_not() -> None:
    async def own() -> None:
        with wrap_unexpected("X1"):
            raise asyncio.CancelledError

    with pytest.raises(Unexpected, match="CancelledError"):
        run_virtual(own)

    async def outside() -> bool:
        task = asyncio.ensure_future(own_wait())
        await asyncio.sleep(0)  # noqa: TID251 - plain asyncio
        task.cancel()
        await asyncio.wait([task])
        return task.cancelled()

    async def own_wait() -> None:
        with wrap_unexpected("X1"):
            await asyncio.Event().wait()

    assert run_virtual(outside)


def test_a_disk_that_refuses_the_close_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    let_go = journal.Journal._let_go

    def refused(self: journal.Journal) -> None:
        let_go(self)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(journal.Journal, "_let_go", refused)
    at = bench(tmp_path, OLD_ON)
    record = run_virtual(lambda: push_table(change_of(at.machine), at.context))
    assert record.outcome == "committed"
    assert journals_of(tmp_path)[0].kinds[-1] == "COMMITTED"


@pytest.mark.parametrize(
    ("error", "word"),
    [
        (DeviceRefused("E-LINK-SEAT", "X1"), "failed"),
        (StoreError("E-PUSH-JOURNAL", "tx", why="full"), "unknown"),
        (Unexpected("E-PUSH-UNEXPECTED", "X1", kind="TypeError", why="a bug"), "unknown"),
        (asyncio.CancelledError(), "unknown"),
    ],
)
def test_the_audit_says_failed_only_where_nothing_was_written(error: BaseException, word: str) -> None:
    assert outcome_word(error) == word
    assert error_words(error)
