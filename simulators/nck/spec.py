"""The frozen set-up of a simulated control and its machine, and the refusal with which it answers."""

from __future__ import annotations

from dataclasses import dataclass

from simulators.nck.switches import Switches

MOST_AXES = 31


class NckRefusal(Exception):
    """The control refuses: alarm number as on its screen (0: a service refuses without an alarm) and text."""

    def __init__(self, number: int, text: str) -> None:
        super().__init__(number, text)
        self.number = number
        self.alarm_number = number
        self.text = text

    def __str__(self) -> str:
        return f"{self.number} {self.text}" if self.number else self.text


@dataclass(frozen=True, slots=True)
class AxisSpec:
    """One machine axis. Lengths in mm or deg, ``max_velocity`` in units per minute.

    ``eec_points`` is MD38000 for encoder 1 and 2. An axis with an absolute encoder keeps its reference over a
    reset; any other loses it. Modulo axes have no travel limits. ``encoder2_offset``: what encoder 2 shows
    more than encoder 1 at the same place of the machine. ``encoder`` is the measuring system, 0 or 1, that the PLC
    selects at power on. ``number`` of the machine axis, 0 for the one after the axis
    before it: MD10000 has an empty name where a number is left out.
    """

    name: str
    letter: str
    rotary: bool = False
    modulo: bool = False
    travel: tuple[float, float] = (-1000.0, 1000.0)
    reference: float = 0.0
    max_velocity: float = 10000.0
    servo_time_s: float = 0.03
    eec_points: tuple[int, int] = (0, 0)
    absolute_encoder: bool = False
    encoder2_offset: float = 0.0
    encoder: int = 0
    number: int = 0


@dataclass(frozen=True, slots=True)
class NckSpec(Switches):
    """The control; what is uncertain or hostile about it stands in `Switches`.

    ``access_level`` 0..7, smaller has more rights (0 Siemens, 2 service, 3 user, 4..7 key switch).
    ``option_cec``: the option for CEC is there, for ``option_cec_axes`` compensation axes at most.
    ``files_max_bytes``: MD11420, to the kB; the control's own default is small.
    ``dresser`` is the axis that the machine's PLC keeps still while the wheel runs.
    ``gud``: global user data, REAL arrays by name and length. ``redefined``: the write level that the machine's builder
    gave a datum (REDEF name APW level), in place of the control's own.
    ``serial`` is MD18030, the card's number; ``hardware`` the number that the control gives
    for its type.
    """

    axes: tuple[AxisSpec, ...]
    serial: str = "ST-DOUBLE-0001"
    nck_version: str = "4.8.6"
    hardware: float = 10000.0
    access_level: int = 2
    unit_system: str = "metric"
    cec_points: tuple[int, ...] = ()
    option_cec: bool = True
    option_cec_axes: int = 31
    r_count: int = 1000
    gud: tuple[tuple[str, int], ...] = ()
    redefined: tuple[tuple[str, int], ...] = ()
    files_max_bytes: int = 1024
    files_max_total: int = 50_000_000
    files_max_count: int = 1000
    table_memory_bytes: int = 2_000_000
    block_time_s: float = 0.0005
    ipo_cycle_s: float = 0.004
    boot_s: float = 5.0
    dresser: str = ""

    @property
    def numbers(self) -> tuple[int, ...]:
        """The number of each machine axis, from 1."""
        found: list[int] = []
        for axis in self.axes:
            found.append(axis.number or (found[-1] if found else 0) + 1)
        if self.axes_swapped:
            found[-2:] = found[-2:][::-1]
        return tuple(found)

    @property
    def identity(self) -> tuple[str, str, float]:
        """What the control says of itself: card number, version, hardware."""
        return (
            self.card_exchanged or self.serial,
            self.software_updated or self.nck_version,
            self.hardware_exchanged or self.hardware,
        )

    def level_of(self, name: str, own: int) -> int:
        """The level that may write a datum: the builder's where he gave one, else the control's ``own``."""
        return dict(self.redefined).get(name, own)

    @property
    def places(self) -> tuple[str, ...]:
        """Machine axis names by number, "" where there is no axis (MD10000)."""
        names = dict(zip(self.numbers, (axis.name for axis in self.axes), strict=True))
        return tuple(names.get(number, "") for number in range(1, max(names) + 1))

    def __post_init__(self) -> None:
        names = [axis.name.upper() for axis in self.axes]
        letters = [axis.letter.upper() for axis in self.axes]
        if not names or len(set(names)) != len(names) or len(set(letters)) != len(letters):
            raise ValueError("axes need names and letters of their own")
        numbers = self.numbers[:-2] + tuple(sorted(self.numbers[-2:]))
        if list(numbers) != sorted(set(numbers)) or numbers[-1] > MOST_AXES:
            raise ValueError(f"axis numbers must rise and end at {MOST_AXES}")
        if self.unit_system not in ("metric", "inch") or not 0 <= self.access_level <= 7:
            raise ValueError("unit_system is metric or inch and access_level 0..7")
        if any(axis.encoder not in (0, 1) for axis in self.axes) or any(not 0 <= one <= 7 for _, one in self.redefined):
            raise ValueError("an axis' encoder is 0 or 1, a level given by REDEF 0..7")
        self.checked()
