"""One line in, one line out: the token, what was asked, and the answer or the refusal as JSON."""

from __future__ import annotations

import hmac
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from drivers.linuxcnc.agent.kernel import Kernel, KernelLife
from drivers.linuxcnc.agent.protocol import AgentRefusal, AgentReply
from drivers.linuxcnc.agent.screwfiles import ScrewFiles, read_file, write_durably

PROTOCOL = 1
PROGRAM = "trueflank-"
_STATES = ("none", "in-progress", "committed", "held")
_UNREADABLE = (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError, OverflowError)


class Agent:
    """Answers for one INI file. ``find`` gives the kernel of this life, or refuses; ``life`` says whether it runs."""

    def __init__(self, token: str, find: Callable[[], Kernel], life: Callable[[], KernelLife | None]) -> None:
        self._token, self._find, self._life = token, find, life
        self._kernel: Kernel | None = None
        self._of: KernelLife | None = None
        self._can: dict[str, Callable[[dict[str, Any]], Any]] = {
            "hello": self._hello,
            "identify": self._identify,
            "state": lambda _asked: self._now().state(),
            "look": self._look,
            "tables": self._tables,
            "marker": lambda _asked: self._files().marker(),
            "begin": lambda asked: self._files().begin(_whole(asked, "transaction"), asked["head"], asked["joints"]),
            "before": lambda asked: self._files().before(asked["transaction"], asked["joint"]),
            "put": lambda asked: self._files().put(asked["transaction"], asked["joint"], asked["text"]),
            "commit": lambda asked: self._files().commit(asked["transaction"], asked["digests"]),
            "clear": lambda asked: self._files().clear(asked["joint"], asked["text"]),
            "finish": self._finish,
            "program": self._program,
            "lower": lambda asked: self._now().lower(asked["go"], asked["leave"]),
            "release": lambda asked: self._now().let_go(asked["go"], asked["echo"], asked["counter"]),
            "leave": lambda asked: self._now().leave(asked["go"], asked["leave"]),
        }

    def line(self, data: bytes) -> AgentReply:
        """The answer to one line. Never raises."""
        number: object = None
        trusted = False
        try:
            asked = json.loads(data)
            number = asked.get("id")
            if not hmac.compare_digest(str(asked.get("token", "")).encode(), self._token.encode()):
                raise AgentRefusal("E-LCNC-TOKEN")
            trusted = True
            if asked.get("do") not in self._can:
                raise AgentRefusal("E-LCNC-ASKED", asked=str(asked.get("do"))[:40])
            told: dict[str, Any] = {"ok": self._can[asked["do"]](asked)}
        except AgentRefusal as error:
            told = {"code": error.code, "fields": error.fields}
        except _UNREADABLE as error:
            told = {"code": "E-LCNC-ASKED", "fields": {"asked": f"{type(error).__name__}: {error}"[:80]}}
        except OSError as error:
            told = {"code": "E-LCNC-FILE", "fields": {"file": str(error.filename), "why": str(error.strerror)}}
        return AgentReply(json.dumps({"id": number if type(number) is int else None, **told}).encode() + b"\n", trusted)

    def _now(self) -> Kernel:
        """The kernel that runs now. Raises E-LCNC-DOWN."""
        life = self._life()
        if life is None:
            raise AgentRefusal("E-LCNC-DOWN", why="no process milltask")
        if self._kernel is None or life != self._of:
            self._kernel, self._of = self._find(), life
        return self._kernel

    def _files(self) -> ScrewFiles:
        kernel = self._now()
        return ScrewFiles(kernel.ini_path.parent, lambda joint: kernel.screw(joint)[0], self._life)

    def _hello(self, _asked: dict[str, Any]) -> dict[str, Any]:
        life = self._life()
        return {"agent": PROTOCOL, "life": life.name if life is not None else ""}

    def _identify(self, _asked: dict[str, Any]) -> dict[str, Any]:
        kernel, marker = self._now(), self._files().marker()
        return {
            "agent": PROTOCOL,
            "machine": kernel.machine,
            "name": marker["machine"],
            "version": kernel.version,
            "ini": str(kernel.ini_path),
            "joints": kernel.joints(),
        }

    def facts(self) -> list[str]:
        """What the installed kernel is and does, for the person who starts the agent. Raises as `identify`."""
        kernel = self._now()
        said = [f"LinuxCNC {kernel.version} runs with {kernel.ini_path}"]
        for joint in kernel.joints():
            number, unit = joint["joint"], "deg" if joint["rotary"] else "mm"
            head = f"joint {number}: {joint['letter']} in {unit}, BACKLASH {joint['backlash']:g}"
            if not joint["file"]:
                said.append(f"{head}, no COMP_FILE")
                continue
            rows = sum(line[:1] not in ("", "#") for line in self._files().standing(number).splitlines())
            form = "trims" if joint["type"] else "positions"
            said.append(f"{head}, {joint['file']} with {rows} rows, COMP_FILE_TYPE {joint['type']} ({form})")
        return said

    def _look(self, asked: dict[str, Any]) -> dict[str, Any]:
        """What stands in the way of a push, before one begins: rights of files, pins that are used or missing."""
        kernel, files = self._now(), self._files()
        rights = [files.rights(kernel.joint(axis)) for axis in asked["axes"]]
        return {"rights": [one for found in rights for one in found], "pins": kernel.pins(asked["in"], asked["out"])}

    def _finish(self, asked: dict[str, Any]) -> None:
        if asked["state"] not in _STATES:
            raise AgentRefusal("E-LCNC-ASKED", asked=str(asked["state"])[:40])
        self._files().finish(asked["transaction"], asked["state"])

    def _tables(self, asked: dict[str, Any]) -> dict[str, Any]:
        kernel, files = self._now(), self._files()
        joint = kernel.joint(asked["axis"])
        told = {
            "acting": files.acting(joint) if kernel.screw(joint)[0] is not None else "",
            "standing": files.standing(joint) if kernel.screw(joint)[0] is not None else "",
            "joint": kernel.joints()[joint],
        }
        if (
            self._life() != self._of
        ):  # it ended meanwhile: what it had read would be taken for what the next start reads
            raise AgentRefusal("E-LCNC-DOWN", why="no process milltask")
        return told

    def _program(self, asked: dict[str, Any]) -> str:
        """Place a program beside the INI file, show it to the operator, and read it back."""
        kernel, name = self._now(), str(asked["name"])
        if not name.isalnum():
            raise AgentRefusal("E-LCNC-ASKED", asked=name[:40])
        place: Path = kernel.ini_path.parent / f"{PROGRAM}{name}.ngc"
        write_durably(place, str(asked["text"]).encode())
        kernel.select(place)
        return read_file(place).decode()


def _whole(asked: dict[str, Any], name: str) -> int:
    if type(asked[name]) is not int:
        raise TypeError(name)
    return int(asked[name])
