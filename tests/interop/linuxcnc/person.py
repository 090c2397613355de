#!/usr/bin/python3
"""The person at the mill, as the display that LinuxCNC starts: does what a line of JSON asks, answers with one.

`home`, `start` (Cycle Start, also after a pause), `mdi`, `errors`, `true` (where the slides truly stand), `quit`.
"""

import json
import socket
import time
from pathlib import Path

import hal
import linuxcnc

LONG_S = 30.0


class Person:
    """Someone with eyes for the machine and fingers for its buttons."""

    def __init__(self) -> None:
        self.stat, self.command, self.channel = linuxcnc.stat(), linuxcnc.command(), linuxcnc.error_channel()
        self.component = hal.component("person")
        self.component.ready()

    def home(self) -> list[int]:
        self.command.state(linuxcnc.STATE_ESTOP_RESET)
        self.command.wait_complete(LONG_S)
        self.command.state(linuxcnc.STATE_ON)
        self.command.wait_complete(LONG_S)
        self._mode(linuxcnc.MODE_MANUAL)
        self.command.teleop_enable(0)
        self.command.wait_complete(LONG_S)
        self.command.home(-1)
        for _ in range(300):
            self.stat.poll()
            if all(self.stat.homed[:4]):
                break
            time.sleep(0.02)
        return list(self.stat.homed[:4])

    def _mode(self, mode: int) -> None:
        self.command.mode(mode)
        self.command.wait_complete(LONG_S)

    def start(self) -> str:
        self.stat.poll()
        if self.stat.interp_state == linuxcnc.INTERP_IDLE:
            self._mode(linuxcnc.MODE_AUTO)
            self.command.auto(linuxcnc.AUTO_RUN, 0)
        elif self.stat.paused:
            self.command.auto(linuxcnc.AUTO_RESUME)
        return str(self.stat.file)

    def mdi(self, text: str) -> dict[str, list[float]]:
        self._mode(linuxcnc.MODE_MDI)
        self.command.mdi(text)
        self.command.wait_complete(LONG_S)
        still = 0
        while still < 5:  # another client's commands may have answered for ours: look until nothing moves
            time.sleep(0.02)
            self.stat.poll()
            idle = self.stat.interp_state == linuxcnc.INTERP_IDLE and self.stat.queue == 0
            still = still + 1 if idle and self.stat.inpos else 0
        return self.true()

    def stop(self) -> None:
        self.command.abort()
        self.command.wait_complete(LONG_S)

    def errors(self) -> list[str]:
        found = []
        while (said := self.channel.poll()) is not None:
            found.append(str(said[1]))
        return found

    def true(self) -> dict[str, list[float]]:
        return {
            "true": [hal.get_value(f"plant.true-{joint}") for joint in range(4)],
            "trim": [hal.get_value(f"joint.{joint}.backlash-filt") for joint in range(4)],
        }


def main() -> None:
    """One line in, one line out, until `quit`; LinuxCNC ends with its display."""
    listener = socket.create_server(("127.0.0.1", 0))
    Path("person.part").write_text(str(listener.getsockname()[1]))
    Path("person.part").rename("person.port")
    person = Person()
    while True:
        wire, _ = listener.accept()
        with wire, wire.makefile("rw") as lines:
            for line in lines:
                do, *rest = json.loads(line)
                if do == "quit":
                    return
                lines.write(json.dumps(getattr(person, do)(*rest)) + "\n")
                lines.flush()


if __name__ == "__main__":
    main()
