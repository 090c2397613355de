"""The modules `linuxcnc` and `hal` as an agent meets them, over a machine that reads its files when it starts.

Written from LinuxCNC's "Python Interface" page, `usrmotLoadComp` and EMCMOT_SET_JOINT_COMP: the kernel takes rows up to
the first line that is none, cuts what comes after 256 and what does not rise, and runs on. No trim acts before the
first move.
"""

from __future__ import annotations

import bisect
import configparser
import itertools
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from drivers.linuxcnc.agent.kernel import KernelLife

MOST = 256
INI = """[EMC]
MACHINE = mill
[KINS]
KINEMATICS = trivkins coordinates=XYA
JOINTS = 3
[JOINT_0]
COMP_FILE = x.comp
COMP_FILE_TYPE = 1
[JOINT_1]
BACKLASH = 0.010
COMP_FILE = y.comp
COMP_FILE_TYPE = 0
[JOINT_2]
COMP_FILE = a.comp
COMP_FILE_TYPE = 1
"""
HANDSHAKE = {f"motion.{kind}-{number:02}" for kind in ("digital-in", "analog-out") for number in range(4)}
Row = tuple[float, float, float]


class Machine:
    """Joints X, Y, A; ``rows`` are what the kernel read of each file. Nothing runs until `start`."""

    MODE_MANUAL, MODE_AUTO, MODE_MDI = 1, 2, 3
    INTERP_IDLE, INTERP_READING, INTERP_PAUSED, INTERP_WAITING = 1, 2, 3, 4
    STATE_ESTOP, STATE_ON = 1, 4
    RCS_DONE, RCS_ERROR = 1, 3
    version = "2.9.0"

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.ini_path = folder / "mill.ini"
        self.ini_path.write_text(INI)
        for name in ("x", "y", "a"):
            (folder / f"{name}.comp").write_text("")
        self.life: KernelLife | None = None
        self.rows: list[list[Row]] = [[], [], []]
        self.starts = 0
        self.linked: set[str] = set()
        self.faults: set[int] = set()
        self.emergency = False
        self.stop()

    def stop(self) -> None:
        self.life = None
        self.inputs: dict[str, bool] = {}
        self.aout = [0.0] * 4
        self.position, self.trim = [0.0] * 3, [0.0] * 3
        self.homed = self.fresh = False
        self.program: Iterator[tuple[int, bool]] | None = None
        self.file, self.mode, self.interp = "", self.MODE_MANUAL, self.INTERP_IDLE

    def start(self) -> None:
        """Read the files; a missing one keeps the kernel from starting."""
        self.starts += 1
        known = self._ini()
        files = [known[f"JOINT_{joint}"].get("COMP_FILE") for joint in range(3)]
        self.rows = [_read(self.folder / file, self._kind(at)) if file else [] for at, file in enumerate(files)]
        self.life = KernelLife(f"life-{self.starts}", time.time())  # noqa: TID251 - files of a disk have its time

    def restart(self) -> None:
        self.stop()
        self.start()
        self.homed = True

    def _ini(self) -> configparser.ConfigParser:
        found = configparser.ConfigParser()
        found.optionxform = str  # type: ignore[assignment,method-assign]
        found.read(self.ini_path)
        return found

    def _kind(self, joint: int) -> int:
        return int(self._ini()[f"JOINT_{joint}"]["COMP_FILE_TYPE"])

    def move(self, joint: int, target: float) -> None:
        """Go there: the column of that direction acts from then on."""
        up = target > self.position[joint]
        self.position[joint] = target
        rows = self.rows[joint]
        half = float(self._ini()[f"JOINT_{joint}"].get("BACKLASH", "0")) / 2
        self.trim[joint] = _between(rows, target, 1 if up else 2) if rows else (half if up else -half)

    # ---- the modules ------------------------------------------------------------------------------

    def stat(self) -> Any:
        return _Stat(self)

    def command(self) -> Any:
        return _Command(self)

    def ini(self, path: str) -> Any:
        assert path == str(self.ini_path)
        known = self._ini()
        return SimpleNamespace(find=lambda section, key: known.get(section, key, fallback=None))

    def component(self, _name: str) -> Any:
        return SimpleNamespace(ready=lambda: None)

    @property
    def task_state(self) -> int:
        return self.STATE_ESTOP if self.emergency else self.STATE_ON

    def get_value(self, pin: str) -> float:
        if pin in HANDSHAKE:
            return 0.0
        if not pin.startswith("joint.") or not pin.endswith(".backlash-filt"):
            raise RuntimeError(f"no pin {pin}")
        return self.trim[int(pin.split(".")[1])]

    def pin_has_writer(self, pin: str) -> bool:
        return pin in self.linked

    def set_p(self, pin: str, value: str) -> None:
        if pin in self.linked:
            raise RuntimeError("pin is connected to a signal")
        self.inputs[pin] = value == "1"
        self._go_on()

    # ---- a program --------------------------------------------------------------------------------

    def shown(self) -> str:
        """The program on the screen."""
        return Path(self.file).read_text()

    def cycle_start(self) -> None:
        """The person's button: the program that is shown runs to its first wait."""
        if self.fresh and self.interp == self.INTERP_IDLE:
            self.fresh = False
            self.program = self._program(Path(self.file).read_text().splitlines())
            self.interp = self.INTERP_WAITING
            self._go_on()

    def _go_on(self) -> None:
        """As far as the inputs let it."""
        if self.program is None:
            return
        for pin, high in self.program:
            if self.inputs.get(f"motion.digital-in-{pin:02}", False) != high:
                # what it waits for is asked again at the next change of an input
                self.program = itertools.chain([(pin, high)], self.program)
                return
        self.program, self.interp = None, self.INTERP_IDLE

    def _program(self, lines: list[str]) -> Iterator[tuple[int, bool]]:
        """The few words that programs of stops have; it yields the input that it waits for."""
        passed, skipping = 0.0, False
        for line in lines:
            words = {word[0]: word[1:] for word in line.split() if word[0] != "("}
            if " IF " in line:
                skipping = not (passed < 0.0 if "LT 0" in line else passed > 0.5)
            elif line.endswith("ENDIF"):
                skipping = False
            elif skipping:
                continue
            elif line.strip() == "M2":
                return
            elif line.startswith("G53"):
                letter = next(word for word in words if word in "XYA")
                self.move("XYA".index(letter), float(words[letter]))
            elif line.strip().startswith("M68"):
                self.aout[int(words["E"])] = float(words["Q"])
            elif line.startswith("M66"):
                pin = int(words["P"])
                if words["L"] != "0":
                    yield pin, words["L"] == "3"
                passed = float(self.inputs.get(f"motion.digital-in-{pin:02}", False))


class _Stat:
    """What `linuxcnc.stat` shows after `poll`."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.joints = 3

    def poll(self) -> None:
        machine = self._machine
        if machine.life is None:
            raise RuntimeError("emcStatusBuffer invalid")
        self.ini_filename, self.file = str(machine.ini_path), machine.file
        self.interp_state, self.task_mode, self.task_state = machine.interp, machine.mode, machine.task_state
        self.paused, self.state, self.aout = False, machine.RCS_DONE, tuple(machine.aout)
        self.joint_actual_position = tuple(machine.position)
        self.joint = tuple(
            {
                "jointType": 2 if number == 2 else 1,
                "units": 1.0,
                "min_position_limit": -100.0,
                "max_position_limit": 500.0,
                "homed": int(machine.homed),
                "fault": int(number in machine.faults),
                "inpos": 1,
            }
            for number in range(3)
        )


class _Command:
    def __init__(self, machine: Machine) -> None:
        self._machine = machine

    def mode(self, mode: int) -> None:
        self._machine.mode = mode

    def wait_complete(self, _timeout: float) -> int:
        return Machine.RCS_DONE

    def program_open(self, path: str) -> None:
        if self._machine.mode == Machine.MODE_AUTO:
            self._machine.file, self._machine.fresh = path, True


def _read(path: Path, kind: int) -> list[Row]:
    rows: list[Row] = []
    for line in path.read_text().splitlines():
        try:
            at, forward, reverse = (float(word) for word in line.split()[:3])
        except ValueError:
            break
        if len(rows) < MOST and (not rows or at > rows[-1][0]):
            rows.append((at, forward, reverse) if kind else (at, at - forward, at - reverse))
    return rows


def _between(rows: list[Row], at: float, column: int) -> float:
    place = bisect.bisect_right([row[0] for row in rows], at)
    if place in (0, len(rows)):
        return rows[max(place - 1, 0)][column]
    low, high = rows[place - 1], rows[place]
    return low[column] + (high[column] - low[column]) * (at - low[0]) / (high[0] - low[0])
