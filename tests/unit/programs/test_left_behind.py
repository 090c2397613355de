"""Whatever the program before left in force: measuring, proving, pushing and grinding go where they should."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.sinumerik.ncprogram import measuring, pushing, switching
from drivers.sinumerik.ncprogram.backup import ReservedPoints
from drivers.sinumerik.ncprogram.grinding import GrindSetting, build_grinding_program
from drivers.sinumerik.ncprogram.measuring import MachineSetting
from drivers.sinumerik.ncprogram.words import Phase, Words
from drivers.types.orders import DisableOrder, PushOrder
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from drivers.workpiece import GrindAxis, GrindPlan
from simulators.nck import AxisSpec, Nck, NckSpec

LEFT = (
    "",
    "G70",
    "G700",
    "DIAMON",
    "DIAM90",
    "G54",
    "TRANS X7 Z-9 C5",
    "MIRROR X0 Z0",
    "SCALE X2 Z3",
    "G18 D1",
    "G19 D1",
    "TRANSMIT",
    "TRACYL(60)",
    "G41",
    "G91 G64 G602 G95",
)
AXES = (
    AxisSpec("X1", "X", travel=(-420.0, 120.0), eec_points=(4, 0)),
    AxisSpec("Z1", "Z", travel=(-10.0, 320.0), eec_points=(4, 0)),
    AxisSpec("C1", "C", rotary=True, modulo=True, max_velocity=72000.0, eec_points=(4, 0)),
)
SPEC = NckSpec(
    AXES,
    cec_points=(4,),
    files_max_bytes=65536,
    modal_stays=True,
    diameter_axis="X",
    zero_offset_mm=11.0,
    tool_length_mm=13.0,
    preprocess_ahead=0,
)
NAMES = tuple(axis.name for axis in AXES)
SETTING = MachineSetting(Words(), ReservedPoints(4, (4,), NAMES), modulo=False)
READ = ("R[80]", "R[88]", "R[90]", "$AA_ENC_COMP[0,1,X1]", "$AN_CEC[0,1]")
MAIN = "/_N_MPF_DIR/_N_TFTEST_MPF"
STOPS = tuple(Stop(place, way, 0, label) for label, (place, way) in enumerate(((5.0, 1), (25.0, 1), (5.0, -1))))
TABLE = CompensationTable("axis", "X1", "X1", 0.0, 100.0, 50.0, (0.0, 3.0, 0.0))
CROSS = replace(TABLE, kind="cross", input_axis="Z1")
PART = GrindPlan(
    "TFGRIND_C1",
    "PART",
    GrindAxis("X1", "X", (-420.0, 20.0)),
    GrindAxis("Z1", "Z", (-10.0, 320.0)),
    GrindAxis("C1", "C"),
    None,
    4,
    160.0,
    150.0,
    10.0,
    59.7,
    62.3,
    0.25,
)


class Machine:
    """A control and a hand: NC START, and the echo of every counter; what stood at every stop."""

    def __init__(self) -> None:
        self.clock = LoopClock()
        self.nck = Nck(SPEC, self.clock)
        self.stood: list[tuple[float, ...]] = []
        self.found: dict[str, object] = {}

    def places(self) -> tuple[float, ...]:
        return tuple(round(self.nck.axis_state(name).set_position, 6) for name in NAMES)

    async def begin(self) -> None:
        await self.nck.start()
        for name in NAMES:
            self.nck.reference_axis(name)
        await self.clock.sleep(60.0)
        self.nck.set_mode("AUTO")

    async def run(self, text: str, **words: float) -> None:
        """To the end of the program, through every M0, hand-shake and wait for a release."""
        self.nck.files.write(MAIN, re.sub(r"^; _N_\w+", "; TEST", text).encode())
        for name, value in {"R85": 0.0, "R86": 0.0, **words}.items():
            self.nck.set(f"R[{name[1:]}]", value, 0)
        assert self.nck.select(MAIN) == 0
        assert self.nck.nc_start(), self.nck.alarms
        counted, released = 0.0, False
        for _ in range(20000):
            await self.clock.sleep(0.2)
            assert not self.nck.alarms, self.nck.alarms
            if self.nck.channel_status == 0:
                return
            if self.nck.channel_status == 2:
                self.stood.append(self.places())
                assert self.nck.nc_start()
            elif float(self.nck.get("R[90]")) == Phase.SAVED:
                self.nck.set("R[89]", -4711.0, 0)
            elif float(self.nck.get("R[90]")) == Phase.WAITING and not released:
                released = True
                self.stood.append(self.places())
                self.nck.set("R[85]", 1.0, 0)
                self.nck.set("R[89]", 4711.0, 0)
            elif float(self.nck.get("R[80]")) > counted:
                counted = float(self.nck.get("R[80]"))
                self.stood.append(self.places())
                self.nck.set("R[85]", counted, 0)
        raise AssertionError("the program does not end")


def on_machine(left: str, text: str, **words: float) -> Machine:
    """The machine after a program that left something behind, and then ours."""
    made: list[Machine] = []

    async def job() -> None:
        machine = Machine()
        made.append(machine)
        await machine.begin()
        try:
            await machine.run(f"{left}\nM30\n")
            await machine.run(text, **words)
            machine.found = {name: machine.nck.get(name) for name in READ}
        finally:
            await machine.nck.stop()

    run_virtual(job)
    return made[0]


@pytest.mark.parametrize("left", LEFT)
@pytest.mark.parametrize("letter", ["X", "Z"])
def test_measuring_stops_where_it_should(left: str, letter: str) -> None:
    plan = StopPlan("TFMEAS", f"{letter}1", letter, "mm", False, STOPS, 6000.0, 2.0, 0.1, save_tables=False)
    machine = on_machine(left, measuring.build_measuring_program(plan, 123456, SETTING))
    assert [stop["XZ".index(letter)] for stop in machine.stood] == [5.0, 25.0, 5.0]
    assert machine.found["R[90]"] == 7.0


@pytest.mark.parametrize("left", LEFT)
@pytest.mark.parametrize("table", [TABLE, CROSS])
def test_a_table_is_proved_and_pushed_at_the_agreeing_position(left: str, table: CompensationTable) -> None:
    letter = table.input_axis[0]
    order = PushOrder(4711, table, letter, False, True, 15.0, "sign-proof")
    machine = on_machine(left, pushing.build_push_program([(order, SETTING)]))
    assert [stop["XZ".index(letter)] for stop in machine.stood] == [15.0, 15.0]
    name = "$AA_ENC_COMP[0,1,X1]" if table is TABLE else "$AN_CEC[0,1]"
    assert machine.found[name] == pytest.approx(0.003)
    assert machine.found["R[90]"] == 5.0


@pytest.mark.parametrize("left", LEFT)
def test_a_part_is_ground_at_its_place_and_a_table_switched_off_without_a_move(left: str) -> None:
    setting = GrindSetting(Words(), {name: ReservedPoints(4, (4,), NAMES) for name in NAMES})
    machine = on_machine(
        left, build_grinding_program(replace(PART, save_tables=False), 4711, setting), R77=0.1, R78=0.01, R89=4711.0
    )
    assert {stop[:2] for stop in machine.stood} == {(PART.retracted_mm, PART.ends_mm[0])}
    assert machine.found["R[80]"] == 4.0
    still = on_machine(left, switching.build_disable_program(DisableOrder(4711, "axis", "X1", 0), SETTING))
    assert still.found["R[90]"] == 15.0
