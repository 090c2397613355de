"""A cell whose control is reached through a PLC mailbox: site files, wires, the operator at the panel, the judge."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError, TransportError
from drivers.transport import open_transport
from simulators.cell import Cell
from simulators.cell.__main__ import arguments, plc_settings
from simulators.cell.backdoor import BackDoor
from simulators.cellfile import load_cell, with_connections
from simulators.pytest_plugin import CellStarter
from tests.contract.mailbox_master import Master

X1 = {18: 1, 19: 1}


def controller(path: Path) -> dict[str, Any]:
    found = tomllib.loads(path.read_text(encoding="utf-8"))["controller"]
    assert isinstance(found, dict)
    return found


async def master_at(cell: Cell) -> Master:
    assert cell.plc is not None
    url = cell.plc.home.replace("socket", "tcp")
    settings = cell.plc.plc.settings
    return Master(await open_transport(url, LoopClock(), 5.0), settings.framer == "rtu")


@pytest.mark.parametrize(
    ("wires", "modbus", "scheme"),
    [
        ("memory", {}, "memory"),
        ("tcp", {}, "tcp"),
        ("tcp", {"framer": "rtu", "unit": 9, "word_order": "low-first"}, "socket"),
    ],
)
def test_the_site_file_leads_to_the_mailbox(
    trueflank_cell: CellStarter, wires: str, modbus: dict[str, Any], scheme: str
) -> None:
    async def main(cell: Cell) -> None:
        found = controller(cell.site_path)
        settings = found["settings"]
        assert found["driver"] == "sinumerik-modbus"
        assert found["url"].startswith(f"{scheme}://")
        assert settings["framer"] == modbus.get("framer", "tcp")
        assert settings["unit"] == modbus.get("unit", 1)
        assert settings["needs_reference"] is True
        assert settings["word_order"] == modbus.get("word_order", "high-first")
        assert found["serial"] == cell.file.machine.serial
        assert not cell.server.url, "OPC UA was not asked for"
        wire = await open_transport(found["url"].replace("socket", "tcp"), LoopClock(), 5.0)
        master = Master(wire, settings["framer"] == "rtu", settings["unit"])
        assert (await master.read(0, 2)) == [0x4743, 3]
        serial = b"".join(word.to_bytes(2, "big") for word in await master.read(308, 16))
        assert serial.rstrip(b"\0").decode() == cell.file.machine.serial
        await wire.close()

    trueflank_cell.in_memory(main, "zero", road="modbus", modbus=modbus, wires=wires)


def test_both_roads_have_a_site_file_each(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        assert controller(cell.site_path)["driver"] == "sinumerik-opcua"
        assert controller(cell.site_path.with_suffix(".modbus.toml"))["driver"] == "sinumerik-modbus"
        assert cell.server.url.startswith("opc.tcp://127.0.0.1:")

    trueflank_cell.in_memory(main, "zero", road="both")


def test_the_operator_confirms_restarts_and_jogs(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        master = await master_at(cell)
        cell.nck.set_access_level(7)
        await master.open()
        await _until(cell, lambda: "RELEASE ON" in cell.operator.log, master)
        await cell.operator.jog("X1", -50.0)
        assert cell.nck.axis_state("X1").actual_position == pytest.approx(-50.0, abs=0.003)
        assert cell.nck.mode == "AUTO"
        assert await master.load(X1, [0, 3000, 0], minimum=-1_000_000, step=500_000) == (0, 0)
        number = (await master.read(6, 1))[0] + 1
        await master.put(master.header(5, number, X1))
        await _until(cell, lambda: cell.nck.booting, master)
        await _until(cell, lambda: not cell.nck.booting and cell.nck.axis_state("X1").referenced, master)
        assert cell.operator.log == ["RELEASE ON", "JOG X1 -50", "CONFIRM", "NCK RESET"]
        assert cell.nck.get("$MA_ENC_COMP_ENABLE[0,X1]") is True
        await cell.clock.sleep(60.0)
        assert cell.operator.log[-1] == "RELEASE OFF", "the session has ended"
        await cell.operator.jog("X1", -50.0)
        assert cell.nck.get("$VA_ENC1_COMP_VAL[X1]") == pytest.approx(0.003, abs=1e-6)
        await master.wire.close()

    trueflank_cell.in_memory(main, "zero", road="modbus")


def test_a_table_that_acts_at_once_needs_no_restart(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        assert controller(cell.site_path)["settings"]["needs_reference"] is False
        master = await master_at(cell)
        await master.open()
        await _until(cell, lambda: "RELEASE ON" in cell.operator.log, master)
        assert await master.load(X1, [0, 3000, 0], minimum=-1_000_000, step=500_000) == (0, 0)
        number = (await master.read(6, 1))[0] + 1
        await master.put(master.header(5, number, X1))
        await _until(cell, lambda: cell.operator.log == ["RELEASE ON", "CONFIRM"], master)
        await cell.clock.sleep(30.0)
        assert cell.operator.log == ["RELEASE ON", "CONFIRM", "RELEASE OFF"]
        await master.wire.close()

    file = load_cell("zero")
    machine = file.machine.model_copy(update={"switches": {**file.machine.switches, "strict_activation": False}})
    trueflank_cell.in_memory(main, file.model_copy(update={"machine": machine}), road="modbus")


def test_an_operator_may_refuse(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        cell.operator.change(confirms=False)
        master = await master_at(cell)
        await master.open()
        await _until(cell, lambda: "RELEASE ON" in cell.operator.log, master)
        await master.put(master.header(5, 2, X1))
        for _ in range(62):
            await cell.clock.sleep(1.0)
            await master.beat()
        assert await master.result(2) == (12, 0)
        assert cell.operator.log == ["RELEASE ON"]
        await master.wire.close()

    trueflank_cell.in_memory(main, "zero", road="modbus")


def test_the_judge_knows_the_plc(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        judge = BackDoor(cell)
        master = await master_at(cell)
        await master.open(77)
        assert (await judge.answer({"ask": "plc"}))["session"] == 77
        assert await judge.answer({"set": "plc", "options": {"map_version": 9}}) == {"done": True}
        assert await master.read(1, 1) == [9]
        assert "swopped" in (await judge.answer({"set": "plc", "options": {"swopped": 1}}))["error"]
        assert await judge.answer({"set": "confirm"}) == {"taken": False}
        assert await judge.answer({"set": "release", "value": True}) == {"done": True}
        assert (await judge.answer({"ask": "plc"}))["released"] is True
        assert await judge.answer({"set": "jog", "axis": "Z1", "value": 12.0}) == {"done": True}
        assert "error" in await judge.answer({"set": "jog", "axis": "Z1", "value": 1e6})
        assert await judge.answer({"set": "drop_connections"}) == {"done": True}
        with pytest.raises(TransportError):
            await master.read(0, 1)
        assert await judge.answer({"set": "power_cycle"}) == {"done": True}
        assert (await judge.answer({"ask": "plc"}))["session"] == 0
        await master.wire.close()

    async def opcua_only(cell: Cell) -> None:
        assert "no PLC mailbox" in (await BackDoor(cell).answer({"ask": "plc"}))["error"]

    trueflank_cell.in_memory(main, "zero", road="modbus")
    trueflank_cell.in_memory(opcua_only, "zero")


def test_a_cell_process_serves_modbus_alone(trueflank_cell: CellStarter) -> None:
    cell = trueflank_cell("zero", options=["--road", "modbus"])
    found = controller(cell.site)
    assert found["driver"] == "sinumerik-modbus"
    assert cell.ask("plc")["session"] == 0
    assert cell.ask("status")["channel"] == 0


def test_the_command_line_says_how_the_plc_is_wired() -> None:
    assert plc_settings(arguments(["zero"])) == {}
    assert plc_settings(arguments(["zero", "--framer", "rtu"])) == {"framer": "rtu"}
    assert plc_settings(arguments(["zero", "--plc-port", "1502"])) == {"port": 1502}
    serial = ["zero", "--plc-port", "/dev/ttyS9", "--plc-client-url", "/dev/ttyS8"]
    expected = {"port": "/dev/ttyS9", "framer": "rtu", "client_url": "/dev/ttyS8"}
    assert plc_settings(arguments(serial)) == expected


def test_wrong_plc_settings_are_refused_before_anything_starts(tmp_path: Path) -> None:
    async def main() -> None:
        Cell(with_connections(load_cell("zero"), "modbus", {"swop_words": True}), tmp_path, LoopClock())

    with pytest.raises(ConfigError, match="swop_words"):
        run_virtual(main)


async def _until(cell: Cell, holds: Any, master: Master) -> None:
    """Wait for something while the session's heart beats."""
    for _ in range(120):
        if holds():
            return
        await cell.clock.sleep(0.5)
        await master.beat()
    raise AssertionError(f"it never happened; the operator did {cell.operator.log}")
