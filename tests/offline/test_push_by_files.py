"""A push to a control without a wire: each way to the machine is a process of its own, and the journal goes on."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.errors import TrueflankError
from drivers.offline_exchange import PieceOfWork, ToCarry, exchange_files_for
from drivers.sinumerik.ncprogram.words import Phase, Word, Words
from drivers.types.orders import TableQuestion
from drivers.types.tables import LiveSet
from gateway.domain.outcomes import PushRecord
from gateway.push import journal
from gateway.push.recovery import recover_table, unfinished_tables
from gateway.push.transaction import push_table
from tests.offline.world import OfflineWorld, offline_world
from tests.push.uaworld import ua_change, ua_context
from tests.sizes import few

LOOKING = PieceOfWork("look", "go-on", ends=True)
PUSHING = PieceOfWork("push", "go-on", ends=True)
REPORT = "TFTOLD.SPF"
QUESTION = TableQuestion("X1", "X", "mm", rotary=False)
Ended = PushRecord | ToCarry | TrueflankError


def heard(_code: str, /, **_fields: object) -> None:
    """Nobody listens."""


async def base(world: OfflineWorld) -> LiveSet:
    """The live tables, by as many ways to the machine as it takes."""
    while True:
        device = world.driver()
        try:
            with exchange_files_for(LOOKING):
                await device.open(60.0)
                found = await device.live_tables(QUESTION, heard)
                device.conclude()
                await device.close()
                return found
        except ToCarry:
            await device.close()
            await world.porter.work_through_sheet()


async def once(world: OfflineWorld, root: Path, live: LiveSet, **edit: Any) -> Ended:
    """One process: it takes the push up from its beginning, and ends where a person is needed."""
    device = world.driver()
    try:
        with exchange_files_for(PUSHING):
            await device.open(60.0)
            machine = await device.identify()
            context = ua_context(device, world.clock, root, machine, key="k", resumes=True, say=heard)
            record = await push_table(ua_change(live, world.new), replace(context, **edit))
            device.conclude()
            return record
    except (ToCarry, TrueflankError) as stop:
        return stop
    finally:
        await device.close()


async def pushed(world: OfflineWorld, root: Path, live: LiveSet, most: int = 12) -> tuple[Ended, list[str]]:
    """To its end; and which programs were run for it."""
    ran: list[str] = []
    for _ in range(most):
        ended = await once(world, root, live)
        if not isinstance(ended, ToCarry):
            return ended, ran
        ran.append(ended.program)
        assert not ended.why
        await world.porter.work_through_sheet()
    raise AssertionError(ran)


def journals(root: Path) -> tuple[journal.JournalRead, ...]:
    """Every journal that has ended."""
    return tuple(journal.read(path) for path in sorted(root.glob("journal/*/done/*.jnl")))


def sound(world: OfflineWorld, *, wanted: bool) -> None:
    """What acts at the end, and that nothing else ever acted."""
    assert world.oracle.whims == []
    assert world.oracle.as_wanted if wanted else world.oracle.as_before


async def test_each_step_is_a_process_of_its_own(tmp_path: Path) -> None:
    """Four ways to the machine, one journal, the table in and proved."""
    async with offline_world(LoopClock(), tmp_path / "stick") as world:
        ended, ran = await pushed(world, tmp_path, await base(world))
        assert isinstance(ended, PushRecord)
        assert ended.outcome == "committed"
        assert ran == ["TFMEAS_X1.MPF", "TFLOAD_X1.MPF", "TFENAB_X1.MPF", "TFMEAS_X1.MPF"]
        (done,) = journals(tmp_path)
        kinds = ["LEASED", "SNAPSHOT", "DISABLE", "BACKUP", "LOADED", "ENABLE", "ENABLED", "ACTIVATED", "EFFECT"]
        assert list(done.kinds) == [*kinds, "COMMITTED"]
        assert world.sheet == ""
        sound(world, wanted=True)


def lost(now: Path, old: Path) -> None:
    """The report fell off the stick."""
    del old
    (now / REPORT).unlink()


def outdated(now: Path, old: Path) -> None:
    """The report of the way before; of the first way there is none older, so it is lost."""
    if (old / REPORT).exists():
        shutil.copy(old / REPORT, now / REPORT)
    else:
        (now / REPORT).unlink()


def damaged(now: Path, old: Path) -> None:
    """A line of the report is gone."""
    del old
    lines = (now / REPORT).read_text().splitlines(keepends=True)
    (now / REPORT).write_text("".join([*lines[:2], *lines[3:]]))


@pytest.mark.parametrize("harm", few([outdated, lost, damaged]))
async def test_a_report_that_is_no_answer_is_asked_for_again_at_every_step(
    tmp_path: Path, harm: Callable[[Path, Path], None]
) -> None:
    """Named; nothing is run twice for it, and with the right file the push goes on to its end."""
    async with offline_world(LoopClock(), tmp_path / "stick") as world:
        live = await base(world)
        ran: list[str] = []
        back, old = world.folder / "back", tmp_path / "old"
        while isinstance(ended := await once(world, tmp_path, live), ToCarry):
            assert not ended.why
            ran.append(ended.program)
            await world.porter.work_through_sheet()
            harm(back, old)
            again = await once(world, tmp_path, live)
            assert isinstance(again, ToCarry)
            assert again.program == ended.program
            assert again.why.startswith("E-OFF-")
            world.porter.collect_files()
            shutil.copytree(back, old, dirs_exist_ok=True)
        assert isinstance(ended, PushRecord)
        assert ended.outcome == "committed"
        assert ran == ["TFMEAS_X1.MPF", "TFLOAD_X1.MPF", "TFENAB_X1.MPF", "TFMEAS_X1.MPF"]
        sound(world, wanted=True)


async def test_a_whole_table_of_another_part_or_day_is_asked_for_again(tmp_path: Path) -> None:
    """The read-back under the back-up's name, then the live tables of the way before: no reason to lead a push back."""
    async with offline_world(LoopClock(), tmp_path / "stick") as world:
        live = await base(world)
        back = world.folder / "back"
        kept, named = "", []
        while isinstance(ended := await once(world, tmp_path, live), ToCarry):
            await world.porter.work_through_sheet()
            name, text = "", ""
            if ended.program == "TFLOAD_X1.MPF":
                name, text = "TFBACK_X1.SPF", (back / "TFREAD_X1.SPF").read_text()
            elif ended.program == "TFMEAS_X1.MPF":
                name, text = "TFLIVE_X1.SPF", kept
                kept = (back / name).read_text()
            if text:
                (back / name).write_text(text)
                again = await once(world, tmp_path, live)
                assert isinstance(again, ToCarry)
                assert again.why.startswith(f"E-OFF-OTHER [{back}: {name}]")
                world.porter.collect_files()
                named.append(name)
        assert named == ["TFBACK_X1.SPF", "TFLIVE_X1.SPF"]
        assert isinstance(ended, PushRecord)
        assert ended.outcome == "committed"
        sound(world, wanted=True)


async def test_recover_fetches_the_backup_that_never_came_back(tmp_path: Path) -> None:
    """The stick was lost after the load: the control still has the file that the old table is put back by."""
    async with offline_world(LoopClock(), tmp_path / "stick") as world:
        live = await base(world)
        for program in ("TFMEAS_X1.MPF", "TFLOAD_X1.MPF"):
            ended = await once(world, tmp_path, live)
            assert isinstance(ended, ToCarry)
            assert ended.program == program
            await world.porter.work_through_sheet()
        for path in world.folder.glob("back/*.*"):
            path.unlink()
        world.porter.start()
        device = world.driver()
        with exchange_files_for(PieceOfWork("recover", "instead")):
            await device.open(60.0)
            machine = await device.identify()
            (found,) = unfinished_tables(tmp_path / "journal", machine.serial)
            patient = {"start_timeout_s": 3600.0}
            record = await recover_table(
                found, ua_context(device, world.clock, tmp_path, machine, say=heard, **patient)
            )
            device.conclude()
        await device.close()
        await world.porter.stop()
        assert record.outcome == "rolled-back"
        sound(world, wanted=False)


def altered(back: Path, name: str) -> None:
    """One point of a file is another number."""
    path = back / name
    lines = path.read_text().splitlines(keepends=True)
    place = next(at for at, line in enumerate(lines) if line.startswith("$AA_ENC_COMP[0,4,"))
    path.write_text("".join([*lines[:place], lines[place].partition("=")[0] + "=0.02\n", *lines[place + 1 :]]))


@pytest.mark.parametrize(("name", "outcome"), few([("TFREAD_X1.SPF", "rolled-back"), ("TFBACK_X1.SPF", "held")]))
async def test_a_number_that_changed_on_the_way_enables_nothing(tmp_path: Path, name: str, outcome: str) -> None:
    """A read-back that differs leads back; a back-up that differs is never restored from."""
    async with offline_world(LoopClock(), tmp_path / "stick") as world:
        live = await base(world)
        ran: list[str] = []
        ended: Ended | None = None
        for _ in range(12):
            ended = await once(world, tmp_path, live)
            if not isinstance(ended, ToCarry):
                break
            ran.append(ended.program)
            await world.porter.work_through_sheet()
            if ran.count("TFLOAD_X1.MPF") == 1 and ended.program == "TFLOAD_X1.MPF":
                altered(world.folder / "back", name)
        assert isinstance(ended, PushRecord)
        assert ended.outcome == outcome
        assert "TFENAB_X1.MPF" not in ran[:3]
        assert world.oracle.whims == []
        assert world.oracle.as_before if outcome == "rolled-back" else world.oracle.off


class Killed(BaseException):
    """The process is gone."""


@pytest.mark.parametrize("entry", few(["DISABLE", "SNAPSHOT", "BACKUP", "ENABLE", "ENABLED", "EFFECT"]))
async def test_a_gateway_killed_between_two_steps_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, entry: str
) -> None:
    """The journal and the folder know how far it was; nothing is sent twice."""
    append = journal.Journal.append
    left = [entry]

    def dying(kept: journal.Journal, kind: str, **facts: object) -> None:
        append(kept, kind, **facts)
        if kind in left:
            left.remove(kind)
            raise Killed(kind)

    monkeypatch.setattr(journal.Journal, "append", dying)
    async with offline_world(LoopClock(), tmp_path / "stick") as world:
        live = await base(world)
        ran: list[str] = []
        ended: Ended | None = None
        for _ in range(12):
            with contextlib.suppress(Killed):
                ended = await once(world, tmp_path, live)
                if not isinstance(ended, ToCarry):
                    break
                ran.append(ended.program)
                await world.porter.work_through_sheet()
        assert isinstance(ended, PushRecord)
        assert (ended.outcome, left) == ("committed", [])
        assert ran == ["TFMEAS_X1.MPF", "TFLOAD_X1.MPF", "TFENAB_X1.MPF", "TFMEAS_X1.MPF"]
        sound(world, wanted=True)


def reset_while_writing(world: OfflineWorld, blocks: Iterator[int], _block: int) -> None:
    """RESET once the table is off and as many blocks of the new one as ``blocks`` are done."""
    if world.nck.get(f"R[{Words().number(Word.PHASE)}]") == Phase.DISABLED and next(blocks, None) is None:
        world.nck.channel_reset()


async def test_a_load_that_was_broken_off_leads_back(tmp_path: Path) -> None:
    """RESET in the middle of writing: the looking program tells where it stands, and the old table comes back."""
    async with offline_world(LoopClock(), tmp_path / "stick") as world:
        live = await base(world)
        ended: Ended | None = None
        broken = False
        for _ in range(12):
            ended = await once(world, tmp_path, live)
            if not isinstance(ended, ToCarry):
                break
            if ended.program == "TFLOAD_X1.MPF" and not broken:
                broken = True
                world.porter.copy_programs(world.folder / "carry")
                world.nck.on_block = partial(reset_while_writing, world, iter(range(9)))
                await world.porter.run_program("TFLOAD_X1.MPF")
                world.nck.on_block = None
                await world.porter.run_program("TFSEE.MPF")
                world.porter.collect_files()
            else:
                await world.porter.work_through_sheet()
        assert broken
        assert isinstance(ended, PushRecord)
        assert ended.outcome == "rolled-back"
        sound(world, wanted=False)
