"""What `init` is told by a LinuxCNC host."""

from __future__ import annotations

from pathlib import Path

from drivers.checks import ControlAxis
from drivers.linuxcnc.doctor import LinuxCncSurvey
from tests.contract.linuxcnc_stage import on_stage


async def test_a_host_tells_its_joints_that_a_file_corrects(tmp_path: Path) -> None:
    async with on_stage(tmp_path) as on:
        ini = on.machine.ini_path
        ini.write_text(ini.read_text().replace("COMP_FILE = y.comp\n", ""))
        on.machine.restart()
        survey = LinuxCncSurvey("control", on.url, {"token_file": str(on.token)}, on.clock)
        facts = await survey.survey(5.0)
    both = {"travel": (-100.0, 500.0), "encoder": 0, "points": 256}
    assert facts.axes == (ControlAxis("X", "mm", **both), ControlAxis("A", "deg", **both))
    assert facts.serial.startswith("mill-")
