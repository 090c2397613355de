"""Names to drivers: each is loaded only when chosen, and third parties add theirs by entry points."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

from drivers.errors import ConfigError
from drivers.local.names import guess
from drivers.terms import Terms

GROUP, SETTINGS_GROUP = "trueflank.drivers", "trueflank.settings"


@dataclass(frozen=True, slots=True)
class DriverSpec:
    """Where a driver lives ("module:attribute"), which role it plays, and where the model of its settings lives.

    ``settings`` stands in a module that opens nothing, so that a site file is judged without the driver; "" where a
    driver of somebody else declares none. ``sees_beam`` is false where no sample is ever marked invalid: such an
    instrument counts on without light, and nobody may call that valid.
    """

    name: str
    role: str
    target: str
    settings: str = ""
    sees_beam: bool = True

    def load(self) -> Any:
        """Import the driver's class or factory now."""
        return _loaded(self.target)

    def load_settings(self) -> Any:
        """The model (`drivers.settings.DriverSettings`) of what a site file may tell this driver; None: unsaid."""
        return _loaded(self.settings) if self.settings else None


def _loaded(place: str) -> Any:
    module, _, attribute = place.partition(":")
    return getattr(import_module(module), attribute)


_UA = "drivers.sinumerik.opcua.settings:UaSettings"
_MODBUS = "drivers.sinumerik.mailbox.settings:ModbusSettings"
_LINUXCNC = "drivers.linuxcnc.settings:LinuxCncSettings"
_OFFLINE = "drivers.sinumerik.offline.settings:OfflineSettings"
_BRIDGE = "drivers.bridge.settings:BridgeSettings"
_BRIDGE_GEAR = "drivers.bridge.settings:BridgeGearSettings"


_OWN = (
    DriverSpec("sinumerik-opcua", "controller", "drivers.sinumerik.opcua.device:SinumerikOpcUa", _UA),
    DriverSpec("sinumerik-opcua-doctor", "doctor", "drivers.sinumerik.opcua.doctor:UaDoctor"),
    DriverSpec("sinumerik-modbus-doctor", "doctor", "drivers.sinumerik.mailbox.device:ModbusDoctor"),
    DriverSpec("sinumerik-opcua-program", "program", "drivers.sinumerik.opcua.grinding:preview_program"),
    DriverSpec("sinumerik-opcua-paper", "paper", "drivers.sinumerik.opcua.preview:preview_programs"),
    DriverSpec("sinumerik-opcua-numbers", "numbers", "drivers.sinumerik.opcua.preview:program_numbers"),
    DriverSpec("sinumerik-opcua-survey", "survey", "drivers.sinumerik.opcua.machine:UaSurvey"),
    DriverSpec("sinumerik-opcua-prober", "prober", "drivers.sinumerik.opcua.conformance.prober:UaProber"),
    DriverSpec("sinumerik-opcua-trust", "trust", "drivers.sinumerik.opcua.doctor:UaTrust"),
    DriverSpec("sinumerik-modbus", "controller", "drivers.sinumerik.mailbox.device:SinumerikModbus", _MODBUS),
    DriverSpec("linuxcnc-agent", "controller", "drivers.linuxcnc.device:LinuxCnc", _LINUXCNC),
    DriverSpec("linuxcnc-agent-survey", "survey", "drivers.linuxcnc.doctor:LinuxCncSurvey"),
    DriverSpec("linuxcnc-agent-doctor", "doctor", "drivers.linuxcnc.doctor:LinuxCncDoctor"),
    DriverSpec("sinumerik-offline", "controller", "drivers.sinumerik.offline.device:SinumerikOffline", _OFFLINE),
    DriverSpec("sinumerik-offline-doctor", "doctor", "drivers.sinumerik.offline.device:OfflineDoctor"),
    DriverSpec("sinumerik-offline-paper", "paper", "drivers.sinumerik.offline.steps:preview_carried_programs"),
    DriverSpec("sinumerik-offline-numbers", "numbers", "drivers.sinumerik.offline.steps:carried_program_numbers"),
    DriverSpec("sinumerik-modbus-writes", "writes", "drivers.sinumerik.mailbox.preview:preview_writes"),
    DriverSpec("none", "controller", "drivers.files.only:FilesOnly", "drivers.files.only:FilesOnlySettings"),
    DriverSpec("none-doctor", "doctor", "drivers.files.only:FilesOnlyDoctor"),
    DriverSpec(
        "umd", "instrument", "drivers.umd.device:UmdCounter", "drivers.umd.settings:UmdSettings", sees_beam=False
    ),
    DriverSpec("bridge", "instrument", "drivers.bridge.device:BridgeInstrument", _BRIDGE),
    DriverSpec("bridge-gear", "gear-inspector", "drivers.bridge.gear:BridgeGear", _BRIDGE_GEAR),
    DriverSpec(
        "manual",
        "instrument",
        "drivers.manual.device:ManualEntry",
        "drivers.manual.settings:ManualSettings",
        sees_beam=False,
    ),
    DriverSpec("gauge", "instrument", "drivers.gauge.device:QueriedGauge", "drivers.gauge.settings:GaugeSettings"),
    DriverSpec("wire-trace", "trace", "drivers.replay.recorder:TraceRecorder"),
    DriverSpec("replay", "replay", "drivers.replay.player:Player"),
    DriverSpec(
        "attocube-ids",
        "instrument",
        "drivers.attocube.device:AttocubeIds",
        "drivers.attocube.settings:AttocubeSettings",
    ),
    DriverSpec("rtl", "file", "drivers.files.rtl:RtlFormat"),
    DriverSpec("rta", "file", "drivers.files.rtl:RtaFormat"),
    DriverSpec("pos", "file", "drivers.files.pos:PosFormat"),
    DriverSpec("rtx", "dynamic-file", "drivers.files.rtx:RtxFormat"),
    DriverSpec("csv", "file", "drivers.files.csvmap:CsvFormat"),
    DriverSpec("gear-csv", "gear-file", "drivers.files.gear:GearCsvFormat"),
    DriverSpec("gde", "gear-file", "drivers.files.gde:GdeFormat"),
    DriverSpec("mka", "gear-curves", "drivers.files.klingelnberg:KlingelnbergCurves"),
    DriverSpec("mew", "gear-curves", "drivers.files.klingelnberg:KlingelnbergValues"),
    DriverSpec("contour", "gear-curves", "drivers.files.klingelnberg:KlingelnbergContour"),
    DriverSpec("contour-mark", "recogniser", "drivers.files.klingelnberg:is_contour"),
    DriverSpec("drive-csv", "drive-file", "drivers.files.drives:DriveCsvFormat"),
    DriverSpec("circle-csv", "circle-file", "drivers.files.circles:CircleCsvFormat"),
    DriverSpec("b5r", "circle-file", "drivers.files.circles:B5rFormat"),
    DriverSpec("sinumerik-terms", "terms", "drivers.sinumerik.terms:SINUMERIK"),
    DriverSpec("linuxcnc-terms", "terms", "drivers.linuxcnc.terms:LINUXCNC"),
    DriverSpec("sinumerik-tables", "table-file", "drivers.sinumerik.tablefile.format:TableFiles"),
    DriverSpec("linuxcnc", "table-exchange", "drivers.exchange.linuxcnc:LinuxCncScrew"),
    DriverSpec("twincat", "table-exchange", "drivers.exchange.twincat:TwinCatList"),
    DriverSpec("fanuc", "table-exchange", "drivers.exchange.fanuc:FanucListing"),
    DriverSpec("heidenhain", "table-exchange", "drivers.exchange.heidenhain:HeidenhainCom"),
    DriverSpec("axeserr", "table-exchange", "drivers.exchange.errorlists:AxesErr"),
    DriverSpec("aerotech", "table-exchange", "drivers.exchange.errorlists:AerotechCal"),
    DriverSpec("other-controls", "recogniser", "drivers.exchange.recognise:recognise"),
    DriverSpec("unpublished-layouts", "unpublished", "drivers.exchange.recognise:UNPUBLISHED"),
    DriverSpec("paired-tables", "table-pairing", "drivers.exchange.lines:one_with_both_directions"),
    DriverSpec("table-csv", "table-exchange", "drivers.exchange.spreadsheet:TableCsv"),
    DriverSpec("isg-volumetric", "error-exchange", "drivers.exchange.volumetric:IsgCsv"),
    DriverSpec("etalon-exchange", "error-exchange", "drivers.exchange.volumetric:EtalonExchange"),
    DriverSpec("error-csv", "error-exchange", "drivers.exchange.spreadsheet:ErrorCsv"),
)


def known(role: str | None = None) -> dict[str, DriverSpec]:
    """All drivers by name, our own and those installed beside us; a name of ours cannot be taken over."""
    specs = {spec.name: spec for spec in _OWN} | _others(tuple(sys.path))
    return {name: spec for name, spec in specs.items() if role in (None, spec.role)}


@cache
def _others(_path: tuple[str, ...]) -> dict[str, DriverSpec]:
    """Drivers of other packages; what they declare of their settings stands in a group of its own."""
    from importlib.metadata import entry_points  # it is slow to load, and most commands ask for no driver

    ours = {spec.name for spec in _OWN}
    models = {point.name: point.value for point in entry_points(group=SETTINGS_GROUP)}
    found: dict[str, DriverSpec] = {}
    for point in entry_points(group=GROUP):
        role, _, name = point.name.rpartition(".")
        if name not in ours:
            found.setdefault(name, DriverSpec(name, role or "instrument", point.value, models.get(name, "")))
    return found


def load(name: str, role: str) -> Any:
    """Load a driver by name. Raises ConfigError (E-CFG-DRIVER) naming those that exist."""
    specs = known(role)
    if name not in specs:
        raise unknown_driver(name, role, specs)
    return specs[name].load()


def unknown_driver(name: str, role: str, names: Iterable[str]) -> ConfigError:
    """The error for a name that none of the drivers for a role has, with those that there are."""
    names = sorted(names)
    return ConfigError("E-CFG-DRIVER", name, role=role, known=", ".join(names) + guess(name, names))


def terms_of(controller: str) -> Terms | None:
    """The words of a driver's control: its own (NAME-terms), else those of its maker (sinumerik-terms); None: none."""
    specs = known("terms")
    found = specs.get(f"{controller}-terms") or specs.get(f"{controller.partition('-')[0]}-terms")
    return found.load() if found is not None else None


def first_terms() -> Terms:
    """The words spoken until a site names its control: those of the table files that are read without one."""
    words: Terms = next(spec for spec in _OWN if spec.role == "terms").load()
    return words
