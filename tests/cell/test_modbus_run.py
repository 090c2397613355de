"""The main job where the only road is a PLC's mailbox: a result file, signs proved by hand, a push at the panel."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from gateway.config import load_site
from gateway.domain.proposals import Proposal
from gateway.store import Store
from gateway.store.machine_books import ProofBook
from gateway.workflow.programs import programs
from gateway.workflow.run import stages
from simulators.cell import Cell
from tests.cell.bench import main_job, short
from tests.cell.test_reversals import lagging
from tests.contract.laid_down import WireLog, read, wire_log
from tests.sizes import few

__all__ = ["wire_log"]


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
    assert set(judged.outcome.data["not_corrected"]) == {"X1-reversal"}  # nothing has proved its sign
    assert judged.after["X1"]["M"] <= max(0.2 * judged.before["X1"]["M"], 2.5)
    assert [code for code, _fields in judged.said].count("P-SIGN-PROVED") == 1
    assert all(jog.done() for jog in jogs)


@pytest.mark.parametrize(("B", "tilt"), few([(-3.0, 1.5), (-3.0, 0.0), (6.0, 0.0)]))
def test_a_mailbox_takes_a_reversal_whose_sign_is_proved_already(
    tmp_path: Path,
    wire_log: WireLog,
    B: float,
    tilt: float,
) -> None:
    """As where OPC UA has proved it: table, constant and pair go in one order, and all are right by the truth.

    What `program` prints of the layer is what was written into the mailbox.
    """
    path = tmp_path / "measured.rtl"
    jogs: list[asyncio.Task[None]] = []

    async def during(cell: Cell) -> None:
        cell.write_result_file("X1", path)

    def heard(cell: Cell, code: str, fields: dict[str, object]) -> None:
        if code == "P-OPEN":
            (run,) = (cell.site_path.parent / "runs").glob("*/run.json")
            told = json.loads(run.read_text(encoding="utf-8"))["machine"]
            machine = MachineIdentity(told["serial"], told["version"], tuple(axis.name for axis in cell.nck.spec.axes))
            for kind in ("axis", "reversal", "cross"):
                proof = SignProof(machine, kind, "X1", -1.0, 0.01, sign=1, date_utc=cell.clock.utc().isoformat())
                ProofBook(cell.site_path.parent / "runs").save(proof)
        if code == "P-PUSH-JOG":
            jog = cell.operator.jog(str(fields["axis"]), float(str(fields["position"])))
            jogs.append(asyncio.get_running_loop().create_task(jog))

    edit = short(("X1",), 24, 5, file=str(path), file_datum=-400.0)
    judged = main_job(tmp_path, lagging("X1", B, tilt=tilt), during=during, edit=edit, heard=heard, road="modbus")
    assert judged.outcome.data["not_corrected"] == {}
    assert judged.after["X1"]["B"] <= 0.1 * judged.before["X1"]["B"] + 0.5
    assert judged.after["X1"]["M"] <= max(0.2 * judged.before["X1"]["M"], 2.5)
    pushed = json.loads(Path(judged.outcome.data["report"]["json"]).read_text(encoding="utf-8"))["axes"][0]["beside"]
    assert [one["push"]["outcome"] for one in pushed] == ["committed"] * (3 if tilt else 1)
    assert [code for code, _fields in judged.said].count("P-SIGN-PROVED") == 0
    site_path = tmp_path / "cell" / "site.toml"
    proposal = Store(site_path.parent / "runs").open(judged.outcome.run_folder).get(stages.PROPOSAL, Proposal)
    (number,) = {int(one["push"]["transaction"]) for one in pushed}
    written = programs(load_site(site_path), site_path, ("load",), proposal, numbers=wire_log.numbers(number))
    assert [write for one in written for write in read(one.program.text)] == wire_log.changing
    assert all(jog.done() for jog in jogs)


def test_without_a_file_a_mailbox_site_says_what_it_needs(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="E-RUN-NO-PROGRAMS"):
        main_job(tmp_path, edit=short(("X1",), 5, 1), road="modbus")
