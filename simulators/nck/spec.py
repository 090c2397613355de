"""What kind of control and machine the double is: frozen set-up, and the refusal it answers with."""

from __future__ import annotations

from dataclasses import dataclass


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
    reset; any other loses it. Modulo axes have no travel limits.
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


@dataclass(frozen=True, slots=True)
class NckSpec:
    """The control. ``access_level`` 0..7, smaller has more rights (0 Siemens, 2 service, 3 user, 4..7 key).

    ``strict_activation``: changed table content acts only after an NCK reset, else after NEWCONF or channel
    reset. ``cec_sign``: +1 as EEC (a positive value moves the axis negative), -1 the other way.
    ``cec_factor_tables_count``: with MULT_BY_TABLE, both factors' own outputs count besides the product.
    ``fetch_while_waiting``: files may be read while a program waits. ``lies_about_disable``: MD32700 reads 0
    but the compensation goes on until the next NCK reset. ``enable_cleared_at_boot``: MD32700 and MD32710 are
    0 after an NCK reset. ``float32_tables``: table values are kept in single precision.
    """

    axes: tuple[AxisSpec, ...]
    serial: str = "ST-DOUBLE-0001"
    nck_version: str = "4.8.6"
    access_level: int = 2
    strict_activation: bool = True
    cec_sign: int = 1
    cec_factor_tables_count: bool = False
    fetch_while_waiting: bool = True
    r_writable: bool = True
    unit_system: str = "metric"
    cec_points: tuple[int, ...] = ()
    option_cec: bool = True
    r_count: int = 1000
    files_max_bytes: int = 2_000_000
    files_max_total: int = 50_000_000
    files_max_count: int = 1000
    table_memory_bytes: int = 2_000_000
    block_time_s: float = 0.0005
    ipo_cycle_s: float = 0.004
    boot_s: float = 5.0
    lies_about_disable: bool = False
    enable_cleared_at_boot: bool = False
    float32_tables: bool = False

    def __post_init__(self) -> None:
        names = [axis.name.upper() for axis in self.axes]
        letters = [axis.letter.upper() for axis in self.axes]
        if not names or len(set(names)) != len(names) or len(set(letters)) != len(letters):
            raise ValueError("axes need names and letters of their own")
        if self.cec_sign not in (1, -1) or not 0 <= self.access_level <= 7:
            raise ValueError("cec_sign is 1 or -1 and access_level 0..7")
