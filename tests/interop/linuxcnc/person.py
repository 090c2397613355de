#!/usr/bin/python3
"""The person at the mill, as the display that LinuxCNC starts: does what a line of JSON asks, answers with one.

`home`, `start` (Cycle Start), `resume` (the same after a pause), `mdi`, `walk`, `errors`, `true` (where
the slides truly stand), `quit`.
"""

import json
import socket
import time
from pathlib import Path

import hal
import linuxcnc

LONG_S, LOOK_S, STILL = 30.0, 0.01, 4


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
        self.stat.poll()
        if self.stat.task_mode != mode:  # each wait costs a tenth of a second
            self.command.mode(mode)
            self.command.wait_complete(LONG_S)

    def resume(self) -> str:
        """Cycle Start once the program waits at its message."""
        for _ in range(int(LONG_S / LOOK_S)):
            self.stat.poll()
            if self.stat.paused:
                break
            time.sleep(LOOK_S)
        return self.start()

    def start(self) -> str:
        self.stat.poll()
        if self.stat.interp_state == linuxcnc.INTERP_IDLE:
            self._mode(linuxcnc.MODE_AUTO)
            self.command.auto(linuxcnc.AUTO_RUN, 0)
        elif self.stat.paused:
            self.command.auto(linuxcnc.AUTO_RESUME)
        return str(self.stat.file)

    def mdi(self, text: str) -> dict[str, list[float]]:
        return self.walk([text])[0]

    def walk(self, blocks: list[str]) -> list[dict[str, list[float]]]:
        """What `true` says after each of these blocks."""
        self._mode(linuxcnc.MODE_MDI)
        seen = []
        for block in blocks:
            self.command.mdi(block)
            end, still = time.monotonic() + LONG_S, 0
            while still < STILL:
                if time.monotonic() > end:
                    raise TimeoutError(block)
                time.sleep(LOOK_S)
                self.stat.poll()
                taken = self.stat.echo_serial_number == self.command.serial
                idle = self.stat.interp_state == linuxcnc.INTERP_IDLE and self.stat.queue == 0
                still = still + 1 if taken and idle and self.stat.inpos else 0
            seen.append(self.true())
        return seen

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
