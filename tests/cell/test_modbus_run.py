"""The main job where the only road is a PLC's mailbox: a result file, signs proved by hand, a push at the panel."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from simulators.cell import Cell
from tests.cell.bench import main_job, short


def test_a_mailbox_site_pushes_what_a_result_file_tells(tmp_path: Path) -> None:
    path = tmp_path / "measured.rtl"
    jogs: list[asyncio.Task[None]] = []

    async def during(cell: Cell) -> None:
        cell.write_result_file("X1", path)

    def heard(cell: Cell, code: str, fields: dict[str, object]) -> None:
        if code == "P-JOG-SETUP":
            setup = cell.bench.setup_for("EXX", "X")
            assert setup is not None
            cell.bench.mount(setup)
        if code in ("P-JOG-SETUP", "P-JOG-STOP", "P-PUSH-JOG"):
            jog = cell.operator.jog(str(fields["axis"]), float(str(fields["position"])))
            jogs.append(asyncio.get_running_loop().create_task(jog))

    edit = short(("X1",), 24, 2, file=str(path), file_datum=-400.0)
    judged = main_job(tmp_path, during=during, edit=edit, heard=heard, road="modbus")
    assert set(judged.outcome.data["not_corrected"]) == {"X1-reversal"}  # this road writes none
    assert judged.after["X1"]["M"] <= max(0.2 * judged.before["X1"]["M"], 2.5)
    assert [code for code, _fields in judged.said].count("P-SIGN-PROVED") == 1
    assert all(jog.done() for jog in jogs)


def test_without_a_file_a_mailbox_site_says_what_it_needs(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="E-RUN-NO-PROGRAMS"):
        main_job(tmp_path, edit=short(("X1",), 5, 1), road="modbus")
