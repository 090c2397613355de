"""What else moves an axis: its backlash (MD32450 to MD32457) and its temperature compensation (SD43900 to 43920).

MD32450 per measuring system, positive when the encoder leads the machine part (the normal case); MD32452 a factor for
each parameter set; MD32454 bit 0 restores the value at power on, bit 1 keeps it from answering to the movements of
other compensations; MD32456/32457 the dynamic backlash that the PLC switches (machine data description). MD32750 bit
0: the constant part SD43900 acts; bit 1: the straight line SD43910 (P - SD43920) acts (FM K3 03/2013, p. 228). The
control clips the slope to MD32760 (setting data description) and spreads the movement, without an alarm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

from drivers.types.tables import TemperatureShift

# Backlash settings of an axis: what MD32450 to MD32457 make of a reversal.
#
# MD32450 per measuring system, positive when the encoder leads the machine part (the normal case); MD32452 a factor
# for each parameter set; MD32454 bit 0 restores the value at power on, bit 1 keeps it from answering to the movements
# of other compensations; MD32456/32457 the dynamic backlash that the PLC switches (machine data description).

_OWN = ("$MA_BACKLASH", "$MA_BACKLASH_FACTOR", "$MA_BACKLASH_MODE", "$MA_BACKLASH_DYN", "$MA_BACKLASH_DYN_MAX_VELO")
PARAMETER_SETS = 6


@dataclass(frozen=True, slots=True)
class Backlash:
    """Backlash of one axis and measuring system, mm or deg. ``factors`` by parameter set; what is not set is usual."""

    axis: str
    encoder: int
    value: Decimal = Decimal(0)
    factors: tuple[Decimal, ...] = (Decimal(1),) * PARAMETER_SETS
    mode: int = 0
    dynamic: Decimal = Decimal(0)
    dynamic_velocity_pct: Decimal = Decimal(1)

    def effective(self, parameter_set: int = 0) -> Decimal:
        """MD32450 x MD32452: what is taken up at a reversal, mm or deg."""
        return self.value * self.factors[parameter_set]

    @property
    def restored_at_power_on(self) -> bool:
        """MD32454 bit 0."""
        return bool(self.mode & 1)

    @property
    def ignores_compensation(self) -> bool:
        """MD32454 bit 1: reversals that CEC or temperature compensation cause do not trigger it."""
        return bool(self.mode & 2)


def backlash_of(settings: Mapping[str, Decimal], axis: str, encoder: int = 0) -> Backlash | None:
    """The backlash that settings give an axis; None if they say nothing about it."""

    def value(name: str, inside: str, usual: int = 0) -> Decimal:
        return settings.get(f"{name}[{inside}]", Decimal(usual))

    own, whole = f"{encoder},{axis}", f"{axis}]"
    if not any(place.startswith("$MA_BACKLASH") and place.endswith(f",{whole}") for place in settings):
        return None
    return Backlash(
        axis=axis,
        encoder=encoder,
        value=value("$MA_BACKLASH", own),
        factors=tuple(value("$MA_BACKLASH_FACTOR", f"{number},{axis}", 1) for number in range(PARAMETER_SETS)),
        mode=int(value("$MA_BACKLASH_MODE", own)),
        dynamic=value("$MA_BACKLASH_DYN", own),
        dynamic_velocity_pct=value("$MA_BACKLASH_DYN_MAX_VELO", axis, 1),
    )


def backlash_settings(backlash: Backlash) -> dict[str, Decimal]:
    """The settings that give this backlash, by the control's names; `backlash_of` gives it back."""
    own = f"[{backlash.encoder},{backlash.axis}]"
    factors = {f"{_OWN[1]}[{at},{backlash.axis}]": factor for at, factor in enumerate(backlash.factors)}
    return {
        f"{_OWN[0]}{own}": backlash.value,
        **factors,
        f"{_OWN[2]}{own}": Decimal(backlash.mode),
        f"{_OWN[3]}{own}": backlash.dynamic,
        f"{_OWN[4]}[{backlash.axis}]": backlash.dynamic_velocity_pct,
    }


# Temperature compensation of an axis: what SD43900, 43910, 43920 and MD32750, 32760 add to its position.
#
# MD32750 bit 0: the constant part SD43900 acts; bit 1: the straight line SD43910 (P - SD43920) acts (FM K3 03/2013, p.
# 228). The control clips the slope to MD32760 (setting data description) and spreads the movement, without an alarm.

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


def temperature_names(axis: str) -> tuple[str, ...]:
    """The control's names of the settings of an axis."""
    return tuple(f"{name}[{axis}]" for name in _NAMES.values())


def acting_temperature(found: Temperature | None) -> TemperatureShift:
    """What is switched on of it, as a record; nothing where nothing is."""
    if found is None:
        return TemperatureShift()
    kind = int(found.kind or 0)
    constant = (found.constant or Decimal(0)) if kind & 1 else Decimal(0)
    slope = found.acting_slope if kind & 2 else Decimal(0)
    return TemperatureShift(float(constant), float(slope), float(found.reference or 0) if slope else 0.0)


def temperature_of(settings: Mapping[str, Decimal], axis: str) -> Temperature | None:
    """The temperature compensation that settings give an axis; None if they say nothing about it."""
    found = {field: settings.get(f"{name}[{axis}]") for field, name in _NAMES.items()}
    return None if all(value is None for value in found.values()) else Temperature(axis, **found)


def temperature_settings(temperature: Temperature) -> dict[str, Decimal]:
    """The settings that give this compensation, by the control's names; `temperature_of` gives it back."""
    values = {name: getattr(temperature, field) for field, name in _NAMES.items()}
    return {f"{name}[{temperature.axis}]": value for name, value in values.items() if value is not None}
