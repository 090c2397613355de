"""The kernel as the agent sees it: which life of it runs, its INI file, joints, state and hand-shake pins."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.linuxcnc.agent.protocol import AgentRefusal

# Which life of the kernel this is: its process and when it began, from /proc.

PROC = Path("/proc")
TASK = "milltask"
ENDED = "ZX"  # a process that has ended is listed until its parent asks for it


@dataclass(frozen=True)
class KernelLife:
    """A kernel that runs: ``name`` is the same as long as it lives, ``began_s`` is wall-clock time (s, to 0.01 s).

    That time moves when somebody sets the host's clock, so it is no part of what makes two lives the same.
    """

    name: str
    began_s: float = field(compare=False)


def running_life() -> KernelLife | None:
    """The kernel's task process now; None where there is none."""
    return next(filter(None, map(_life, PROC.glob("[0-9]*"))), None)


def goes_on(life: KernelLife | None) -> bool:
    """Whether this life goes on; where there was none, whether there still is none."""
    if life is None:
        return running_life() is None
    return _life(PROC / life.name.partition("-")[0]) == life


def _life(folder: Path) -> KernelLife | None:
    try:
        words = (folder / "stat").read_text().rpartition(")")
    except OSError:  # it ended while we looked
        return None
    rest = words[2].split()
    if words[0].partition("(")[2] != TASK or rest[0] in ENDED:
        return None
    ticks = int(rest[19])
    return KernelLife(f"{folder.name}-{ticks}", _boot_s() + ticks / os.sysconf("SC_CLK_TCK"))


def _boot_s() -> float:
    found = [line.split()[1] for line in (PROC / "stat").read_text().splitlines() if line.startswith("btime")]
    return float(found[0])


# The kernel as the agent sees it: its INI file, its joints, its state, and four words of a program's hand-shake.

LETTERS = "XYZABCUVW"
STARTING = "it is starting"
COMPONENT = "trueflank"
ACK_S, PAUSE_S, SETTLE_S, ENDS_S = 2.0, 0.002, 5.0, 2.0


class Kernel:
    """One life of a kernel. ``linuxcnc`` and ``hal`` are the modules of its package.

    A stat object belongs to the kernel that ran when it was made: after a restart a new process looks anew.
    """

    def __init__(self, linuxcnc: Any, hal: Any, sleep: Callable[[float], None] = time.sleep) -> None:
        self._cnc, self._hal, self._sleep = linuxcnc, hal, sleep
        try:
            self._stat, self._command = linuxcnc.stat(), linuxcnc.command()
            self._poll()
            if not self._stat.ini_filename or not self._stat.joints:
                raise AgentRefusal("E-LCNC-DOWN", why=STARTING)
            self._component = hal.component(COMPONENT)
            self._component.ready()
        except AgentRefusal:
            raise
        except Exception as error:  # the modules raise whatever C tells them
            raise AgentRefusal("E-LCNC-DOWN", why=str(error)) from error
        self.ini_path = Path(self._stat.ini_filename)
        self._ini = linuxcnc.ini(str(self.ini_path))
        self.letters = self._letters()

    def _poll(self) -> None:
        """See the kernel as it is now. Raises E-LCNC-DOWN where it ends just then."""
        try:
            self._stat.poll()
        except Exception as error:
            raise AgentRefusal("E-LCNC-DOWN", why=str(error)) from error

    @property
    def version(self) -> str:
        """The kernel's version, as its package says it."""
        return str(self._cnc.version)

    @property
    def machine(self) -> str:
        """[EMC] MACHINE."""
        return str(self._ini.find("EMC", "MACHINE") or "LinuxCNC")

    def _letters(self) -> tuple[str, ...]:
        """The axis of each joint, by number: trivial kinematics with one joint an axis, or nothing of ours is safe."""
        words = str(self._ini.find("KINS", "KINEMATICS") or "").split()
        count = int(self._stat.joints)
        told = [word.partition("=")[2] for word in words[1:] if word.lower().startswith("coordinates=")]
        letters = tuple(one for one in (told[0].upper() if told else LETTERS[:count]) if one in LETTERS)
        if not words or words[0] != "trivkins" or len(letters) != count or len(set(letters)) != count:
            raise AgentRefusal("E-LCNC-KINS", found=" ".join(words), joints=count)
        return letters

    def joint(self, letter: str) -> int:
        """The joint of an axis. Raises E-LCNC-AXIS."""
        if letter not in self.letters:
            raise AgentRefusal("E-LCNC-AXIS", axis=letter, known=" ".join(self.letters))
        return self.letters.index(letter)

    def setting(self, joint: int, key: str) -> str:
        """A key of [JOINT_n]; "" where it is not there."""
        return str(self._ini.find(f"JOINT_{joint}", key) or "").strip()

    def screw(self, joint: int) -> tuple[Path | None, int, float]:
        """A joint's compensation file (None: no COMP_FILE), its type, and BACKLASH in joint units."""
        name = self.setting(joint, "COMP_FILE")
        path = self.ini_path.parent / name if name else None
        return path, int(self.setting(joint, "COMP_FILE_TYPE") or 0), float(self.setting(joint, "BACKLASH") or 0.0)

    def joints(self) -> list[dict[str, Any]]:
        """What the INI file and the kernel say of each joint; limits in mm or deg."""
        self._poll()
        return [self._joint(number, letter) for number, letter in enumerate(self.letters)]

    def _joint(self, number: int, letter: str) -> dict[str, Any]:
        one = self._stat.joint[number]
        path, kind, backlash = self.screw(number)
        return {
            "joint": number,
            "letter": letter,
            "rotary": one["jointType"] == 2,  # 1 linear, 2 angular
            "units": float(one["units"]),
            "minimum": float(one["min_position_limit"]),
            "maximum": float(one["max_position_limit"]),
            "file": "" if path is None else str(path),
            "type": kind,
            "backlash": backlash,
            "homed": bool(one["homed"]),
            "fault": bool(one["fault"]),
            "in_position": bool(one["inpos"]),
            "position": float(self._stat.joint_actual_position[number]),
            "trim": self._value(f"joint.{number}.backlash-filt"),
        }

    def _value(self, pin: str) -> float:
        try:
            return float(self._hal.get_value(pin))
        except Exception as error:
            raise AgentRefusal("E-LCNC-PIN", pin=pin, why=str(error)) from error

    def pins(self, inputs: list[int], outputs: list[int]) -> list[dict[str, str]]:
        """What is wrong with the pins of the hand-shake, one by one: missing, or an input that a signal drives."""
        names = [(f"motion.digital-in-{int(one):02}", True) for one in inputs]
        names += [(f"motion.analog-out-{int(one):02}", False) for one in outputs]
        return [{"pin": name, "why": why} for name, driven in names if (why := self._trouble(name, driven))]

    def _trouble(self, pin: str, driven: bool) -> str:
        try:
            self._value(pin)
        except AgentRefusal as error:
            return str(error.fields["why"])
        return "a signal drives it" if driven and self._hal.pin_has_writer(pin) else ""

    def _set(self, pin: str, high: bool) -> None:
        try:
            self._hal.set_p(pin, "1" if high else "0")
        except Exception as error:
            raise AgentRefusal("E-LCNC-PIN", pin=pin, why=str(error)) from error

    def state(self) -> dict[str, Any]:
        """Interpreter, mode and every joint, read now. The error channel is left alone: who reads it takes from it."""
        self._poll()
        stat, cnc = self._stat, self._cnc
        modes = {cnc.MODE_MANUAL: "JOG", cnc.MODE_MDI: "MDI", cnc.MODE_AUTO: "AUTO"}
        idle = stat.interp_state == cnc.INTERP_IDLE
        paused = bool(stat.paused) or stat.interp_state == cnc.INTERP_PAUSED
        return {
            "channel": "RESET" if idle else "INTERRUPTED" if paused else "ACTIVE",
            "mode": modes.get(stat.task_mode, ""),
            "on": stat.task_state == cnc.STATE_ON,
            "program": str(stat.file),
            "emergency": stat.task_state == cnc.STATE_ESTOP,
            "aout": [float(one) for one in stat.aout[:8]],
            "joints": self.joints(),
        }

    # ---- a program of ours ------------------------------------------------------------------------

    def select(self, path: Path) -> None:
        """Show a program to the operator, ready to be started. Raises E-LCNC-BUSY, E-LCNC-SELECT.

        A program that has given its last stop may still have a moment to its end.
        """
        for _ in range(int(ENDS_S / PAUSE_S)):
            self._poll()
            if self._stat.interp_state == self._cnc.INTERP_IDLE:
                break
            self._sleep(PAUSE_S)
        if self._stat.interp_state != self._cnc.INTERP_IDLE:
            raise AgentRefusal("E-LCNC-BUSY", program=str(self._stat.file))
        self._command.mode(self._cnc.MODE_AUTO)
        self._command.wait_complete(SETTLE_S)
        self._command.program_open(str(path))
        self._command.wait_complete(SETTLE_S)
        self._poll()
        if Path(self._stat.file) != path:
            raise AgentRefusal("E-LCNC-SELECT", program=path.name, found=str(self._stat.file))

    def lower(self, go: int, leave: int) -> None:
        """Take both inputs of the hand-shake back."""
        self._set(f"motion.digital-in-{go:02}", False)
        self._set(f"motion.digital-in-{leave:02}", False)

    def let_go(self, go: int, echo: int, counter: int) -> None:
        """Raise the input a program waits for until it says the counter back. Raises E-LCNC-ECHO."""
        self._set(f"motion.digital-in-{go:02}", True)
        try:
            for _ in range(int(ACK_S / PAUSE_S)):
                self._poll()
                if round(self._stat.aout[echo]) == counter:
                    return
                self._sleep(PAUSE_S)
        finally:
            self._set(f"motion.digital-in-{go:02}", False)
        raise AgentRefusal("E-LCNC-ECHO", counter=counter)

    def leave(self, go: int, leave: int) -> None:
        """Ask a program that waits to end at once, or at its next wait."""
        self._set(f"motion.digital-in-{leave:02}", True)
        self._set(f"motion.digital-in-{go:02}", True)
