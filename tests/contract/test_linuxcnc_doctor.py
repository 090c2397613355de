"""What the doctor finds on the road to a LinuxCNC host, and what of the host's state counts as an alarm."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.checks import CheckLine, Wanted, WantedAxis
from drivers.linuxcnc.doctor import LinuxCncDoctor
from tests.contract.linuxcnc_stage import Stage, on_stage


async def examined(on: Stage, *axes: str, **settings: object) -> dict[str, list[CheckLine]]:
    """The lines by what they look at."""
    serial = (await on.device.identify()).serial if on.machine.life else "mill-0"
    wanted = Wanted(serial, tuple(WantedAxis(axis, "deg" if axis == "A" else "mm", 0, 61) for axis in axes))
    doctor = LinuxCncDoctor("mill", on.url, {"token_file": str(on.token), **settings}, on.clock)
    found: dict[str, list[CheckLine]] = {}
    for line in await doctor.examine(wanted, 5.0):
        found.setdefault(line.check, []).append(line)
    return found


async def test_a_sound_host_is_told_line_by_line(tmp_path: Path) -> None:
    async with on_stage(tmp_path) as on:
        found = await examined(on, "X", "A")
        assert list(found) == ["agent", "kernel", "fingerprint", "identity", "joint 0", "joint 2", "HAL pins", "rights"]
        assert {line.outcome for lines in found.values() for line in lines} == {"ok"}
        assert "2.9.0" in found["kernel"][0].what
        assert str(tmp_path / "mill.ini") in found["kernel"][0].what
        assert "motion.digital-in-00, 01 and motion.analog-out-00, 01" in found["HAL pins"][0].what


async def test_what_a_push_would_stumble_on_is_said_before(tmp_path: Path) -> None:
    async with on_stage(tmp_path) as on:
        on.machine.linked.add("motion.digital-in-01")
        on.machine.version = "2.8.4"
        on.machine.emergency = True
        ini = on.machine.ini_path
        ini.write_text(ini.read_text().replace("COMP_FILE = a.comp", "COMP_FILE = elsewhere/a.comp"))
        (tmp_path / "elsewhere").mkdir()
        (tmp_path / "elsewhere" / "a.comp").write_text("")
        on.machine.restart()
        on.machine.homed = False
        (tmp_path / "elsewhere" / "a.comp").unlink()
        (tmp_path / "elsewhere").rmdir()
        found = await examined(on, "X", "A", "Q", echo_output=9)
        assert [line.code for line in found["kernel"]] == ["W-LCNC-KERNEL", "W-LCNC-VERSION"]
        assert [line.code for line in found["joint 0"]] == ["W-LCNC-NOT-HOMED", "W-LCNC-FILE"]
        assert [line.code for line in found["axis Q"]] == ["E-LCNC-AXIS"]
        assert [line.code for line in found["emergency stop"]] == ["W-LCNC-EMERGENCY"]
        pins = {str(line.fields["pin"]): line.what for line in found["HAL pins"]}
        assert list(pins) == ["motion.digital-in-01", "motion.analog-out-09"]
        assert "a signal drives it" in pins["motion.digital-in-01"]
        assert [line.code for line in found["rights"]] == ["E-LCNC-FILE"] * 2
        assert "nothing can be written here" in found["rights"][1].what


@pytest.mark.parametrize("axes", [(), ("Q",)])
async def test_a_host_without_a_file_of_ours_has_no_rights_to_lack(tmp_path: Path, axes: tuple[str, ...]) -> None:
    async with on_stage(tmp_path) as on:
        assert [line.outcome for line in (await examined(on, *axes))["rights"]] == ["ok"]


async def test_where_the_kernel_is_down_the_rest_is_not_reached(tmp_path: Path) -> None:
    async with on_stage(tmp_path) as on:
        on.machine.stop()
        found = await examined(on, "X")
        assert [line.code for line in found["kernel"]] == ["E-LCNC-DOWN"]
        assert found["rest"][0].outcome == "unknown"


async def test_an_emergency_stop_and_a_fault_of_a_joint_are_alarms(tmp_path: Path) -> None:
    async with on_stage(tmp_path) as on:
        assert ((await on.device.state()).alarms, (await on.device.state()).message) == ((), "")
        on.machine.emergency = True
        on.machine.faults.add(2)
        state = await on.device.state()
        assert state.alarms == (1, 12)
        assert state.message == "LinuxCNC is in emergency stop; joint 2 reports a fault"
