"""What a control says about itself over OPC UA -> identity, configuration, encoders, memory and state records.

Which measuring system's table acts follows from MD30200 (how many), MD32700 (which is on) and MD38000 (memory).
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Literal

from drivers.checks import ControlAxis, ControlFacts
from drivers.clock import Clock
from drivers.errors import TransportError, UnsupportedDevice
from drivers.message import Message
from drivers.sinumerik.ncprogram.backup import ReservedPoints
from drivers.sinumerik.opcua.session import client as alarm_nodes
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session import nodes as typed_values
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.connection import read_secrets
from drivers.sinumerik.opcua.session.requests import Reading
from drivers.sinumerik.opcua.session.status import is_absent, is_down, status_error
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.tablefile import axis_settings
from drivers.sinumerik.tablefile.reader import MOST_POINTS
from drivers.types.identity import MachineIdentity
from drivers.types.machine import AxisState, ChannelStatus, MachineState
from drivers.types.tables import TemperatureShift
from drivers.units import AxisUnit, deviation_scale

# Encoders.

ENCODER_INDICES = (0, 1)


@dataclass(frozen=True, slots=True)
class Encoders:
    """Of one axis: ``count`` MD30200; ``enabled`` MD32700, ``reserved`` MD38000 by encoder index; None: unreadable."""

    count: int | None
    enabled: tuple[bool | None, bool | None]
    reserved: tuple[int | None, int | None]

    @property
    def there(self) -> tuple[int, ...]:
        """Encoder indices that the axis has."""
        return ENCODER_INDICES[: self.count if self.count is not None else len(ENCODER_INDICES)]

    @property
    def acting(self) -> tuple[int, ...]:
        """Those whose table is switched on; where none is, those that have memory for one."""
        on = tuple(index for index in self.there if self.enabled[index])
        return on or tuple(index for index in self.there if self.reserved[index] != 0)


def encoder_names(axis: str) -> tuple[str, ...]:
    """What is read for `encoders_from_values`, by the control's names."""
    enabled = [f"$MA_ENC_COMP_ENABLE[{index},{axis}]" for index in ENCODER_INDICES]
    reserved = [f"$MA_MM_ENC_COMP_MAX_POINTS[{index},{axis}]" for index in ENCODER_INDICES]
    return (f"$MA_NUM_ENCS[{axis}]", *enabled, *reserved)


def encoders_from_values(values: list[float | None]) -> Encoders:
    """The record from the values of `encoder_names`, in that order."""
    count, *rest = values
    on = tuple(None if value is None else bool(value) for value in rest[:2])
    points = tuple(None if value is None else int(value) for value in rest[2:])
    return Encoders(None if count is None else int(count), (on[0], on[1]), (points[0], points[1]))


def check_encoder(found: Encoders, axis: str, encoder: int, where: str, *, said: bool = True) -> None:
    """Refuse an encoder of the site file that is not the acting one, and a control that lets two act.

    Where no table is on and both measuring systems have memory, the site file decides, if it has ``said`` so: no
    default does. Raises UnsupportedDevice (E-NC-ENCODER, E-NC-ENCODERS, E-NC-ENCODER-OPEN).
    """
    told: dict[str, Any] = {"axis": axis, "encoder": encoder, "count": found.count if found.count is not None else "?"}
    told |= {"enabled": _shown_indices(found.enabled), "reserved": _shown_indices(found.reserved)}
    if len([index for index in found.there if found.enabled[index]]) > 1:
        raise UnsupportedDevice("E-NC-ENCODERS", where, **told)
    if encoder not in found.acting:
        acting = ", ".join(map(str, found.acting)) or "none"
        raise UnsupportedDevice("E-NC-ENCODER", where, acting=acting, **told)
    if not said and len(found.acting) > 1:
        raise UnsupportedDevice("E-NC-ENCODER-OPEN", where, **told)


def _shown_indices(values: tuple[Any, Any]) -> str:
    return ", ".join("?" if value is None else str(int(value)) for value in values)


# Configuration, identity, state.

MOST_AXES = 31
MOST_CEC_TABLES = 62
ALARM_PLACES = 8
MOST_FILE_KB = 100_000
_IN_POSITION = 4
_AXIS_NAME = re.compile(r"[A-Z_][A-Z0-9_]{0,31}")
_CHANNEL = tuple(status.value for status in ChannelStatus)
_AXIS_ITEMS = ("actToolBasePos", "aaRef", "aaStat", "vaEnc1CompVal", "vaEnc2CompVal", "vaCecCompVal")


@dataclass(frozen=True, slots=True)
class Configuration:
    """Machine axes by their numbers: names (MD10000), whether rotary (MD30300) and modulo (MD30310).

    A control may have no axis of some number: its name is "" here, so that the others keep theirs. None: not readable.
    """

    places: tuple[str, ...]
    rotary: tuple[bool | None, ...]
    modulo: tuple[bool | None, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The axes that there are, in order."""
        return tuple(name for name in self.places if name)

    def number(self, axis: str, where: str) -> int:
        """1-based number of an axis. Raises UnsupportedDevice (E-NC-AXIS)."""
        if axis not in self.names:
            raise UnsupportedDevice("E-NC-AXIS", where, axis=axis, known=", ".join(self.names))
        return self.places.index(axis) + 1

    def is_rotary(self, axis: str) -> bool:
        """By MD30300; by its name's letter where that cannot be read."""
        place = self.places.index(axis) if axis in self.names else -1
        known = self.rotary[place] if place >= 0 else None
        return axis[:1] in "ABC" if known is None else known

    def is_modulo(self, axis: str, *, rotary: bool) -> bool:
        """By MD30310; a rotary axis of which nothing can be read turns endlessly."""
        known = self.modulo[self.places.index(axis)] if axis in self.names else None
        return rotary if known is None else known and rotary

    @property
    def units(self) -> dict[str, AxisUnit]:
        """Unit of each axis by name."""
        return {name: "deg" if self.is_rotary(name) else "mm" for name in self.names}


class MachineReader:
    """Reads by batches; ``timeout_s`` bounds each request."""

    def __init__(self, session: UaSession, settings: UaSettings, where: str) -> None:
        self._session = session
        self._settings = settings
        self._where = where
        self.timeout_s = 5.0

    async def configuration(self) -> Configuration:
        """Axes of the machine. Raises UnsupportedDevice (E-UA-ABSENT) when none can be read."""
        found = await self._read([nodes.axis_name(place) for place in range(1, MOST_AXES + 1)])
        names = ["" if reading.status else reading.value.strip().upper() for reading in found]
        last = max((place for place, name in enumerate(names, start=1) if name), default=0)
        unread = next((reading for reading in found[: max(last, 1)] if reading.status), None)
        if unread is not None or not last:
            raise self._bad(unread or found[0])
        names = names[:last]
        self._check_names(names)
        rotary, modulo = [await self._flags(datum, names) for datum in ("$MA_IS_ROT_AX", "$MA_ROT_IS_MODULO")]
        return Configuration(tuple(names), rotary, modulo)

    async def _flags(self, datum: str, names: Sequence[str]) -> tuple[bool | None, ...]:
        """A switch of every axis by its number; None where there is no axis or it cannot be read."""
        found = await self._read([self._datum(f"{datum}[{name}]", names) for name in names if name])
        values = iter(None if reading.status else bool(reading.value) for reading in found)
        return tuple(next(values) if name else None for name in names)

    def _check_names(self, names: Sequence[str]) -> None:
        """Names go into programs and file names, each for one axis. Raises RemoteProtocolError (E-UA-VALUE)."""
        for place, name in enumerate(names, start=1):
            if not name:
                continue
            if not _AXIS_NAME.fullmatch(name) or name in names[: place - 1]:
                raise typed_values.value_error(nodes.axis_name(place), name, Message.of("W-UA-OWN-AXIS"), self._where)

    async def identity(self, names: tuple[str, ...]) -> MachineIdentity:
        """Serial number, NCK version, unit system, and what the site names besides: type and marker; read afresh."""
        settings, where = self._settings, self._where
        paths = [settings.serial_node, settings.version_node, nodes.BASIC_LENGTH_UNIT]
        serial, version, unit = self._good(self._up(await self._session.survey(paths, self.timeout_s)))
        inch = typed_values.check_value(nodes.BASIC_LENGTH_UNIT, unit, where)
        system: Literal["metric", "inch"] = "inch" if inch else "metric"
        told = (typed_values.check_label(serial, paths[0], where), typed_values.check_label(version, paths[1], where))
        further = await self._further()
        return MachineIdentity(*told, names, system, **further)

    async def _further(self) -> dict[str, str]:
        """Facts that the settings name; one that cannot be read says nothing of the machine.

        Raises RemoteProtocolError (E-UA-VALUE) for a value that is neither text nor number.
        """
        settings, paths = self._settings, {"type": self._settings.type_node, "marker": self._settings.marker_node}
        if settings.r_marker >= 0:
            paths["marker"] = nodes.r_parameter(settings.r_marker, settings.channel)
        asked = {fact: path for fact, path in paths.items() if path}
        if not asked:
            return {}
        found = self._up(await self._session.survey(list(asked.values()), self.timeout_s))
        read = [(fact, one) for fact, one in zip(asked, found, strict=True) if not one.status]
        return {fact: typed_values.check_label(one.value, one.path, self._where) for fact, one in read}

    async def memory(self, configuration: Configuration, axis: str, encoder: int) -> ReservedPoints:
        """Reserved points (MD38000 of the encoder, MD18342 of every CEC table that can be read), and MD11420."""
        configuration.number(axis, self._where)
        names = configuration.places
        tables = min(2 * len(names), MOST_CEC_TABLES)
        paths = [self._datum(f"$MA_MM_ENC_COMP_MAX_POINTS[{encoder},{axis}]", names)]
        paths += [self._datum(f"$MN_MM_CEC_MAX_POINTS[{table}]", names) for table in range(tables)]
        paths.append(self._datum("$MN_LEN_PROTOCOL_FILE", names))
        eec, *cec, file_kb = await self._read(paths)
        points = tuple(0 if one.status else self._reserved(one) for one in cec)
        self._good([eec])
        limit_kb = (
            0 if file_kb.status else typed_values.check_whole(file_kb.value, file_kb.path, self._where, MOST_FILE_KB)
        )
        return ReservedPoints(self._reserved(eec), points, configuration.names, limit_kb)

    def _reserved(self, reading: Reading) -> int:
        """Points that a memory figure says. Raises RemoteProtocolError (E-UA-VALUE) beyond what a control has."""
        return typed_values.check_whole(reading.value, reading.path, self._where, MOST_POINTS)

    async def encoders(self, configuration: Configuration, axis: str) -> Encoders:
        """Which measuring systems the axis has, whose table is on, and who has memory for one."""
        configuration.number(axis, self._where)
        paths = [self._datum(name, configuration.places) for name in encoder_names(axis)]
        found = await self._read(paths)
        return encoders_from_values([None if one.status else float(one.value) for one in found])

    async def switch(self, name: str, configuration: Configuration) -> bool | None:
        """A switch by its NC name; None when this user may not read it or the NCK restarts just now."""
        path = self._datum(name, configuration.places)
        (reading,) = await self._session.read([path], self.timeout_s)
        return None if reading.status else bool(reading.value)

    async def temperature(self, configuration: Configuration, axis: str) -> TemperatureShift | None:
        """What temperature compensation is worth on an axis just now; None where its data cannot be read.

        Raises RemoteProtocolError (E-UA-VALUE) for a datum that is no finite number.
        """
        names = axis_settings.temperature_names(axis)
        paths = [nodes.to_path(name, configuration.places, self._settings.channel) for name in names]
        if None in paths:
            return None
        found = self._up(await self._session.read([path for path in paths if path], self.timeout_s))
        if any(reading.status for reading in found):
            return None
        values = [typed_values.check_number(one.value, one.path, self._where) for one in found]
        read = dict(zip(names, map(Decimal, map(repr, values)), strict=True))
        return axis_settings.acting_temperature(axis_settings.temperature_of(read, axis))

    async def figure(self, name: str, configuration: Configuration) -> float | None:
        """A machine datum by its NC name; None where there is no public node for it or it cannot be read."""
        path = nodes.to_path(name, configuration.places, self._settings.channel)
        if path is None:
            return None
        (reading,) = await self._session.read([path], self.timeout_s)
        return None if reading.status else float(reading.value)

    async def state(self, configuration: Configuration) -> MachineState:
        """Channel, mode, message, alarms, access level and every axis, in one batch, all of it live.

        Raises TransportError (E-UA-STALE) for an uncertain value or one older than the settings' ``stale_s``.
        """
        channel = self._settings.channel
        head = [
            nodes.in_channel("chanStatus", channel),
            nodes.OPERATING_MODE,
            nodes.in_channel("msg", channel, "ProgramInfo"),
            nodes.in_channel("progName", channel, "ProgramInfo"),
            nodes.ACCESS_LEVEL,
        ]
        alarms = [nodes.alarm_number(place) for place in range(1, ALARM_PLACES + 1)]
        numbers = [place for place, name in enumerate(configuration.places, start=1) if name]
        axes = [nodes.of_axis(item, number, channel) for number in numbers for item in _AXIS_ITEMS]
        found = await self._read([*head, *alarms, *axes], aged=True)
        values = self._fresh([_without_second(one) for one in found])
        status, mode, message, program, level = values[: len(head)]
        pending = values[len(head) : len(head) + len(alarms)]
        rest, per = values[len(head) + len(alarms) :], len(_AXIS_ITEMS)
        return MachineState(
            channel=channel_status(status, self._where),
            mode=nodes.MODES[mode] if mode < len(nodes.MODES) else str(mode),
            message=message,
            alarms=tuple(number for number in pending if number),
            access_level=level,
            axes={
                name: _axis_state(name, rest[place * per : (place + 1) * per], configuration)
                for place, name in enumerate(configuration.names)
            },
            program=program,
        )

    async def alarm_texts(self, count: int) -> str:
        """Texts of pending alarms: by events, else from the variables; "" where the control gives neither."""
        told = alarm_nodes.alarm_texts(await alarm_nodes.read_standing_alarms(self._session, self.timeout_s))
        if told:
            return told
        found = await self._read([nodes.alarm_text(place) for place in range(1, count + 1)])
        return "; ".join(reading.value for reading in found if not reading.status and reading.value)

    async def values(self, paths: Sequence[str]) -> list[Any]:
        """Values that must all be readable, by one request. Raises the refusal of the first that is not."""
        return self._good(await self._read(paths))

    async def _read(self, paths: Sequence[str], *, aged: bool = False) -> list[Reading]:
        ask = self._session.read_aged if aged else self._session.read
        return self._up(await ask(paths, self.timeout_s))

    def _up(self, found: list[Reading]) -> list[Reading]:
        for reading in found:
            if is_down(reading.status):
                raise status_error(reading.status, self._where, "read", reading.path)
        return found

    def _good(self, readings: Sequence[Reading]) -> list[Any]:
        for reading in readings:
            if reading.status:
                raise self._bad(reading)
        return [reading.value for reading in readings]

    def _fresh(self, readings: Sequence[Reading]) -> list[Any]:
        """Good values that the server itself calls recent, as far as it gives their time."""
        limit_s = self._settings.stale_s
        for reading in readings:
            if limit_s and reading.age_s is not None and reading.age_s > limit_s:
                raise TransportError(
                    "E-UA-STALE", self._where, retryable=True, what=reading.path, why=f"{reading.age_s:.1f} s old"
                )
        return self._good(readings)

    def _bad(self, reading: Reading) -> Exception:
        return status_error(reading.status or "empty", self._where, "read", reading.path)

    def _datum(self, name: str, axes: Sequence[str]) -> str:
        path = nodes.to_path(name, axes, self._settings.channel)
        if path is None:
            raise UnsupportedDevice("E-UA-ABSENT", self._where, status=Message.of("W-UA-NO-NODE"), what=name)
        return path


def channel_status(value: Any, where: str) -> ChannelStatus:
    """chanStatus as a record. Raises RemoteProtocolError (E-UA-VALUE)."""
    if value not in _CHANNEL:
        raise typed_values.value_error("chanStatus", value, f"one of {', '.join(map(str, _CHANNEL))}", where)
    return ChannelStatus(value)


def _without_second(reading: Reading) -> Reading:
    """A server that does not know the second measuring system's table shows none of it; all else must be there."""
    if reading.path.split("[")[0].endswith("/vaEnc2CompVal") and is_absent(reading.status):
        return Reading(reading.path, 0.0)
    return reading


def _axis_state(name: str, values: list[Any], configuration: Configuration) -> AxisState:
    position, referenced, status, first, second, cross = values
    unit: AxisUnit = "deg" if configuration.is_rotary(name) else "mm"
    scale = deviation_scale(unit)
    return AxisState(
        name=name,
        position=position,
        referenced=bool(referenced),
        in_position=status == _IN_POSITION,
        encoder_compensation=(first or second) * scale,  # the table of one measuring system acts, never both
        cross_compensation=cross * scale,
        unit=unit,
    )


# Survey for a site file.

LIMITS = ("$MA_POS_LIMIT_MINUS", "$MA_POS_LIMIT_PLUS")
"""MD36100 and MD36110, the first soft limits."""
# A limit beyond this is the control's way to say that there is none.
FARTHEST = 1e6


class UaSurvey:
    """Settings as the controller's; every question is a read."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._settings = UaSettings.read(settings, name)
        self._session = UaSession(url, clock, name)

    async def survey(self, timeout_s: float) -> ControlFacts:
        """Log in, read, log out. Raises ConfigError, TransportError, DeviceError, ProtocolError as the login does."""
        secrets = await asyncio.to_thread(read_secrets, self._settings, self.name)
        await self._session.open(secrets, timeout_s)
        try:
            reader = MachineReader(self._session, self._settings, self.name)
            reader.timeout_s = timeout_s
            return await self._read(reader)
        finally:
            await self._session.close()

    async def _read(self, reader: MachineReader) -> ControlFacts:
        configuration = await reader.configuration()
        machine = await reader.identity(configuration.names)
        axes = [await self._axis(reader, configuration, name) for name in configuration.names]
        return ControlFacts(machine.serial, machine.version, machine.unit_system, tuple(axes), identity=machine.facts)

    async def _axis(self, reader: MachineReader, configuration: Configuration, name: str) -> ControlAxis:
        rotary = configuration.is_rotary(name)
        encoders = await reader.encoders(configuration, name)
        acting = encoders.acting[0] if len(encoders.acting) == 1 else None
        low, high = [await reader.figure(f"{limit}[{name}]", configuration) for limit in LIMITS]
        known = low is not None and high is not None and -FARTHEST < low < high < FARTHEST
        return ControlAxis(
            name=name,
            unit="deg" if rotary else "mm",
            modulo=configuration.is_modulo(name, rotary=rotary),
            travel=(low, high) if known and low is not None and high is not None else None,
            encoder=acting,
            points=encoders.reserved[acting] if acting is not None else None,
        )
