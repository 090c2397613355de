"""A PLC program behind the mailbox: what the gateway must read from it before it loads anything."""

from gateway.config import load_site
from gateway.supervisor import Supervisor


def test_the_mailbox_names_its_machine_and_no_session_is_open(trueflank_cell):
    async def main(cell):
        supervisor = Supervisor(load_site(cell.site_path), cell.clock, only=())
        try:
            machine = await supervisor.open_all()
            return machine.serial, cell.plc.plc.waiting
        finally:
            await supervisor.close_all()

    serial, waiting = trueflank_cell.in_memory(main, "zero", road="modbus")
    assert serial
    assert not waiting
