"""Names to drivers: each is loaded only when chosen, and third parties add theirs by entry points."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from drivers.errors import ConfigError
from drivers.terms import Terms

GROUP = "trueflank.drivers"


@dataclass(frozen=True, slots=True)
class DriverSpec:
    """Where a driver lives ("module:attribute") and which role it plays."""

    name: str
    role: str
    target: str

    def load(self) -> Any:
        """Import the driver's class or factory now."""
        module, _, attribute = self.target.partition(":")
        return getattr(import_module(module), attribute)


_OWN = (
    DriverSpec("sinumerik-opcua", "controller", "drivers.sinumerik.opcua.device:SinumerikOpcUa"),
    DriverSpec("sinumerik-opcua-doctor", "doctor", "drivers.sinumerik.opcua.doctor:UaDoctor"),
    DriverSpec("sinumerik-modbus-doctor", "doctor", "drivers.sinumerik.mailbox.doctor:ModbusDoctor"),
    DriverSpec("sinumerik-opcua-program", "program", "drivers.sinumerik.opcua.grinding:preview"),
    DriverSpec("sinumerik-opcua-paper", "paper", "drivers.sinumerik.opcua.paper:on_paper"),
    DriverSpec("sinumerik-opcua-trust", "trust", "drivers.sinumerik.opcua.trust:UaTrust"),
    DriverSpec("sinumerik-modbus", "controller", "drivers.sinumerik.mailbox.device:SinumerikModbus"),
    DriverSpec("umd", "instrument", "drivers.umd.device:UmdCounter"),
    DriverSpec("bridge", "instrument", "drivers.bridge.device:BridgeInstrument"),
    DriverSpec("bridge-gear", "gear-inspector", "drivers.bridge.gear:BridgeGear"),
    DriverSpec("manual", "instrument", "drivers.manual.device:ManualEntry"),
    DriverSpec("wire-trace", "trace", "drivers.replay.recorder:TraceRecorder"),
    DriverSpec("replay", "replay", "drivers.replay.player:Player"),
    DriverSpec("attocube-ids", "instrument", "drivers.attocube.device:AttocubeIds"),
    DriverSpec("rtl", "file", "drivers.files.rtl:RtlFormat"),
    DriverSpec("rta", "file", "drivers.files.rtl:RtaFormat"),
    DriverSpec("pos", "file", "drivers.files.pos:PosFormat"),
    DriverSpec("rtx", "dynamic-file", "drivers.files.rtx:RtxFormat"),
    DriverSpec("csv", "file", "drivers.files.csvmap:CsvFormat"),
    DriverSpec("gear-csv", "gear-file", "drivers.files.gear:GearCsvFormat"),
    DriverSpec("gde", "gear-file", "drivers.files.gde:GdeFormat"),
    DriverSpec("sinumerik-terms", "terms", "drivers.sinumerik.terms:SINUMERIK"),
    DriverSpec("sinumerik-tables", "table-file", "drivers.sinumerik.tablefile.format:TableFiles"),
)


def known(role: str | None = None) -> dict[str, DriverSpec]:
    """All drivers by name, our own and those installed beside us; a name of ours cannot be taken over."""
    specs = {spec.name: spec for spec in _OWN}
    for point in entry_points(group=GROUP):
        role_name, _, name = point.name.rpartition(".")
        specs.setdefault(name, DriverSpec(name, role_name or "instrument", point.value))
    return {name: spec for name, spec in specs.items() if role in (None, spec.role)}


def load(name: str, role: str) -> Any:
    """Load a driver by name. Raises ConfigError (E-CFG-DRIVER) naming those that exist."""
    specs = known(role)
    if name not in specs:
        raise ConfigError("E-CFG-DRIVER", name, role=role, known=", ".join(sorted(specs)))
    return specs[name].load()


def terms_of(controller: str) -> Terms | None:
    """The words of a driver's control: its own (NAME-terms), else those of its maker (sinumerik-terms); None: none."""
    specs = known("terms")
    found = specs.get(f"{controller}-terms") or specs.get(f"{controller.partition('-')[0]}-terms")
    return found.load() if found is not None else None


def first_terms() -> Terms:
    """The words spoken until a site names its control: those of the table files that are read without one."""
    words: Terms = next(spec for spec in _OWN if spec.role == "terms").load()
    return words
