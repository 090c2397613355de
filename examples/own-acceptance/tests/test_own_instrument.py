"""An instrument of yours: what it must do while its wire is bad, on the simulated cell."""

from gateway.config import load_site
from gateway.supervisor import Supervisor


def test_a_laser_opens_on_a_wire_that_splits_its_lines(trueflank_faults):
    async def main(cell):
        supervisor = Supervisor(load_site(cell.site_path), cell.clock, only={"laser"})
        try:
            await supervisor.open_all()
            return [one.state for one in supervisor.picture() if one.name == "laser"]
        finally:
            await supervisor.close_all()

    assert trueflank_faults.in_memory(main, {"wire.split": 0.5}) == ["open"]
