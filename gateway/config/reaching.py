"""Whether drivers exist, their addresses are of a kind they open, and their settings are in order."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

from drivers import registry
from drivers.errors import words
from drivers.local.names import shown
from drivers.settings import DriverSettings
from gateway.config.faults import Fault, called
from gateway.config.keyfaults import broken
from gateway.config.rules import GEAR_MACHINE
from gateway.config.sections import SiteFile

INSTRUMENTS = ("instrument", GEAR_MACHINE)
_PORTLESS = {"opc.tcp"}
_NUMBERED = {"tcp", "socket", "opc.tcp"}
_DOTTED = re.compile(r"[\d.]+")
"""A host of digits and points alone must be four numbers up to 255: no name is made so."""
_SERIAL = re.compile(r"COM[0-9]+|/dev/.+", re.IGNORECASE)


def reach_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Everything that control and instruments say wrong of their drivers."""
    if hasattr(site.controller, "place"):
        yield from _reached(tree, site.controller, ("controller",))
    for instrument in site.instruments:
        yield from _reached(tree, instrument, INSTRUMENTS)


def open_road(site: SiteFile) -> str:
    """Why others on the network could read or change what passes to the control, in words; "" where they cannot."""
    told = _told(site)
    return "" if told is None else told.unprotected(site.controller.url)


def plans_together(site: SiteFile) -> int:
    """How many stop plans a person starts with one press; 0 where the road runs no programs of ours."""
    told = _told(site)
    return 0 if told is None else told.plans_together


def _told(site: SiteFile) -> DriverSettings | None:
    """What the site file tells the control's driver; None where the driver has no model or a setting is wrong."""
    spec = registry.known("controller").get(site.controller.driver)
    model = spec.load_settings() if spec is not None else None
    if model is None or model.faults(site.controller.settings):
        return None
    told: DriverSettings = model.model_validate(dict(site.controller.settings))
    return told


def _reached(tree: Mapping[str, Any], section: Any, roles: tuple[str, ...]) -> Iterator[Fault]:
    if not isinstance(section.driver, str):
        return
    specs = {name: spec for role in reversed(roles) for name, spec in registry.known(role).items()}
    spec = specs.get(section.driver)
    if spec is None:
        yield _unknown(section, roles[0], sorted(specs))
        return
    model = spec.load_settings()
    if model is None:
        return
    if isinstance(section.settings, Mapping):
        for one in model.faults(section.settings):
            path = (*section.place, "settings", *one.key.split("."))
            fields = {**one.fields, "key": shown(called(tree, path))}
            yield Fault(path, one.code, fields, on_key=one.code == "E-CFG-SETTING")
    yield from _address(tree, section, model.addresses)


def _unknown(section: Any, role: str, names: list[str]) -> Fault:
    error = registry.unknown_driver(section.driver, role, names)
    return Fault((*section.place, "driver"), error.code, {**error.fields, "driver": shown(section.driver)})


def _address(tree: Mapping[str, Any], section: Any, kinds: tuple[str, ...]) -> Iterator[Fault]:
    """A kind of address that the driver does not open, or one without host or with a port that is none."""
    url, place = section.url, (*section.place, "url")
    if not isinstance(url, str) or not url or not kinds:
        return
    scheme = url.partition("://")[0] if "://" in url else ""
    if scheme not in kinds or (not scheme and not _SERIAL.fullmatch(url.strip())):
        allowed = ", ".join(f"{kind}://..." if kind else "COM3, /dev/ttyUSB0" for kind in kinds if kind != "memory")
        yield broken(tree, place, words("W-CFG-ADDRESS", allowed=allowed))
    elif scheme in _NUMBERED and not _is_host(url, needs_port=scheme not in _PORTLESS):
        yield broken(tree, place, words("W-CFG-HOST", scheme=scheme))


def _is_host(url: str, *, needs_port: bool) -> bool:
    try:
        parts = urlsplit(url)
        host, has_port = parts.hostname or "", parts.port is not None or not needs_port
        if _DOTTED.fullmatch(host):
            ip_address(host)
        return bool(host) and has_port and parts.port != 0 and " " not in url
    except ValueError:
        return False
