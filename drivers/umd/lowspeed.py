"""The counter's low-speed codes: what it says of itself and of the air, one number a line, pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.errors import RemoteProtocolError
from drivers.types.sensing import Ambient
from drivers.umd.codec import (
    AIR_TEMPERATURE,
    CODE,
    DATA,
    FIRMWARE,
    HOMODYNE,
    HUMIDITY,
    LASER_POWER,
    MATERIAL_TEMPERATURE,
    PRESSURE,
    SAMPLE_FREQUENCY,
    SIGNAL_STRENGTH,
)
from drivers.umd.numerals import IntArray

# Divisors of the numbers sent: hundredths of degC, of mbar (= hPa), of Hz; tenths of a per cent.
_DIVISOR = {AIR_TEMPERATURE: 100.0, MATERIAL_TEMPERATURE: 100.0, PRESSURE: 100.0, HUMIDITY: 10.0}
FIRMWARE_SCALE = 100
# What no shop floor has is no reading: a sensor that is missing or broken.
_POSSIBLE = {AIR_TEMPERATURE: (-40.0, 80.0), MATERIAL_TEMPERATURE: (-40.0, 150.0), PRESSURE: (500.0, 1200.0)}
_POSSIBLE[HUMIDITY] = (0.0, 100.0)
DIAGNOSTICS = (101, 102, 111, 112, 121, 122)


@dataclass(slots=True)
class Fact:
    """A number that must not change; it counts once it has come twice in a row, for one may be damaged."""

    value: int | None = None
    candidate: int | None = None

    def offer(self, value: int) -> bool:
        """Hear the number again; true when it has turned into another one for good."""
        if value == self.value:
            self.candidate = None
        elif value == self.candidate:
            changed = self.value is not None
            self.value, self.candidate = value, None
            return changed
        else:
            self.candidate = value
        return False


class LowSpeed:
    """Collects the codes of one counter."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._facts = {SAMPLE_FREQUENCY: Fact(), FIRMWARE: Fact(), HOMODYNE: Fact()}
        self._ambient: dict[int, tuple[float, int]] = {}
        self._latest: dict[int, int] = {}

    def read(self, rows: IntArray, ticks: IntArray) -> None:
        """Take in rows and their ticks (n,). Raises RemoteProtocolError (E-UMD-CHANGED)."""
        said = np.flatnonzero(rows[:, CODE])
        codes, data = rows[said, CODE], rows[said, DATA]
        for code, fact in self._facts.items():
            values: list[int] = data[codes == code].tolist()
            if values and not (fact.candidate is None and set(values) == {fact.value}):
                self._offer(code, fact, values)
        for code, divisor in _DIVISOR.items():
            at = (codes == code).nonzero()[0]
            if len(at):
                self._ambient[code] = float(data[at[-1]]) / divisor, int(ticks[said[at[-1]]])
        for code in (LASER_POWER, SIGNAL_STRENGTH, *DIAGNOSTICS):
            at = (codes == code).nonzero()[0]
            if len(at):
                self._latest[code] = int(data[at[-1]])

    def signals(self, rows: IntArray) -> tuple[IntArray, IntArray]:
        """Rows (k,) that say a signal strength (code 2), and what they say."""
        at = np.flatnonzero(rows[:, CODE] == SIGNAL_STRENGTH)
        return at, rows[at, DATA]

    @property
    def signal_strength(self) -> int | None:
        """Code 2, in the counter's own unit; None while not heard."""
        return self._latest.get(SIGNAL_STRENGTH)

    def _offer(self, code: int, fact: Fact, values: list[int]) -> None:
        before = fact.value
        for value in values:
            if fact.offer(value):
                raise RemoteProtocolError("E-UMD-CHANGED", self._where, number=code, before=before, now=value)

    @property
    def sample_rate_hz(self) -> float:
        """Code 8; 0 while not heard."""
        return (self._facts[SAMPLE_FREQUENCY].value or 0) / 100.0

    @property
    def counts_per_cycle(self) -> int:
        """Second byte of code 20; 0 while not heard."""
        return ((self._facts[HOMODYNE].value or 0) >> 8) & 0xFF

    @property
    def axes(self) -> int | None:
        """Low byte of code 20: homodyne axes, 0 for a heterodyne counter; None while not heard."""
        value = self._facts[HOMODYNE].value
        return None if value is None else value & 0xFF

    @property
    def firmware(self) -> str:
        """Code 10: version in the low 16 bits, times 100, sub-version in the high ones; "" while not heard."""
        value = self._facts[FIRMWARE].value
        if value is None:
            return ""
        low, sub = value & 0xFFFF, value >> 16
        version = f"{low // FIRMWARE_SCALE}.{low % FIRMWARE_SCALE:02d}"
        return f"{version}.{sub}" if sub > 0 else version

    def ambient(self, tick: int, sample_rate_hz: float) -> Ambient:
        """Latest readings, as old as the oldest of them; an impossible one is a sensor that is not there."""
        possible = {code: _POSSIBLE[code] for code in self._ambient}
        here = {
            code: found for code, found in self._ambient.items() if possible[code][0] <= found[0] <= possible[code][1]
        }
        oldest = min((at for _value, at in here.values()), default=tick)
        value = {code: found[0] for code, found in here.items()}
        material = value.get(MATERIAL_TEMPERATURE)
        return Ambient(
            air_degc=value.get(AIR_TEMPERATURE),
            pressure_hpa=value.get(PRESSURE),
            humidity_pct=value.get(HUMIDITY),
            material_degc=() if material is None else (material,),
            age_s=(tick - oldest) / sample_rate_hz if sample_rate_hz else 0.0,
        )
