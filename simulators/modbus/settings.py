"""Set-up and faults of the PLC: the keys of a cell file's [machine.modbus]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal

from drivers.errors import ConfigError


@dataclass(frozen=True, slots=True)
class PlcSettings:
    """An honest PLC by default. Commands are named by their number in docs/plc-mailbox-reference.md, 0 is none.

    Set-up: ``framer`` "tcp" or "rtu"; ``port`` a TCP port (0: any free one) or a serial port's name (RTU only);
    ``client_url`` what the site file prints for it, where that is not the same (the other end of a cable);
    ``baudrate``, ``parity``, ``unit``; ``word_order`` as printed in the site file; ``scan_s`` the program cycle;
    ``points_a_scan`` how many points pass between PLC and NCK in one cycle; ``session_s`` and ``confirm_s``;
    ``write_level`` the protection level the PLC writes machine data with; ``retentive``: marker and half-written
    marks outlive a power cut; ``parameters_first``: command 4 writes MIN, STEP and MAX before the points.

    Hostile: ``swap_words`` low word first, unannounced; ``swap_data_words`` the data of chunks alone read with
    the words swapped; ``map_version``; ``stale_heartbeat``; ``wrong_read_back_crc``; ``late_command`` is taken
    from the wire ``late_s`` later and never answered, once; ``redo_repeats`` does a repeated number again;
    ``lies_about_disable`` says off and leaves it on; ``float32_values`` and ``quantum_points`` (nm or 1e-7 deg)
    coarsen points on their way to the NCK, unnoticed; ``accepts_wrong_length``: error 3 does not exist;
    ``lose_points`` the last so many of each chunk keep what the NCK held before; ``careless``: command 4 does not
    compare; ``busy_forever`` that command never ends; ``key_back`` the release is taken back between the
    panel's confirm and the switching; ``alarm_during`` raises an alarm while that command is under way;
    ``power_cut_after`` points have gone into the NCK in command 4: the mains fail, once; ``overwrites`` pairs of
    register and value that the PLC program sets in every cycle; ``second_master`` after so many commands, once,
    another PC puts one of its own; ``nck_refuses`` that command ends with error 11 and ``nck_result``;
    ``other_backlash`` so much (nm or 1e-7 deg) is added to each backlash, unnoticed;
    ``confirm_dead``: the panel's button is not wired; ``enables_itself``: while that command is under way the
    control switches every table that was ever loaded on; ``enables_twice_s``: command 5 is done once more that many
    seconds after it was done; ``forgets``: while that command is under way the PLC and its control forget what
    ``forgets_what`` says: "words" (marker, half-written marks, session), "memory" (points of tables) or "switch".

    Of a serial line's adapter: ``local_echo`` gives back what was sent, glued to the answer where there is one;
    ``leading_zeros`` so many zero bytes stand before each answer.
    """

    framer: Literal["tcp", "rtu"] = "tcp"
    port: int | str = 0
    client_url: str = ""
    baudrate: int = 115_200
    parity: Literal["N", "E", "O"] = "N"
    unit: int = 1
    word_order: Literal["high-first", "low-first"] = "high-first"
    scan_s: float = 0.02
    points_a_scan: int = 50
    session_s: float = 5.0
    confirm_s: float = 60.0
    write_level: int = 0
    retentive: bool = True
    parameters_first: bool = False
    swap_words: bool = False
    swap_data_words: bool = False
    map_version: int = 3
    stale_heartbeat: bool = False
    wrong_read_back_crc: bool = False
    late_command: int = 0
    late_s: float = 3.0
    redo_repeats: bool = False
    lies_about_disable: bool = False
    float32_values: bool = False
    quantum_points: int = 0
    accepts_wrong_length: bool = False
    lose_points: int = 0
    careless: bool = False
    busy_forever: int = 0
    key_back: bool = False
    alarm_during: int = 0
    power_cut_after: int = 0
    overwrites: tuple[tuple[int, int], ...] = ()
    second_master: int = 0
    other_backlash: int = 0
    nck_refuses: int = 0
    nck_result: int = 5
    confirm_dead: bool = False
    enables_itself: int = 0
    enables_twice_s: float = 0.0
    forgets: int = 0
    forgets_what: Literal["words", "memory", "switch"] = "switch"
    local_echo: bool = False
    leading_zeros: int = 0

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> PlcSettings:
        """Settings from a cell file. Raises ConfigError (E-CFG-SETTING, E-CFG-SETTING-VALUE)."""
        kinds = {entry.name: entry for entry in fields(cls)}
        for key, value in given.items():
            if key not in kinds:
                raise ConfigError("E-CFG-SETTING", "modbus", key=key, known=", ".join(kinds))
            _check(key, value, kinds[key].default)
        pairs = {"overwrites": tuple((int(a), int(b)) for a, b in given["overwrites"])} if "overwrites" in given else {}
        return cls(**(dict(given) | pairs))

    def changed(self, options: Mapping[str, Any]) -> PlcSettings:
        """The same with other values for some. Raises as `of`."""
        return PlcSettings.of({**{entry.name: getattr(self, entry.name) for entry in fields(self)}, **options})

    @property
    def low_first(self) -> bool:
        """The word order that really holds."""
        return (self.word_order == "low-first") != self.swap_words


_WORDS = {
    "framer": ("tcp", "rtu"),
    "forgets_what": ("words", "memory", "switch"),
    "parity": ("N", "E", "O"),
    "word_order": ("high-first", "low-first"),
}


def _check(key: str, value: Any, default: Any) -> None:
    numbers = (int, float) if isinstance(default, float) else type(default)
    wanted = (int, str) if key == "port" else (list, tuple) if key == "overwrites" else numbers
    if not isinstance(value, wanted) or isinstance(value, bool) != isinstance(default, bool):
        raise ConfigError("E-CFG-SETTING-VALUE", "modbus", key=key, why=f"{value!r} is of another kind")
    if value not in _WORDS.get(key, (value,)):
        raise ConfigError("E-CFG-SETTING-VALUE", "modbus", key=key, why=f"{value!r} is none of {_WORDS[key]}")
