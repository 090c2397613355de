"""Which measuring system's table acts, as the control says: MD30200 how many, MD32700 which is on, MD38000 memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drivers.errors import UnsupportedDevice

INDICES = (0, 1)


@dataclass(frozen=True, slots=True)
class Encoders:
    """Of one axis: ``count`` MD30200; ``enabled`` MD32700, ``reserved`` MD38000 by encoder index; None: unreadable."""

    count: int | None
    enabled: tuple[bool | None, bool | None]
    reserved: tuple[int | None, int | None]

    @property
    def there(self) -> tuple[int, ...]:
        """Encoder indices that the axis has."""
        return INDICES[: self.count if self.count is not None else len(INDICES)]

    @property
    def acting(self) -> tuple[int, ...]:
        """Those whose table is switched on; where none is, those that have memory for one."""
        on = tuple(index for index in self.there if self.enabled[index])
        return on or tuple(index for index in self.there if self.reserved[index] != 0)


def names_of(axis: str) -> tuple[str, ...]:
    """What is read for `of_values`, by the control's names."""
    enabled = [f"$MA_ENC_COMP_ENABLE[{index},{axis}]" for index in INDICES]
    reserved = [f"$MA_MM_ENC_COMP_MAX_POINTS[{index},{axis}]" for index in INDICES]
    return (f"$MA_NUM_ENCS[{axis}]", *enabled, *reserved)


def of_values(values: list[float | None]) -> Encoders:
    """The record from the values of `names_of`, in that order."""
    count, *rest = values
    on = tuple(None if value is None else bool(value) for value in rest[:2])
    points = tuple(None if value is None else int(value) for value in rest[2:])
    return Encoders(None if count is None else int(count), (on[0], on[1]), (points[0], points[1]))


def check(found: Encoders, axis: str, encoder: int, where: str, *, said: bool = True) -> None:
    """Refuse an encoder of the site file that is not the acting one, and a control that lets two act.

    Where no table is on and both measuring systems have memory, the site file decides, if it has ``said`` so: no
    default does. Raises UnsupportedDevice (E-NC-ENCODER, E-NC-ENCODERS, E-NC-ENCODER-OPEN).
    """
    told: dict[str, Any] = {"axis": axis, "encoder": encoder, "count": found.count if found.count is not None else "?"}
    told |= {"enabled": _shown(found.enabled), "reserved": _shown(found.reserved)}
    if len([index for index in found.there if found.enabled[index]]) > 1:
        raise UnsupportedDevice("E-NC-ENCODERS", where, **told)
    if encoder not in found.acting:
        acting = ", ".join(map(str, found.acting)) or "none"
        raise UnsupportedDevice("E-NC-ENCODER", where, acting=acting, **told)
    if not said and len(found.acting) > 1:
        raise UnsupportedDevice("E-NC-ENCODER-OPEN", where, **told)


def _shown(values: tuple[Any, Any]) -> str:
    return ", ".join("?" if value is None else str(int(value)) for value in values)
