"""What comes back from a control without a wire is believed only when it answers the very step that was carried."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.offline_exchange import PieceOfWork, ToCarry, exchange_files_for
from drivers.types.orders import TableQuestion
from drivers.types.tables import LiveSet
from simulators.operator import SHEET_NOT_DONE, OfflineOperator
from tests.offline.world import OfflineWorld, offline_world
from tests.push.world import OLD
from tests.sizes import few

LOOKING = PieceOfWork("look", "go-on", ends=True)
QUESTION = TableQuestion("X1", "X", "mm", rotary=False)


def heard(_code: str, /, **_fields: object) -> None:
    """Nobody listens."""


async def asked(world: OfflineWorld) -> LiveSet | ToCarry:
    """The live tables, or what is to be carried for them, as a process that ends there."""
    device = world.driver()
    try:
        with exchange_files_for(LOOKING):
            await device.open(60.0)
            return await device.live_tables(QUESTION, heard)
    except ToCarry as stop:
        return stop
    finally:
        await device.close()


async def introduced(world: OfflineWorld) -> ToCarry:
    """The control was seen once; what is asked for next."""
    assert isinstance(await asked(world), ToCarry)
    await world.porter.work_through_sheet()
    waits = await asked(world)
    assert isinstance(waits, ToCarry)
    assert (waits.program, waits.why) == ("TFMEAS_X1.MPF", "")
    return waits


async def test_the_live_tables_come_back_by_files(tmp_path: Path) -> None:
    """Two ways to the control: one to be seen, one for the tables; nobody asks the same again."""
    async with offline_world(LoopClock(), tmp_path) as world:
        await introduced(world)
        await world.porter.work_through_sheet()
        found = await asked(world)
        assert isinstance(found, LiveSet)
        assert (found.own.enabled, found.own.table.deviations) == (True, OLD.deviations)
        assert isinstance(await asked(world), LiveSet)


def lost(back: Path) -> None:
    """The table's file stays behind."""
    (back / "TFLIVE_X1.SPF").unlink()


def cut(back: Path) -> None:
    """A line of the table's file is gone."""
    path = back / "TFLIVE_X1.SPF"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:3] + lines[4:]))


def garbled(back: Path) -> None:
    """A line of the report is no value any more."""
    path = back / "TFTOLD.SPF"
    path.write_text(path.read_text().replace(";$AA_IM[X1]=", ";$AA_IM[X1]=?"))


def untyped(back: Path) -> None:
    """The form as it was handed out."""
    path = back / "SEEN.toml"
    path.write_text(path.read_text().replace("alarms = []", 'alarms = "?"'))


def short(back: Path) -> None:
    """The report ends early."""
    path = back / "TFTOLD.SPF"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-4]))


def renamed(back: Path) -> None:
    """A browser or a copy gave the report another name."""
    (back / "TFTOLD.SPF").rename(back / "TFTOLD (1).SPF")


def twice(back: Path) -> None:
    """An old report lies beside the new one, by the name that the control itself gives it."""
    (back / "_N_TFTOLD_SPF").write_text((back / "TFTOLD.SPF").read_text().replace("TOLD ", "TOLD 1"))


def empty(back: Path) -> None:
    """The stick was pulled before the report was written."""
    (back / "TFTOLD.SPF").write_bytes(b"")


HARMS = [
    (lost, "E-OFF-MISSING"),
    (renamed, "E-OFF-MISSING"),
    (twice, "E-OFF-TWICE"),
    (empty, "E-OFF-REPORT"),
    (cut, "E-OFF-REPORT"),
    (garbled, "E-OFF-REPORT"),
    (untyped, "E-OFF-SEEN"),
    (short, "E-OFF-REPORT"),
]


@pytest.mark.parametrize(("harm", "code"), few(HARMS))
async def test_what_is_not_whole_is_asked_for_again(tmp_path: Path, harm: Callable[[Path], None], code: str) -> None:
    """Named, and nothing lost: the same files whole are taken afterwards."""
    async with offline_world(LoopClock(), tmp_path) as world:
        await introduced(world)
        await world.porter.work_through_sheet()
        harm(world.folder / "back")
        waits = await asked(world)
        assert isinstance(waits, ToCarry)
        assert waits.why.startswith(code)
        assert str(world.folder / "back") in waits.why
        for path in world.folder.glob("back/*TOLD*"):
            path.unlink()
        world.porter.collect_files()
        assert isinstance(await asked(world), LiveSet)


@pytest.mark.parametrize("letters", ["utf-16", "utf-16-le", "utf-8-sig"])
async def test_what_only_looks_harmed_is_taken(tmp_path: Path, letters: str) -> None:
    """Line ends and encodings of an editor, protected files, the same file twice, and what is no file of ours."""
    async with offline_world(LoopClock(), tmp_path) as world:
        await introduced(world)
        await world.porter.work_through_sheet()
        back, carry = world.folder / "back", world.folder / "carry"
        report, form = back / "TFTOLD.SPF", back / "SEEN.toml"
        shutil.copy(report, back / "_N_TFTOLD_SPF")
        table = back / "TFLIVE_X1.SPF"
        head = "%_N_TFLIVE_X1_SPF\r\n;$PATH=/_N_SPF_DIR\r\n"
        table.write_bytes(head.encode() + table.read_bytes().replace(b"\n", b"\r\n"))
        table.chmod(0o400)
        form.write_bytes(form.read_text().encode(letters))
        (back / "film.mp4").write_bytes(bytes((4 << 20) + 1))
        (back / "._TFTOLD.SPF").write_bytes(b"\x00\x05\x16\x07")
        (carry / "mine").mkdir()
        (carry / "notes.txt").write_text("a person's own")
        device = world.driver()
        with exchange_files_for(LOOKING):
            await device.open(60.0)
            assert isinstance(await device.live_tables(QUESTION, heard), LiveSet)
            device.conclude()
        assert sorted(path.name for path in carry.iterdir()) == ["mine", "notes.txt"]


async def test_files_of_an_earlier_step_are_no_answer(tmp_path: Path) -> None:
    """A stick that still holds the files of the day before."""
    async with offline_world(LoopClock(), tmp_path) as world:
        await introduced(world)
        await world.porter.work_through_sheet()
        old = tmp_path / "old"
        shutil.copytree(world.folder / "back", old)
        device = world.driver()
        with exchange_files_for(LOOKING):
            await device.open(60.0)
            await device.live_tables(QUESTION, heard)
            device.conclude()
        assert isinstance(await asked(world), ToCarry)
        for path in old.iterdir():
            if path.is_file():
                shutil.copy(path, world.folder / "back")
        waits = await asked(world)
        assert isinstance(waits, ToCarry)
        assert waits.why.startswith("E-OFF-OTHER")


async def test_another_machine_refuses_the_program_and_its_files_are_no_answer(tmp_path: Path) -> None:
    """The program looks at the serial number before all else."""
    clock = LoopClock()
    async with offline_world(clock, tmp_path / "stick") as world:
        await introduced(world)
        async with offline_world(clock, tmp_path / "other", serial="ST-OTHER") as other:
            before = list(other.nck.core.memory.eec[0, 0].points)
            porter = OfflineOperator(other.nck, clock, world.folder)
            await porter.work_through_sheet()
            assert any(SHEET_NOT_DONE in text for text in porter.read)
            assert list(other.nck.core.memory.eec[0, 0].points) == before
        waits = await asked(world)
        assert isinstance(waits, ToCarry)
        assert waits.why.startswith("E-OFF-MISSING")


async def test_a_program_runs_once(tmp_path: Path) -> None:
    """Started again it says so and writes nothing: its own report is still there."""
    async with offline_world(LoopClock(), tmp_path) as world:
        await introduced(world)
        await world.porter.work_through_sheet()
        world.porter.read.clear()
        await world.porter.run_program("TFMEAS_X1.MPF")
        assert any(SHEET_NOT_DONE in text for text in world.porter.read)
        world.porter.collect_files()
        assert isinstance(await asked(world), LiveSet)


async def test_a_program_that_was_not_run_is_told_by_the_looking_one(tmp_path: Path) -> None:
    """TFSEE shows that the words are not those of the program: it has not begun."""
    async with offline_world(LoopClock(), tmp_path) as world:
        await introduced(world)
        await world.porter.work_through_sheet(only="TFSEE.MPF")
        (world.folder / "back" / "TFTOLD.SPF").unlink(missing_ok=True)
        with pytest.raises(Exception, match="E-OFF-NOT-RUN"):
            await asked(world)
