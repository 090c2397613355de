"""Whether drivers exist, their addresses are of a kind they open, and their settings are in order."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

from drivers import registry
from drivers.errors import words
from drivers.local.names import shown
from drivers.message import Message
from drivers.settings import DriverSettings
from gateway.config.faults import Fault, place_name, value_at
from gateway.config.model_faults import broken_rule
from gateway.config.rules import GEAR_MACHINE, ROTARY, no_such
from gateway.config.sections import SiteFile

INSTRUMENTS = ("instrument", GEAR_MACHINE)
UNKNOWN = "unknown"
"""The serial number of a control that nobody asked who it is."""
NO_CONTROL, NO_ADDRESS = "none", "none://"
"""The driver of a site that has files only, and the address that stands for its missing control in a record."""
_PORTLESS = {"opc.tcp"}
_NUMBERED = {"tcp", "socket", "opc.tcp"}
_OPEN_TO_MANY = {"terminal", "folder", "memory"}
_DOTTED = re.compile(r"[\d.]+")
"""A host of digits and points alone must be four numbers up to 255: no name is made so."""
_HOST = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9._-]*[A-Za-z0-9])?\.?|[0-9A-Fa-f:.]+(?:%[A-Za-z0-9._-]+)?")
_SERIAL = re.compile(r"COM[1-9][0-9]*|/dev/\S+", re.IGNORECASE)


def reach_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Everything that control and instruments say wrong of their drivers."""
    if hasattr(site.controller, "place"):
        yield from _serial_with_blank(tree, site.controller)
        yield from _driver_faults(tree, site.controller, ("controller",))
        yield from _of_control(tree, site)
    for instrument in site.instruments:
        yield from _driver_faults(tree, instrument, INSTRUMENTS)
    yield from _shared_addresses(tree, site.instruments)
    for section, wanted, what in _readings(site):
        yield from _unreadable(tree, site, section, wanted, what)


def without_control(tree: dict[str, Any]) -> tuple[dict[str, Any], tuple[Fault, ...]]:
    """A tree of a site that has files only, completed: it has no address and no serial number, and may name none."""
    given = tree.get("controller")
    if not isinstance(given, dict) or given.get("driver") != NO_CONTROL:
        return tree, ()
    unmeant = [key for key in ("url", "serial", "settings", "identity") if key in given]
    faults = tuple(broken_rule(tree, ("controller", key), words("W-CFG-NO-CONTROL")) for key in unmeant)
    return {**tree, "controller": {**given, "url": NO_ADDRESS, "serial": UNKNOWN, "settings": {}}}, faults


def is_moved(site: Any) -> bool:
    """Whether a control moves the axes of a site that may be read in part only."""
    return bool(getattr(site.controller, "driver", "") != NO_CONTROL)


def files_only(site: Any) -> bool:
    """Whether the site names no control at all."""
    return bool(site.controller.driver == NO_CONTROL)


def _serial_with_blank(tree: Mapping[str, Any], section: Any) -> Iterator[Fault]:
    """A serial number with a blank in it is never what a control answers: it was typed so."""
    serial = getattr(section, "serial", None)
    if isinstance(serial, str) and any(one.isspace() for one in serial):
        yield broken_rule(tree, (*section.place, "serial"), words("W-CFG-SERIAL-BLANK"))


def _shared_addresses(tree: Mapping[str, Any], instruments: Iterable[Any]) -> Iterator[Fault]:
    """An address that another instrument has: one of them is probably the other's copy."""
    first: dict[str, str] = {}
    for one in instruments:
        wired = isinstance(one.url, str) and one.url and one.url.partition("://")[0] not in _OPEN_TO_MANY
        if not wired or not isinstance(one.name, str):
            continue
        other = first.setdefault(one.url.lower(), one.name)
        if other != one.name:
            yield broken_rule(tree, (*one.place, "url"), words("W-CFG-SAME-URL", other=shown(other)), doubt=True)


def _of_control(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """What the control's driver is told of the axes, against the axes."""
    told = settings_of_section(site.controller, "controller")
    if told is None:
        return
    encoder = getattr(told, "encoder", None)
    for axis in site.axes:
        path = (*axis.place, "name")
        if told.machine_axes and isinstance(axis.name, str) and axis.name not in told.machine_axes:
            yield no_such(tree, path, Message.of("W-CFG-CONTROL-AXIS"), told.machine_axes)
        if encoder is not None and axis.encoder is not None and axis.encoder != encoder:
            path = (*axis.place, "encoder") if "encoder" in value_at(tree, axis.place) else path
            yield broken_rule(tree, path, words("W-CFG-OTHER-ENCODER", axis=axis.encoder, driver=encoder), doubt=True)


def _readings(site: Any) -> Iterator[tuple[Any, tuple[str, ...], str]]:
    """Every section that reads an instrument, the units that will do for its error, and the error."""
    for axis in site.axes:
        measure = axis.measure
        if getattr(measure, "file", "") is None and axis.kind in ("linear", "rotary"):
            wanted = ("mm", "um") if axis.kind == "linear" else ("rotary",)
            yield measure, wanted, str(measure.component)
    for setup in site.setups:
        name = str(setup.component)
        if setup.source == "live" and len(name) >= 3 and name[1:] not in ("AA", "BB", "CC"):
            angular = name[1] in ROTARY
            yield setup, ("arcsec", "deg") if angular else ("mm", "um"), name


def _unreadable(
    tree: Mapping[str, Any], site: Any, section: Any, wanted: tuple[str, ...], error: str
) -> Iterator[Fault]:
    """An instrument whose settings say that it reads another quantity, or that no run reads on a rotary axis."""
    own = next((one for one in site.instruments if one.name == section.instrument), None)
    told = settings_of_section(own, "instrument") if own is not None else None
    if told is not None and told.typed and wanted == ("rotary",) and not by_files(site):
        yield broken_rule(tree, (*section.place, "instrument"), words("W-CFG-TYPED-ROTARY"), doubt=True)
    if told is None or told.typed or not told.quantities or set(told.quantities) & set(wanted):
        return
    reads = " or ".join(told.quantities)
    if wanted == ("rotary",):
        why = words("W-CFG-NO-CALIBRATOR", reads=reads)
    else:
        why = words("W-CFG-QUANTITY", reads=reads, error=shown(error), needed=" or ".join(wanted))
    yield broken_rule(tree, (*section.place, "instrument"), why)


def by_files(site: Any) -> bool:
    """Whether its owner brings result files and carries tables by hand, so that neither a run nor a push is meant.

    The site names no control; or no instrument is on a wire, and the control is one that nobody knows, or one without
    a place to push from that nobody signs in to.
    """
    if getattr(site.controller, "driver", "") == NO_CONTROL:
        return True
    told = [settings_of_section(one, "instrument") for one in site.instruments]
    typed = all(one is not None and one.typed for one in told)
    unknown = getattr(site.controller, "serial", "") == UNKNOWN
    return typed and (unknown or (not getattr(site.moves, "safe", None) and bool(unprotected_connection(site))))


def typed_rotary(site: SiteFile) -> tuple[str, ...]:
    """Names of the rotary axes whose readings would be typed: no run measures them so."""
    typed = {
        one.name
        for one in site.instruments
        if (told := settings_of_section(one, "instrument")) is not None and told.typed
    }
    return tuple(one.name for one in site.axes if one.kind == "rotary" and one.measure.instrument in typed)


def unprotected_connection(site: SiteFile) -> Message | None:
    """Why others on the network could read or change what passes to the control; None where they cannot."""
    told = _control_settings(site)
    return None if told is None else told.unprotected(site.controller.url)


def excused_certificate(site: SiteFile) -> tuple[str, str]:
    """Who accepted the control's certificate although it was not valid, and why; ("", "") where nobody did."""
    told = _control_settings(site)
    return ("", "") if told is None else told.excused()


def plans_together(site: SiteFile) -> int:
    """How many stop plans a person starts with one press; 0 where the road runs no programs of ours."""
    told = _control_settings(site)
    return 0 if told is None else told.plans_together


def one_start(site: SiteFile) -> bool:
    """Whether one press leads through both halves of a push."""
    told = _control_settings(site)
    return told is not None and told.one_start


def _control_settings(site: SiteFile) -> DriverSettings | None:
    """What the site file tells the control's driver; None where the driver has no model or a setting is wrong."""
    return settings_of_section(site.controller, "controller")


def settings_of_section(section: Any, role: str) -> DriverSettings | None:
    """What a section tells its driver; None where it is missing, the driver has no model or a setting is wrong."""
    driver = getattr(section, "driver", None)
    spec = registry.known(role).get(driver) if isinstance(driver, str) else None
    model = spec.load_settings() if spec is not None else None
    if model is None or not isinstance(section.settings, Mapping) or model.faults(section.settings):
        return None
    told: DriverSettings = model.model_validate(dict(section.settings))
    return told


def _driver_faults(tree: Mapping[str, Any], section: Any, roles: tuple[str, ...]) -> Iterator[Fault]:
    if not isinstance(section.driver, str):
        return
    specs = {name: spec for role in reversed(roles) for name, spec in registry.known(role).items()}
    spec = specs.get(section.driver)
    if spec is None:
        yield _unknown_driver(section, roles[0], sorted(specs))
        return
    model = spec.load_settings()
    if model is None:
        return
    if isinstance(section.settings, Mapping):
        for one in model.faults(section.settings):
            path = (*section.place, "settings", *one.key.split("."))
            fields = {**one.fields, "key": shown(place_name(tree, path))}
            yield Fault(path, one.code, fields, on_key=one.code == "E-CFG-SETTING")
    told = settings_of_section(section, roles[0]) or settings_of_section(section, roles[-1])
    for key, good, why in told.doubts() if told is not None else ():
        if not good:
            yield broken_rule(tree, (*section.place, "settings", key), why, doubt=True)
    yield from _address(tree, section, model.addresses)


def _unknown_driver(section: Any, role: str, names: list[str]) -> Fault:
    error = registry.unknown_driver(section.driver, role, names)
    return Fault((*section.place, "driver"), error.code, {**error.fields, "driver": shown(section.driver)})


def _address(tree: Mapping[str, Any], section: Any, kinds: tuple[str, ...]) -> Iterator[Fault]:
    url = section.url
    if isinstance(url, str) and url and (wrong := address_fault(url, kinds)):
        code, fields = wrong
        yield broken_rule(tree, (*section.place, "url"), words(code, **fields))


def address_fault(url: str, kinds: tuple[str, ...]) -> tuple[str, dict[str, str]] | None:
    """Why a driver that opens these kinds of address does not open this one: code and fields; None where it does.

    A kind that the driver does not open, an address without host, or one with a port that is none.
    """
    scheme = url.partition("://")[0] if "://" in url else ""
    if kinds and (scheme not in kinds or (not scheme and not _SERIAL.fullmatch(url))):
        allowed = ", ".join(f"{kind}://..." if kind else "COM3, /dev/ttyUSB0" for kind in kinds if kind != "memory")
        return "W-CFG-ADDRESS", {"allowed": allowed}
    if kinds and scheme in _NUMBERED and not _is_host(url, needs_port=scheme not in _PORTLESS):
        return "W-CFG-HOST", {"scheme": scheme}
    return None


def address_of(driver: str, role: str, url: str) -> tuple[str, dict[str, str]] | None:
    """The same for a driver by its name; None for one that nobody knows."""
    spec = registry.known(role).get(driver)
    model = spec.load_settings() if spec is not None else None
    return address_fault(url, model.addresses) if model is not None else None


def _is_host(url: str, *, needs_port: bool) -> bool:
    try:
        parts = urlsplit(url)
        host, has_port = parts.hostname or "", parts.port is not None or not needs_port
        if _DOTTED.fullmatch(host):
            known = ip_address(host)
            if known.is_unspecified or known.is_multicast or str(known) == "255.255.255.255":
                return False
        return bool(_HOST.fullmatch(host)) and has_port and parts.port != 0 and " " not in url
    except ValueError:
        return False
