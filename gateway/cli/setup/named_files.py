"""The files that a site file names: whether they exist, can be read and contain what the key asks for."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator, Mapping
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.errors import TrueflankError, words
from drivers.local.names import shown
from gateway.config import Fault, SiteReading, broken_rule, place_name, value_at
from gateway.errors import ModelError

LOGOS = (".svg", ".png", ".jpg", ".jpeg")
FILE_ROLES = ("file", "gear-file")
_OTHERS = stat.S_IRGRP | stat.S_IROTH
MOST_SECRET = 1 << 16
_LITERAL = re.compile(r"^~|\$\w|\$\{|%\w+%")
"""What a shell would replace in a path, and nobody does here."""


def named_file_faults(reading: SiteReading, path: Path) -> tuple[Fault, ...]:
    """Every file that is missing or wrong; those of keys that are wrong themselves are not looked for."""
    folder, tree, site = path.parent, reading.tree, reading.seen
    found = [
        *_store(tree, site, folder),
        *_ports(tree, site),
        *_settings(tree, site, path),
        *_results(tree, site, folder),
    ]
    found += [*_service(tree, site, path), *_report(tree, site, folder), *_calibrations(tree, site)]
    return (*found, *_gear(tree, site, folder), *_part(reading, path))


def _fault(tree: Any, place: tuple[str | int, ...], file: Path, why: str, *, doubt: bool = False) -> Fault:
    fields = {"key": place_name(tree, place), "file": str(file), "why": why}
    return Fault(place, "W-CFG-FILE-DOUBT" if doubt else "E-CFG-FILE", fields, doubt=doubt)


def unreadable(file: Path) -> str:
    """Why a file cannot be read, in words; "" where it can."""
    try:
        kind = file.stat()
        if not stat.S_ISREG(kind.st_mode):
            return words("W-TOML-FOLDER" if stat.S_ISDIR(kind.st_mode) else "W-TOML-NO-FILE")
        with file.open("rb") as opened:
            return "" if opened.read(1) else words("W-CFG-EMPTY")
    except (OSError, ValueError) as error:
        return (error.strerror if isinstance(error, OSError) else "") or str(error)


def _store(tree: Any, site: Any, folder: Path) -> Iterator[Fault]:
    store = getattr(site.site, "store", None)
    if store == "":
        yield broken_rule(tree, ("site", "store"), words("W-CFG-NOT-EMPTY"))
    if isinstance(store, str | Path) and (folder / store).exists() and not (folder / store).is_dir():
        yield _fault(tree, ("site", "store"), folder / store, words("W-CFG-NO-FOLDER"))
    if isinstance(store, str | Path) and _LITERAL.search(str(store)) and not (folder / store).exists():
        yield broken_rule(tree, ("site", "store"), words("W-CFG-LITERAL-PATH"), doubt=True)
    elif isinstance(store, str | Path) and str(store) and not (folder / store).parent.exists():
        yield broken_rule(
            tree, ("site", "store"), words("W-CFG-STORE-NEW", folder=shown((folder / store).parent)), doubt=True
        )


def _ports(tree: Any, site: Any) -> Iterator[Fault]:
    """Serial ports that this PC does not have now: not plugged in, or mistyped."""
    for section in (site.controller, *site.instruments):
        url = getattr(section, "url", None)
        if isinstance(url, str) and url.startswith("/dev/") and os.name == "posix" and not Path(url).exists():
            yield broken_rule(tree, (*section.place, "url"), words("W-CFG-NO-PORT"), doubt=True)


def _settings(tree: Any, site: Any, path: Path) -> Iterator[Fault]:
    for section in (site.controller, *site.instruments):
        spec = registry.known().get(section.driver) if hasattr(section, "place") else None
        model = spec.load_settings() if spec is not None else None
        if model is None or not isinstance(section.settings, Mapping):
            continue
        for key, kind in model.paths().items():
            value = section.settings.get(key)
            if isinstance(value, str) and value:
                place = (*section.place, "settings", key)
                yield from _named_file_faults(tree, place, path, value, kind)


def _named_file_faults(tree: Any, place: tuple[str | int, ...], path: Path, value: str, kind: str) -> Iterator[Fault]:
    file = path.parent / value
    if kind == "environment":
        if value not in os.environ:
            yield _fault(tree, place, Path(value), words("W-CFG-NOT-SET"), doubt=True)
    elif kind == "folder":
        if file.exists() and not file.is_dir():
            yield _fault(tree, place, file, words("W-CFG-NO-FOLDER"))
    elif why := unreadable(file):
        if kind == "certificate":
            fields = {"key": place_name(tree, place), "file": str(file), "why": why, "site": str(path)}
            yield Fault(place, "E-CFG-CERTIFICATE", fields)
        else:
            yield _fault(tree, place, file, why)
    elif kind == "certificate" and not _is_certificate(file):
        yield _fault(tree, place, file, words("W-CFG-NO-CERTIFICATE"))
    elif kind == "secret" and (why := _no_secret(file)):
        yield _fault(tree, place, file, why)
    elif kind == "secret" and os.name == "posix" and file.stat().st_mode & _OTHERS:
        yield _fault(tree, place, file, words("W-CFG-OPEN-SECRET"), doubt=True)


def _no_secret(file: Path) -> str:
    """Why a file is no secret in a text, in words; "" where it may be one."""
    with file.open("rb") as opened:
        data = opened.read(MOST_SECRET + 1)
    try:
        text = data.decode("utf-8-sig")
    except ValueError:
        return words("W-CFG-NO-SECRET")
    return "" if len(data) <= MOST_SECRET and text.strip() and "\0" not in text else words("W-CFG-NO-SECRET")


def _is_certificate(file: Path) -> bool:
    """By its first bytes: DER begins a sequence, PEM says what it is."""
    with file.open("rb") as opened:
        first = opened.read(64).lstrip()
    return first[:1] == b"\x30" or first.startswith(b"-----BEGIN CERTIFICATE")


def _service(tree: Any, site: Any, path: Path) -> Iterator[Fault]:
    """Files of the service: its certificate and key, the address of its index, what it watches, its messages."""
    service = site.service
    place: tuple[str, ...] = ("service",)
    keys = {"certificate": "certificate", "key": "secret", "index_url_file": "secret", "watch": "present"}
    named = [(service, place, key, kind) for key, kind in keys.items()]
    if hasattr(service.mqtt, "place"):
        named += [(service.mqtt, (*place, "mqtt"), "password_file", "secret")]
        named += [(service.mqtt, (*place, "mqtt"), "ca", "certificate")]
        named += [(service.mqtt, (*place, "mqtt"), "password_env", "environment")]
    for section, where, key, kind in named:
        value = getattr(section, key)
        if not isinstance(value, str) or not value:
            continue
        file = path.parent / value
        if kind == "present":
            if not file.is_dir():
                why = words("W-CFG-NO-FOLDER") if file.exists() else words("W-CFG-NO-SUCH-FOLDER")
                yield _fault(tree, (*where, key), file, why)
        elif kind == "certificate" and (why := unreadable(file)):
            yield _fault(tree, (*where, key), file, why)
        else:
            yield from _named_file_faults(tree, (*where, key), path, value, kind)


def _report(tree: Any, site: Any, folder: Path) -> Iterator[Fault]:
    logo = getattr(site.report, "logo", None)
    if isinstance(logo, str) and logo:
        file = folder / logo
        why = unreadable(file)
        if not why and file.suffix.lower() not in LOGOS:
            why = words("W-CFG-ENDING", known=", ".join(LOGOS))
        if why:
            yield _fault(tree, ("report", "logo"), file, why)


def _calibrations(tree: Any, site: Any) -> Iterator[Fault]:
    """The machine's year and the days of the register beside today."""
    today = datetime.now(UTC).date()
    year = getattr(site.machine, "year", None)
    if isinstance(year, int) and year > today.year:
        yield broken_rule(tree, ("machine", "year"), words("W-CFG-FUTURE", day=year), doubt=True)
    for one in site.equipment:
        for key, code in (("calibrated", "W-CFG-FUTURE"), ("due", "W-CFG-OVERDUE")):
            day = getattr(one, key)
            if isinstance(day, date) and (day > today if key == "calibrated" else day < today):
                yield broken_rule(tree, (*one.place, key), words(code, day=day.isoformat()), doubt=True)


def _part(reading: SiteReading, path: Path) -> Iterator[Fault]:
    """What forbids a test part, as the grinding itself would refuse it; only of a site that is right otherwise.

    A place beyond the travel is a doubt: whoever grinds by the builder's own programs needs no such part.
    """
    site = reading.site
    if site is None or reading.faults or site.work is None or unreadable(path.parent / site.work.gear):
        return
    from gateway.tooth import SetupValues
    from gateway.workflow.run.paper_control import paper_control
    from gateway.workflow.tooth.part_plan import gear_of_site, grind_plan

    try:
        plan = grind_plan(site, gear_of_site(site, path), SetupValues())
        paper_control(site, path, ("grind",)).write(plan)
    except ModelError:
        return  # of the gear, which is told beside its file
    except TrueflankError as error:
        if not error.code.startswith("E-GRIND"):
            return  # nothing of the work; a control that runs no programs grinds none
        place: tuple[str, ...] = ("work", _key_of(site, error))
        place = place if value_at(reading.tree, place) is not None else ("work",)
        if error.code == "E-GRIND-TRAVEL":
            yield Fault(place, "W-CFG-NO-PART", {"why": error.what}, doubt=True)
        else:
            yield Fault(place, error.code, dict(error.fields))


def _key_of(site: Any, error: TrueflankError) -> str:
    """The key of [work] that a refusal of the grinding plan is about."""
    if error.code == "E-GRIND-WHEEL":
        return "wheel_on" if error.fields.get("words") == site.work.wheel_on else "wheel_off"
    if error.code == "E-GRIND-STOCK" and "stock_mm" in site.work.model_fields_set:
        return "stock_mm"
    if error.code == "E-GRIND-TRAVEL" and error.fields.get("axis") == site.work.wheel_place:
        return "wheel_travel"
    stroke = {one.name for one in site.axes if site.work.stroke in (one.name, one.letter)}
    if error.fields.get("axis") in stroke:
        return "height_mm"
    return str(error.fields.get("key", ""))


def _results(tree: Any, site: Any, folder: Path) -> Iterator[Fault]:
    named = [(axis.measure, "file") for axis in site.axes if hasattr(axis.measure, "place")]
    named += [(setup, "path") for setup in site.setups if setup.source == "file"]
    endings = {name for role in FILE_ROLES[:1] for name in registry.known(role)}
    for section, key in named:
        value = getattr(section, key)
        if isinstance(value, str):
            file = folder / value
            why = unreadable(file)
            if not why and file.suffix.lower().lstrip(".") not in endings:
                why = words("W-CFG-ENDING", known=", ".join(f".{name}" for name in sorted(endings)))
            if why:
                yield _fault(tree, (*section.place, key), file, why)


def _gear(tree: Any, site: Any, folder: Path) -> Iterator[Fault]:
    """The gear file is read as it would be for the tooth, and its gear is built."""
    gear = getattr(site.work, "gear", None)
    if not isinstance(gear, str):
        return
    file = folder / gear
    why = unreadable(file)
    if not why:
        yield from _built(tree, file)
    else:
        yield _fault(tree, ("work", "gear"), file, why)


def _built(tree: Any, file: Path) -> Iterator[Fault]:
    """The gear of a file, and the wheel beside it: what is wrong is in that file, and the path is right."""
    from gateway.errors import ModelError
    from gateway.study.inputs import gear_of, load_gear

    try:
        found = load_gear(file)
        tip, distance = gear_of(found).tip_radius, found.grinding.centre_distance_mm
        if not tip < distance:
            raise ModelError("E-GEAR-DISTANCE", str(file), E=distance, limit=round(tip, 3))
    except TrueflankError as error:
        key = place_name(tree, ("work", "gear"))
        yield Fault(
            ("work", "gear"), "E-CFG-GEAR", {"key": key, "file": str(file), "why": error.what, "cure": error.hint}
        )
