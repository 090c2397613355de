"""What bridge calls carry: JSON objects <-> frozen records, each field checked, units in the names.

Names and meaning: docs/instrument-bridge.md. Reading raises RemoteProtocolError (E-BRIDGE-FIELD) that names the field.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RemoteProtocolError
from drivers.message import Message
from drivers.types.sensing import Ambient, Optics
from drivers.types.values import CompensatedFor, FloatArray

MOST = 1 << 53


class Fields:
    """A JSON object from the peer, read field by field."""

    def __init__(self, found: Any, where: str) -> None:
        self.where = where
        if not isinstance(found, Mapping):
            raise self.wrong("(all)", "an object", found)
        self._found = found

    def wrong(self, name: str, wanted: str | Message, got: object) -> RemoteProtocolError:
        """The error for one field."""
        shown = repr(got)[:80]
        return RemoteProtocolError("E-BRIDGE-FIELD", self.where, field=name, wanted=wanted, got=shown)

    def get(self, name: str, default: Any = None) -> Any:
        """The raw value."""
        return self._found.get(name, default)

    def text(self, name: str, default: str | None = None) -> str:
        """A string; required where no default is given."""
        value = self.get(name, default)
        if not isinstance(value, str):
            raise self.wrong(name, "text", value)
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number; required where no default is given."""
        value = self.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
            raise self.wrong(name, "a finite number", value)
        return float(value)

    def maybe(self, name: str) -> float | None:
        """A finite number, or None where it is null or absent."""
        return None if self.get(name) is None else self.number(name)

    def integer(self, name: str, default: int | None = None) -> int:
        """An integer from 0 to 2^53, beyond which JSON holds none exactly; required where no default is given."""
        value = self.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MOST:
            raise self.wrong(name, Message.of("W-BRIDGE-INTEGER", most=MOST), value)
        return value

    def flag(self, name: str) -> bool:
        """True or false."""
        value = self.get(name)
        if not isinstance(value, bool):
            raise self.wrong(name, Message.of("W-BRIDGE-FLAG"), value)
        return value

    def array(self, name: str, values: Any) -> FloatArray:
        """A list of finite numbers as shape (n,)."""
        if not isinstance(values, list) or not {type(item) for item in values} <= {int, float}:
            raise self.wrong(name, Message.of("W-BRIDGE-NUMBERS"), values)
        try:
            result = np.array(values, np.float64)
        except OverflowError:
            raise self.wrong(name, "finite numbers", Message.of("W-BRIDGE-HUGE")) from None
        if not np.isfinite(result).all():
            raise self.wrong(name, "finite numbers", values)
        return result


def _finite(value: float) -> bool:
    try:
        return isfinite(value)
    except OverflowError:
        return False


# Records.

PROTOCOL = 1

IDENTIFY = "bridge.identify"
START, STOP, SAMPLES, DATUM = "stream.start", "stream.stop", "stream.samples", "stream.datum"
EVENTS = "stream.events"
JSON, BINARY = "json", "binary"
ENVIRONMENT, OPTICS = "environment.read", "optics.read"
HOLD, TRACK, TURN, STATUS = "calibrator.hold", "calibrator.track", "calibrator.turn", "calibrator.status"

PARSE_ERROR, INVALID_REQUEST, METHOD_NOT_FOUND, INVALID_PARAMS = -32700, -32600, -32601, -32602
BUSY, BEAM_OBSTRUCTED, NOT_REFERENCED, UNSUPPORTED = -32001, -32002, -32003, -32004
BATTERY_LOW, UNSTABLE = -32005, -32006

Kind = Literal["laser", "environment", "rotary_calibrator", "angle", "straightness", "gear"]
KINDS: tuple[str, ...] = get_args(Kind)
UNITS = ("_mm", "_um", "_deg", "_arcsec")
CHANNELS: Mapping[str, tuple[str, ...]] = {
    "laser": ("displacement_mm",),
    "rotary_calibrator": ("device_deg", "laser_deg"),
}
KIND_UNITS: Mapping[str, tuple[str, ...]] = {"angle": ("_arcsec",), "straightness": ("_um",)}
# Events after which counts are lost: nothing is valid until the next datum.
BREAKS = ("beam_obstructed", "overspeed", "reference_lost")


@dataclass(frozen=True, slots=True)
class BridgeIdentity:
    """Who stands behind the bridge; the result of ``bridge.identify``.

    ``channels`` in the order of the port; ``sent`` in the order the bridge named them, which is that of a
    frame's columns ((): the same). ``framings`` are the forms its stream can have.
    """

    kind: Kind
    maker: str
    model: str
    serial: str
    firmware: str
    channels: tuple[str, ...]
    sample_rate_hz: float
    compensated_for: CompensatedFor = "nothing"
    protocol: int = PROTOCOL
    notices: tuple[str, ...] = ()
    framings: tuple[str, ...] = (JSON,)
    sent: tuple[str, ...] = ()

    @property
    def order(self) -> tuple[int, ...]:
        """For each channel, its column in a frame."""
        sent = self.sent or self.channels
        return tuple(sent.index(name) for name in self.channels)

    def as_object(self) -> dict[str, Any]:
        """For the wire."""
        names = ("protocol", "kind", "maker", "model", "serial", "firmware", "sample_rate_hz", "compensated_for")
        lists = {"channels": list(self.sent or self.channels), "notices": list(self.notices)}
        if self.framings != (JSON,):
            lists["framings"] = list(self.framings)
        return {name: getattr(self, name) for name in names} | lists

    @classmethod
    def read(cls, found: Any, where: str) -> BridgeIdentity:
        """From the wire."""
        fields = Fields(found, where)
        rate = fields.number("sample_rate_hz")
        if rate < 0:
            raise fields.wrong("sample_rate_hz", "0 or more", rate)
        return cls(
            kind=cast(Kind, _one_of(fields, "kind", KINDS)),
            maker=fields.text("maker"),
            model=fields.text("model"),
            serial=fields.text("serial"),
            firmware=fields.text("firmware", ""),
            channels=_channels(fields),
            sample_rate_hz=rate,
            compensated_for=cast(CompensatedFor, _one_of(fields, "compensated_for", get_args(CompensatedFor))),
            protocol=fields.integer("protocol"),
            notices=_texts(fields, "notices"),
            framings=_texts(fields, "framings") or (JSON,),
            sent=_texts(fields, "channels"),
        )


def _one_of(fields: Fields, name: str, allowed: tuple[str, ...]) -> str:
    value = fields.text(name)
    if value not in allowed:
        raise fields.wrong(name, "one of " + ", ".join(allowed), value)
    return value


def _texts(fields: Fields, name: str) -> tuple[str, ...]:
    values = fields.get(name, [])
    if not isinstance(values, list) or not all(isinstance(item, str) for item in values):
        raise fields.wrong(name, Message.of("W-BRIDGE-TEXTS"), values)
    return tuple(values)


def _channels(fields: Fields) -> tuple[str, ...]:
    names, kind = _texts(fields, "channels"), fields.text("kind")
    wanted = CHANNELS.get(kind, names)
    if sorted(names) != sorted(wanted) or len(set(names)) != len(names):
        raise fields.wrong("channels", f"{wanted}", names)
    units = KIND_UNITS.get(kind, UNITS)
    if not all(name.endswith(units) for name in names) or (kind in KIND_UNITS and not names):
        raise fields.wrong("channels", Message.of("W-BRIDGE-UNIT-NAMES", units=" ".join(units)), names)
    return wanted


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at an instrument time."""

    kind: str
    at_s: float

    def __str__(self) -> str:
        return f"{self.kind} at {self.at_s:.6f} s"


@dataclass(frozen=True, slots=True, eq=False)
class BridgeSamples:
    """A block of evenly spaced samples; the parameters of ``stream.samples``.

    ``sequence`` number of the first sample since the stream started; ``t0_s`` its instrument time, ``dt_s``
    the spacing. ``values`` channel name -> shape (n,); ``valid`` shape (n,). ``lost`` samples were skipped
    just before.
    """

    sequence: int
    t0_s: float
    dt_s: float
    values: Mapping[str, FloatArray]
    valid: NDArray[np.bool_]
    lost: int = 0
    events: tuple[Event, ...] = field(default=())

    def as_object(self) -> dict[str, Any]:
        """For the wire; ``valid`` is left out where all are."""
        found: dict[str, Any] = {"sequence": self.sequence, "t0_s": self.t0_s, "dt_s": self.dt_s}
        found["values"] = {name: column.tolist() for name, column in self.values.items()}
        if not self.valid.all():
            found["valid"] = self.valid.tolist()
        if self.lost:
            found["lost"] = self.lost
        if self.events:
            found["events"] = [{"kind": event.kind, "at_s": event.at_s} for event in self.events]
        return found

    @classmethod
    def read(cls, found: Any, channels: tuple[str, ...], where: str) -> BridgeSamples:
        """From the wire, with just these channels, all of one length."""
        fields = Fields(found, where)
        given = fields.get("values")
        if not isinstance(given, Mapping) or set(given) != set(channels):
            raise fields.wrong("values", Message.of("W-BRIDGE-EACH-LIST", channels=channels), given)
        values = {name: fields.array(f"values.{name}", given[name]) for name in channels}
        lengths = {len(column) for column in values.values()}
        if len(lengths) != 1:
            raise fields.wrong("values", Message.of("W-BRIDGE-LISTS"), sorted(lengths))
        spacing = fields.number("dt_s")
        if spacing <= 0:
            raise fields.wrong("dt_s", "more than 0", spacing)
        return cls(
            fields.integer("sequence"),
            fields.number("t0_s"),
            spacing,
            values,
            _valid(fields, lengths.pop()),
            fields.integer("lost", 0),
            _events(fields),
        )


def _valid(fields: Fields, length: int) -> NDArray[np.bool_]:
    flags = fields.get("valid")
    if flags is None:
        return np.ones(length, np.bool_)
    good = isinstance(flags, list) and len(flags) == length and all(isinstance(flag, bool) for flag in flags)
    if not good:
        raise fields.wrong("valid", Message.of("W-BRIDGE-FLAGS", length=length), flags)
    return np.array(flags, np.bool_)


def read_events(found: Any, where: str) -> tuple[Event, ...]:
    """The parameters of ``stream.events``."""
    return _events(Fields(found, where))


def events_as_object(events: tuple[Event, ...]) -> dict[str, Any]:
    """For the wire."""
    return {"events": [{"kind": event.kind, "at_s": event.at_s} for event in events]}


def _events(fields: Fields) -> tuple[Event, ...]:
    found = fields.get("events", [])
    if not isinstance(found, list):
        raise fields.wrong("events", Message.of("W-BRIDGE-OBJECTS"), found)
    each = (Fields(item, fields.where) for item in found)
    return tuple(Event(item.text("kind"), item.number("at_s")) for item in each)


@dataclass(frozen=True, slots=True)
class CalibratorStatus:
    """The result of ``calibrator.status``; ``battery_pct`` is None on mains."""

    referenced: bool
    moving: bool
    battery_pct: float | None = None

    def as_object(self) -> dict[str, Any]:
        """For the wire."""
        return {"referenced": self.referenced, "moving": self.moving, "battery_pct": self.battery_pct}

    @classmethod
    def read(cls, found: Any, where: str) -> CalibratorStatus:
        """From the wire."""
        fields = Fields(found, where)
        return cls(fields.flag("referenced"), fields.flag("moving"), fields.maybe("battery_pct"))


def environment_as_object(ambient: Ambient) -> dict[str, Any]:
    """The result of ``environment.read``; null means not connected."""
    names = ("air_degc", "pressure_hpa", "humidity_pct", "age_s")
    return {name: getattr(ambient, name) for name in names} | {"material_degc": list(ambient.material_degc)}


# What no shop floor has: a sensor that is broken, or a value in another unit.
POSSIBLE: Mapping[str, tuple[float, float]] = {
    "air_degc": (-40.0, 80.0),
    "pressure_hpa": (500.0, 1200.0),
    "humidity_pct": (0.0, 100.0),
    "material_degc": (-40.0, 150.0),
}


def read_environment(found: Any, where: str) -> Ambient:
    """``environment.read``'s result as a record; an impossible value is refused by its name."""
    fields = Fields(found, where)
    material = tuple(fields.array("material_degc", fields.get("material_degc", [])).tolist())
    air, pressure, humidity = (fields.maybe(name) for name in ("air_degc", "pressure_hpa", "humidity_pct"))
    told = [("air_degc", air), ("pressure_hpa", pressure), ("humidity_pct", humidity)]
    for name, value in (*told, *(("material_degc", value) for value in material)):
        low, high = POSSIBLE[name]
        if value is not None and not low <= value <= high:
            raise fields.wrong(name, Message.of("W-BRIDGE-BETWEEN", low=low, high=high), value)
    return Ambient(
        air_degc=air,
        pressure_hpa=pressure,
        humidity_pct=humidity,
        material_degc=material,
        age_s=fields.number("age_s", 0.0),
    )


def read_optics(found: Any, where: str) -> Optics:
    """``optics.read``'s result as a record."""
    fields = Fields(found, where)
    return Optics(fields.text("kind"), fields.text("detail", ""))
