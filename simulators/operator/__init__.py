"""The person at the machine: does what MSG says, presses NC START, and minds the PLC's panel, unless told not to."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Awaitable, Callable, Sequence

from drivers.clock import Clock
from simulators.cellfile import OperatorSection as OperatorSpec
from simulators.operator.panel import OperatorPanel, ShownControl, WorkPlace
from simulators.optics import OpticsBench

SETUP = re.compile(r"TRUEFLANK SETUP (?P<component>\S+) ON (?P<letter>[A-Z])$")
STEP = re.compile(r"TRUEFLANK STEP (?P<component>\S+) (?P<size>[0-9.]+) ON (?P<letter>[A-Z])$")
BLANK = re.compile(r"TRUEFLANK LOAD BLANK(?: .*)?$")
UNLOAD = re.compile(r"TRUEFLANK UNLOAD PART(?: .*)?$")
ACTIVATE = re.compile(r"TRUEFLANK ACTIVATE NCK RESET AND REFERENCE (?P<axis>\S+( \S+)*)$")
SELF_TEST = re.compile(r"TRUEFLANK SELF-TEST PRESS NC START$")
PROBE = "_N_TFPROBE_"  # programs that are meant to be refused: the person who tries them presses RESET
RESET, ACTIVE, INTERRUPTED = 0, 1, 2
SELF = "TFSELF_"  # a self-test whose last word the control does not take
LOOK_S, READS_S = 0.5, 10.0  # between two looks; to read an alarm and note its number
KEYS = ("RESET", "NC START", "NCK RESET")
# Kept in the same box: what someone takes who takes the wrong ones.
WRONG = {
    "linear": "angular",
    "angular": "linear",
    "rotary": "linear",
    "straightness": "angular",
    "level": "angular",
    "square": "straightness",
    "ball": "bar",
    "bar": "ball",
}


class Operator:
    """Watches the control and acts, one message at a time, with a person's delays in the cell's clock."""

    def __init__(
        self,
        spec: OperatorSpec,
        control: ShownControl,
        bench: OpticsBench,
        clock: Clock,
        axes: Sequence[str],
        panel: OperatorPanel | None = None,
        table: WorkPlace | None = None,
    ) -> None:
        self.spec = spec
        self._control = control
        self._bench = bench
        self._clock = clock
        self._axes = tuple(axes)
        self._started = control.selections
        self._panel = panel
        self._table = table
        self._restarted = 0
        self._task: asyncio.Task[None] | None = None
        self.log: list[str] = []

    def change(self, **options: object) -> None:
        """Become another kind of operator: fields of the cell file's operator section.

        Who comes back to work (``auto``) does not start what was selected while nobody was there.
        """
        if not self.spec.auto:
            self._started = self._control.selections
        self.spec = OperatorSpec.model_validate({**self.spec.model_dump(), **options})

    def start(self) -> None:
        """Come to work."""
        self._task = asyncio.get_running_loop().create_task(self._watch(), name="operator")

    async def stop(self) -> None:
        """Go home."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    async def _watch(self) -> None:
        done = ""
        while True:
            await self._clock.sleep(LOOK_S)
            status = self._control.channel_status
            if status != INTERRUPTED:
                done = ""
            if not self.spec.auto:
                continue
            if self._panel is not None:
                await self._mind(self._panel)
            if status == RESET and self._control.selections != self._started:
                await self._begin()
            elif status == INTERRUPTED and self._control.in_alarm and _resets(self._control.selected):
                await self._clock.sleep(READS_S)
                self.press("RESET")
            elif status == INTERRUPTED and self._control.message != done:
                done = self._control.message
                await self._act(done)

    async def _begin(self) -> None:
        self._started = self._control.selections
        await self._clock.sleep(self.spec.start_delay_s)
        if self._control.channel_status == RESET:
            self.press("NC START")

    def press(self, key: str) -> None:
        """One of `KEYS` on the machine's panel, whatever the operator does by himself. Raises KeyError."""
        acts: dict[str, Callable[[], object]] = {
            "RESET": self._control.channel_reset,
            "NC START": self._control.nc_start,
            "NCK RESET": self._control.nck_reset,
        }
        act = acts[key]
        self.log.append(key)
        act()

    async def _act(self, message: str) -> None:
        acts: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], Awaitable[None]]], ...] = (
            (SETUP, self._set_up),
            (STEP, self._step),
            (BLANK, self._load_blank),
            (UNLOAD, self._unload_part),
            (ACTIVATE, self._activate),
            (SELF_TEST, self._go_on_with_test),
        )
        for pattern, act in acts:
            found = pattern.fullmatch(message.strip())
            if found is not None:
                await act(found)
                return

    async def _set_up(self, found: re.Match[str]) -> None:
        setup = self._bench.setup_for(found["component"], found["letter"])
        if setup is None:
            self.log.append(f"nothing to mount for {found['component']} on {found['letter']}")
            return
        await self._clock.sleep(self.spec.setup_delay_s)
        if self._table is not None and self._table.unload():
            self.log.append("took the part off")
        wrong = setup.component in self.spec.mounts_wrong
        if setup.component in self.spec.mounts_reversed:
            setup = setup.model_copy(update={"reversed": not setup.reversed})
        self._bench.mount(setup, WRONG[setup.optics] if wrong else None)
        self.log.append(f"mounted {setup.component} on {setup.axis}")
        if self._control.channel_status == INTERRUPTED:
            self.press("NC START")

    async def _step(self, found: re.Match[str]) -> None:
        """A shim under the optics, or out again."""
        await self._clock.sleep(self.spec.step_delay_s)
        self._bench.steps[found["component"]] = float(found["size"])
        self._go_on(f"stepped {found['component']} by {found['size']}")

    async def _load_blank(self, _found: re.Match[str]) -> None:
        await self._clock.sleep(self.spec.load_delay_s)
        self._go_on("clamped a blank" if self._table is not None and self._table.load() else "no blank to clamp")

    async def _unload_part(self, _found: re.Match[str]) -> None:
        await self._clock.sleep(self.spec.load_delay_s)
        self._go_on("took the part off" if self._table is not None and self._table.unload() else "no part to take off")

    async def _go_on_with_test(self, _found: re.Match[str]) -> None:
        await self._clock.sleep(self.spec.start_delay_s)
        self._go_on("went on with the self-test")

    def _go_on(self, done: str) -> None:
        self.log.append(done)
        if self._control.channel_status == INTERRUPTED and not done.startswith("no "):
            self.press("NC START")

    async def _activate(self, _found: re.Match[str]) -> None:
        await self._clock.sleep(self.spec.activate_delay_s)
        if self._control.channel_status != INTERRUPTED:
            return  # whoever ended the program meanwhile does not want it any more
        self._control.nck_reset()
        self.log.append("NCK RESET")
        await self.power_up()

    async def _mind(self, panel: OperatorPanel) -> None:
        """The PLC's panel: give and take back the release, press the button, let tables act."""
        wanted = panel.release_wanted
        if wanted is not None and self.spec.gives_release:
            await self._clock.sleep(self.spec.release_delay_s)
            panel.set_release(given=wanted)
            self.log.append("RELEASE ON" if wanted else "RELEASE OFF")
        if panel.lamp and self.spec.confirms:
            await self._clock.sleep(self.spec.confirm_delay_s)
            if panel.confirm():
                self.log.append("CONFIRM")
                await self._let_tables_act(panel)

    async def _let_tables_act(self, panel: OperatorPanel) -> None:
        """After a table that came through the PLC: restart the control if this one needs it."""
        fresh, self._restarted = panel.tables_loaded > self._restarted, panel.tables_loaded
        if not fresh or not self.spec.restarts or panel.acts_from == "newconf":
            return
        await self._clock.sleep(self.spec.activate_delay_s)
        if panel.acts_from == "nck_reset":
            self.log.append("NCK RESET")
            self._control.nck_reset()
        else:
            self.log.append("POWER OFF AND ON")
            await panel.power_cycle()
        await self.power_up()

    async def jog(self, axis: str, position: float) -> None:
        """Move an axis by hand to a position and wait until it stands there; back to AUTO."""
        seconds = self._control.jog(axis, position)
        self.log.append(f"JOG {axis} {position:g}")
        await self._clock.sleep(seconds + LOOK_S)
        self._control.set_mode("AUTO")

    async def power_up(self) -> None:
        """Wait for the control to start, reference every axis, and go to AUTO: any morning's work."""
        while not self._control.ready:
            await self._clock.sleep(LOOK_S)
        for name in self._axes:
            self._control.reference_axis(name)
        for name in self._axes:
            while not self._control.referenced(name) and self._control.ready:
                await self._clock.sleep(LOOK_S)
        self._control.set_mode("AUTO")


def _resets(selected: str) -> bool:
    """Whether a person who reads this program's alarm presses RESET, and nothing else."""
    return PROBE in selected or SELF in selected
