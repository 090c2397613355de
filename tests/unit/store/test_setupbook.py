"""Set-up values are kept by machine and gear, with their history; nothing is lost, nothing altered is believed."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.types.identity import MachineIdentity
from gateway.errors import CorruptRecord
from gateway.store import Store
from gateway.store.machine_books import SetupBook
from gateway.tooth import SetupValues

MACHINE = MachineIdentity("SN/1 ö", "V4.8", ("X1", "C1"))
FIRST, SECOND = SetupValues(1.5, -2.0, 3.0), SetupValues(x_um=0.1)


def saved(root: Path, *entries: tuple[MachineIdentity, str, SetupValues]) -> SetupBook:
    async def main() -> SetupBook:
        book, clock = SetupBook(root), LoopClock()
        for place, (machine, gear, setup) in enumerate(entries):
            book.save(machine, gear, setup, run=f"run-{place}", clock=clock)
        return book

    return asyncio.run(main())


def test_the_last_one_counts_and_the_others_stay(tmp_path: Path) -> None:
    assert SetupBook(tmp_path).current(MACHINE, "RV 40") == SetupValues()
    book = saved(tmp_path, (MACHINE, "RV 40", FIRST), (MACHINE, "RV 40", SECOND), (MACHINE, "RV 40", FIRST))
    assert book.current(MACHINE, "RV 40") == FIRST
    kept = book.history(MACHINE.serial, "RV 40")
    assert [(entry.number, entry.setup, entry.run) for entry in kept] == [
        (1, FIRST, "run-0"),
        (2, SECOND, "run-1"),
        (3, FIRST, "run-2"),
    ]
    assert kept[0].date_utc
    assert Store(tmp_path).runs() == ()


def test_another_machine_or_gear_has_its_own(tmp_path: Path) -> None:
    other = replace(MACHINE, serial="SN_1 o")
    book = saved(tmp_path, (MACHINE, "RV 40", FIRST), (MACHINE, "RV 40-2", SECOND), (MACHINE, "RV_40", SECOND))
    assert book.current(other, "RV 40") == SetupValues()
    assert book.current(MACHINE, "RV 4") == SetupValues()
    assert book.current(MACHINE, "RV 40") == FIRST
    assert book.current(replace(MACHINE, version="V5"), "RV 40") == FIRST


def test_an_altered_entry_is_refused(tmp_path: Path) -> None:
    book = saved(tmp_path, (MACHINE, "RV 40", FIRST))
    (path,) = (tmp_path / "set-up-values").rglob("*.json")
    path.write_bytes(path.read_bytes().replace(b"1.5", b"9.5"))
    with pytest.raises(CorruptRecord):
        book.current(MACHINE, "RV 40")
