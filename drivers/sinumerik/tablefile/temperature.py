"""Temperature compensation of an axis: what SD43900, 43910, 43920 and MD32750, 32760 add to its position.

MD32750 bit 0: the constant part SD43900 acts; bit 1: the straight line SD43910 (P - SD43920) acts (FM K3 03/2013,
p. 228). The control clips the slope to MD32760 (setting data description) and spreads the movement, without an alarm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

from drivers.types.tables import TemperatureShift

_NAMES = {
    "kind": "$MA_TEMP_COMP_TYPE",
    "steepest": "$MA_COMP_ADD_VELO_FACTOR",
    "constant": "$SA_TEMP_COMP_ABS_VALUE",
    "slope": "$SA_TEMP_COMP_SLOPE",
    "reference": "$SA_TEMP_COMP_REF_POSITION",
}


@dataclass(frozen=True, slots=True)
class Temperature:
    """Temperature compensation of one axis: mm or deg, slope in mm/mm or deg/deg; None is not set in the file."""

    axis: str
    kind: Decimal | None = None
    constant: Decimal | None = None
    slope: Decimal | None = None
    reference: Decimal | None = None
    steepest: Decimal | None = None

    def shift(self, position: Decimal) -> Decimal:
        """What the control adds at a position, mm or deg: the parts that MD32750 switches on."""
        kind = int(self.kind or 0)
        constant = (self.constant or Decimal(0)) if kind & 1 else Decimal(0)
        line = self.acting_slope * (position - (self.reference or Decimal(0))) if kind & 2 else Decimal(0)
        return constant + line

    @property
    def acting_slope(self) -> Decimal:
        """SD43910, clipped to MD32760 where that is known."""
        slope = self.slope or Decimal(0)
        if self.steepest is None or abs(slope) <= self.steepest:
            return slope
        return self.steepest.copy_sign(slope)


def names_of(axis: str) -> tuple[str, ...]:
    """The control's names of the settings of an axis."""
    return tuple(f"{name}[{axis}]" for name in _NAMES.values())


def acting(found: Temperature | None) -> TemperatureShift:
    """What is switched on of it, as a record; nothing where nothing is."""
    if found is None:
        return TemperatureShift()
    kind = int(found.kind or 0)
    constant = (found.constant or Decimal(0)) if kind & 1 else Decimal(0)
    slope = found.acting_slope if kind & 2 else Decimal(0)
    return TemperatureShift(float(constant), float(slope), float(found.reference or 0) if slope else 0.0)


def of_axis(settings: Mapping[str, Decimal], axis: str) -> Temperature | None:
    """The temperature compensation that settings give an axis; None if they say nothing about it."""
    found = {field: settings.get(f"{name}[{axis}]") for field, name in _NAMES.items()}
    return None if all(value is None for value in found.values()) else Temperature(axis, **found)


def settings_of(temperature: Temperature) -> dict[str, Decimal]:
    """The settings that give this compensation, by the control's names; `of_axis` of them gives it back."""
    values = {name: getattr(temperature, field) for field, name in _NAMES.items()}
    return {f"{name}[{temperature.axis}]": value for name, value in values.items() if value is not None}
