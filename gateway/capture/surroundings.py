"""Whether environment readings may be used: there, possible and fresh, for what is left to be corrected with them."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.types.sensing import Ambient
from drivers.types.values import CompensatedFor
from gateway.config import AxisSection
from gateway.errors import AmbientOutOfRange
from gateway.evaluate.optics.air import require_reading

STALE_S = 30.0
NEEDED: dict[CompensatedFor, tuple[str, ...]] = {
    "nothing": ("air_degc", "pressure_hpa", "humidity_pct"),
    "air": (),
    "air+material": (),
}


def check(axis: AxisSection, seen: Ambient, already: CompensatedFor, where: str) -> None:
    """Raises AmbientOutOfRange: E-EVAL-SENSOR (missing), E-EVAL-AMBIENT (impossible), E-CAP-STALE.

    Angles and what the instrument corrects itself need no readings of ours.
    """
    if axis.kind != "linear" or already == "air+material":
        return
    for sensor in NEEDED[already]:
        require_reading(sensor, getattr(seen, sensor), where)
    if not seen.material_degc:
        raise AmbientOutOfRange("E-EVAL-SENSOR", where, sensor="material_degc")
    for value in seen.material_degc:
        require_reading("material_degc", value, where)
    if seen.age_s > STALE_S:
        raise AmbientOutOfRange("E-CAP-STALE", where, age_s=f"{seen.age_s:.0f}", limit_s=f"{STALE_S:.0f}")


def check_all(axis: AxisSection, seen: Iterable[Ambient], already: CompensatedFor, where: str) -> None:
    """Every reading of a capture; raises as `check` for the first that must not be used."""
    for one in seen:
        check(axis, one, already, where)
