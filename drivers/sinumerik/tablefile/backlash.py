"""Backlash settings of an axis: what MD32450 to MD32457 make of a reversal.

MD32450 per measuring system, positive when the encoder leads the machine part (the normal case); MD32452 a factor
for each parameter set; MD32454 bit 0 restores the value at power on, bit 1 keeps it from answering to the movements
of other compensations; MD32456/32457 the dynamic backlash that the PLC switches (machine data description).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

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


def of_axis(settings: Mapping[str, Decimal], axis: str, encoder: int = 0) -> Backlash | None:
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


def settings_of(backlash: Backlash) -> dict[str, Decimal]:
    """The settings that give this backlash, by the control's names; `of_axis` of them gives it back."""
    own = f"[{backlash.encoder},{backlash.axis}]"
    factors = {f"{_OWN[1]}[{at},{backlash.axis}]": factor for at, factor in enumerate(backlash.factors)}
    return {
        f"{_OWN[0]}{own}": backlash.value,
        **factors,
        f"{_OWN[2]}{own}": Decimal(backlash.mode),
        f"{_OWN[3]}{own}": backlash.dynamic,
        f"{_OWN[4]}[{backlash.axis}]": backlash.dynamic_velocity_pct,
    }
