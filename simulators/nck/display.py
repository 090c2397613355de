"""What a person at the panel, a bus or an instrument can see of the control."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from simulators.nck.channel import Channel, Mode
from simulators.nck.machine.alarms import Alarm
from simulators.nck.machine.axis import AxisView
from simulators.nck.machine.core import Core
from simulators.nck.machine.files import FileSystem
from simulators.nck.program.variables import Variables, split_name
from simulators.nck.spec import NckSpec
from simulators.nck.values import Value

Array = NDArray[np.float64]


class Display:
    """The control as it shows itself; nothing here changes it."""

    def __init__(
        self, spec: NckSpec, clock: Clock, power_cut: Callable[[], None], at_block: Callable[[int], None]
    ) -> None:
        self.spec = spec
        self.core = Core(spec, clock)
        self.variables = Variables(self.core)
        self.channel = Channel(self.core, self.variables, power_cut, at_block)
        self.booting = False

    @property
    def channel_status(self) -> int:
        """0 reset, 1 active, 2 interrupted."""
        return self.channel.status

    @property
    def program_status(self) -> int:
        """1 interrupted, 2 stopped, 3 running, 5 aborted (also after a program's end)."""
        return self.channel.program_status

    @property
    def program_line(self) -> int:
        """Source line under execution, from 1; 0 in reset."""
        return self.channel.line

    @property
    def program_name(self) -> str:
        """Name of the program under execution, else of the one selected."""
        return self.channel.program_name

    @property
    def selected(self) -> str:
        """Path of the selected program, or ""."""
        return self.channel.selected

    @property
    def mode(self) -> Mode:
        """AUTO, JOG or MDA."""
        return self.channel.mode

    @property
    def message(self) -> str:
        """The part program's MSG text."""
        return self.channel.message

    @property
    def files(self) -> FileSystem:
        """The file system."""
        return self.channel.files

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Alarms standing, oldest first."""
        return self.core.alarms.standing

    @property
    def access_level(self) -> int:
        """Protection level active, 0..7; smaller has more rights."""
        return self.core.access_level

    def axis_state(self, name: str) -> AxisView:
        """An axis now, by machine name, AXn or letter. Raises NckRefusal 12550."""
        return self.core.view(self.core.axis(name).index)

    def axis_stat(self, name: str) -> int:
        """``$AA_STAT`` of an axis now: what `axis_state` says of it, without the rest. Raises NckRefusal 12550."""
        return self.core.axis(name).state(self.core.clock.now())

    def encoder(self, axis: str, times: Array) -> tuple[Array, Array]:
        """Place of the axis in terms of encoder 1 (mm or deg, turns unlimited) and sign of last travel.

        At clock times in the past up to now; about the last 90 s are kept. Raises NckRefusal 12550.
        """
        found = self.core.axis(axis)
        wanted = np.asarray(times, dtype=np.float64)
        return found.encoders(wanted), found.directions(wanted)

    def get(self, name: str) -> Value:
        """A variable by its NC name. Raises NckRefusal 12550, 17020, 17030."""
        return self.variables.read(*split_name(name))
