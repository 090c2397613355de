"""The people at the simulated machine: one presses its keys, one carries files to a control without a connection.

`Operator` acts on three things that a person sees: the MSG line of a stopped program (mount a set-up, put a shim,
load a blank, restart the control), the lamp of the PLC's panel, and a program that is selected but not started. Each
act takes a person's time on the cell's clock. What he sees and presses are the protocols `ShownControl`,
`OperatorPanel` and `WorkPlace`; `simulators.cell` implements them. `OfflineOperator` reads the sheet of a folder,
copies programs from it, runs them, and puts the resulting files back.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

from drivers.clock import Clock
from simulators.cellfile import OperatorSection as OperatorSpec
from simulators.optics import OpticsBench


class ShownControl(Protocol):
    """What an operator sees on the control's screen and can press on its panel."""

    @property
    def channel_status(self) -> int:
        """0 reset, 1 active, 2 interrupted."""
        ...

    @property
    def message(self) -> str:
        """The MSG line."""
        ...

    @property
    def selections(self) -> int:
        """How many programs have been selected so far."""
        ...

    @property
    def selected(self) -> str:
        """The program that is selected."""
        ...

    @property
    def in_alarm(self) -> bool:
        """Whether an alarm stands that RESET clears."""
        ...

    def select(self, path: str) -> bool:
        """Select a program on the screen; False when the control does not take it now."""
        ...

    def nc_start(self) -> Any:
        """The green button."""
        ...

    def channel_reset(self) -> Any:
        """The reset button."""
        ...

    def nck_reset(self) -> Any:
        """Restart the NCK."""
        ...

    @property
    def ready(self) -> bool:
        """False while the NCK starts."""
        ...

    def referenced(self, name: str) -> bool:
        """Whether the screen shows the axis as referenced."""
        ...

    def reference_axis(self, name: str) -> Any:
        """Reference run of one axis."""
        ...

    def set_mode(self, mode: str) -> Any:
        """AUTO, JOG or MDA."""
        ...

    def jog(self, name: str, position: float) -> float:
        """Move one axis by hand; seconds it takes."""
        ...


class OperatorPanel(Protocol):
    """The PLC mailbox's lamps and buttons."""

    @property
    def lamp(self) -> bool:
        """Whether the PLC waits for the confirm button."""
        ...

    def confirm(self) -> bool:
        """The confirm button."""
        ...

    @property
    def release_wanted(self) -> bool | None:
        """True: on, please; False: off, please; None: as it is."""
        ...

    def set_release(self, *, given: bool) -> Any:
        """The local release switch."""
        ...

    @property
    def tables_loaded(self) -> int:
        """Tables that came through the PLC so far."""
        ...

    @property
    def acts_from(self) -> str:
        """When changed tables act: newconf, nck_reset or power_on."""
        ...

    async def power_cycle(self) -> None:
        """The main switch off and on."""
        ...


class WorkPlace(Protocol):
    """The table of the machine, where parts are clamped."""

    def load(self) -> bool:
        """Clamp a new blank; False when there is none."""
        ...

    def unload(self) -> bool:
        """Take the part off; False when nothing was there."""
        ...

    def change_wheel(self, number: int) -> bool:
        """Put on the roughing (1) or the finishing wheel (2); False when there is nothing to grind."""
        ...


SETUP = re.compile(r"TRUEFLANK SETUP (?P<component>\S+) ON (?P<letter>[A-Z])$")
STEP = re.compile(r"TRUEFLANK STEP (?P<component>\S+) (?P<size>[0-9.]+) ON (?P<letter>[A-Z])$")
# The second words are those of the builder's own cycle.
BLANK = re.compile(r"TRUEFLANK LOAD BLANK(?: .*)?$|CLAMP WORKPIECE$")
UNLOAD = re.compile(r"TRUEFLANK UNLOAD PART(?: .*)?$|REMOVE WORKPIECE$")
WHEEL = re.compile(r"CHANGE TO WHEEL (?P<number>[12])$")
ACTIVATE = re.compile(r"TRUEFLANK ACTIVATE NCK RESET AND REFERENCE (?P<axis>\S+( \S+)*)$")
SELF_TEST = re.compile(r"TRUEFLANK SELF-TEST PRESS NC START$")
PROBE_PREFIX = "_N_TFPROBE_"  # programs that are meant to be refused: the person who tries them presses RESET
RESET, ACTIVE, INTERRUPTED = 0, 1, 2
SELF_TEST_PREFIX = "TFSELF_"  # a self-test whose last word the control does not take
LOOK_S, READS_S = 0.5, 10.0  # between two looks; to read an alarm and note its number
KEYS = ("RESET", "NC START", "NCK RESET")
# Kept in the same box: what someone takes who takes the wrong ones.
MIXED_UP_OPTICS = {
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
            (WHEEL, self._change_wheel),
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
        self._bench.mount(setup, MIXED_UP_OPTICS[setup.optics] if wrong else None)
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

    async def _change_wheel(self, found: re.Match[str]) -> None:
        await self._clock.sleep(self.spec.load_delay_s)
        done = self._table is not None and self._table.change_wheel(int(found["number"]))
        self._go_on(f"changed to wheel {found['number']}" if done else "no wheel to change")

    def select(self, path: str) -> bool:
        """Select a program on the screen, as the shop does with its own; it is started like any that is selected."""
        done = self._control.select(path)
        self.log.append(f"selected {path}" if done else f"could not select {path}")
        return done

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
    return PROBE_PREFIX in selected or SELF_TEST_PREFIX in selected


# Without a connection: the sheet in the folder is all that this person knows of the gateway.

POLL_S = 0.25
LOOKS_S = 5.0
_STEP = re.compile(r"^step = (\d+)$", re.MULTILINE)
_RESTART = "NCK reset"
SHEET_NOT_DONE = "NOTHING WAS DONE"


class OfflineOperator:
    """Works at one simulated control by its panel and files; of the gateway it sees only the folder."""

    def __init__(self, nck: Any, clock: Clock, folder: Path) -> None:
        self._nck = nck
        self._clock = clock
        self._folder = folder
        self._task: asyncio.Task[None] | None = None
        self.read: list[str] = []

    def start(self) -> None:
        """From now on go whenever there is a new sheet."""
        self._task = asyncio.get_running_loop().create_task(self._watch_sheets())

    async def stop(self) -> None:
        """Go home."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def _watch_sheets(self) -> None:
        """For ever: each sheet once, by the number in its form, some time after it was laid out."""
        done: set[str] = set()
        while True:
            await self._clock.sleep(LOOKS_S)
            form = self._folder / "carry" / "SEEN.toml"
            sheet = self._folder / "carry" / "SHEET.txt"
            text = form.read_text(encoding="utf-8") if form.exists() and sheet.exists() else ""
            if text and text not in done:
                done.add(text)
                await self._clock.sleep(LOOKS_S)
                await self.work_through_sheet()

    async def work_through_sheet(self, *, only: str = "") -> None:
        """Everything that the sheet asks for; ``only`` another program than the sheet's."""
        folder = self._folder
        carry = folder / "carry"
        sheet = (carry / "SHEET.txt").read_text(encoding="utf-8")
        if _RESTART in sheet:
            await self.restart_control()
        self.copy_programs(carry)
        program = only or sheet.partition("\n")[0].rpartition(": ")[2].strip()
        await self.run_program(program)
        self.collect_files()

    def copy_programs(self, carry: Path) -> None:
        """Every program on the stick into the part programs."""
        for path in carry.glob("*.MPF"):
            self._nck.files.write(f"/_N_MPF_DIR/_N_{path.stem}_MPF", path.read_bytes())

    async def run_program(self, program: str) -> None:
        """Select it, NC START, and on at every M0 until its end."""
        nck = self._nck
        if nck.channel_status != 0:
            nck.channel_reset()
        if nck.select(f"/_N_MPF_DIR/_N_{program.replace('.', '_')}") != 0:
            raise LookupError(program)
        nck.set_mode("AUTO")
        nck.nc_start()
        await self._clock.sleep(POLL_S)
        while nck.channel_status != 0 and not nck.alarms:
            if nck.channel_status == 2:
                self.read.append(nck.message)
                nck.nc_start()
            await self._clock.sleep(POLL_S)

    async def restart_control(self) -> None:
        """NCK reset, then every axis to its reference."""
        self._nck.nck_reset()
        await self.ready()

    async def ready(self) -> None:
        """Wait for the control, reference what is not, choose AUTO."""
        nck = self._nck
        while nck.booting:
            await self._clock.sleep(0.5)
        names = [axis.name for axis in nck.spec.axes]
        for name in names:
            if not nck.axis_state(name).referenced:
                nck.reference_axis(name)
        while not all(nck.axis_state(name).referenced for name in names):
            await self._clock.sleep(POLL_S)
        nck.set_mode("AUTO")

    def collect_files(self) -> None:
        """Every file of the subprograms, and the form filled in as the screen shows it."""
        folder = self._folder
        back = folder / "back"
        for name in self._nck.files.list("/_N_SPF_DIR"):
            stem, _, ending = name.removeprefix("_N_").rpartition("_")
            (back / f"{stem}.{ending}").write_bytes(self._nck.files.read(f"/_N_SPF_DIR/{name}"))
        form = (folder / "carry" / "SEEN.toml").read_text(encoding="utf-8")
        step = _STEP.search(form)
        alarms = ", ".join(str(alarm.number) for alarm in self._nck.alarms)
        level = self._nck.core.access_level
        text = f"step = {step[1] if step else 0}\nalarms = [{alarms}]\naccess_level = {level}\n"
        (back / "SEEN.toml").write_text(text, encoding="utf-8")
