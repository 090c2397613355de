"""The site file of a running cell: what a gateway needs to know of it, and nothing more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from simulators.cellfile import CellAxis, CellFile, InspectionMachine, Part, Setup
from simulators.nck import NckSpec

_BOOT_S = next(one.default for one in fields(NckSpec) if one.name == "boot_s")
_POINTS_PER_SPACE = 110  # two flanks, five lines of eleven points


def site_text(
    cell: CellFile, serial: str, controller: Mapping[str, Any], urls: Mapping[str, str], gear: str = ""
) -> str:
    """A site file in TOML. `controller` has url, settings and maybe a driver; `urls` names each instrument's wire.

    ``gear`` is the path of the part's gear file; with it and ``[site] plan`` come every set-up and the work.
    """
    site = cell.site
    parts = [
        f"# Written by the simulated cell {cell.name!r}; valid while it runs.",
        # Nobody else works at a simulated machine.
        section("site", {"name": site.name, "store": site.store, "approvals": 1, "simulated": True}),
        section(
            "controller",
            {"driver": "sinumerik-opcua", "serial": serial, **_patience(cell), **site.controller, **controller}
            | {"identity": _identity(cell)},
        ),
    ]
    if site.operator:
        parts.append(section("operator", site.operator))
    # Nothing stands in the way of a simulated wheel: every axis may be anywhere in its travel.
    safe = {axis.name: [0.0, 360.0] if axis.modulo else list(axis.travel) for axis in cell.axes}
    parts.append(section("times", _times(cell)))
    parts.append(section("moves", {"safe": safe, **site.moves}))
    parts += [_instrument(cell, name, url) for name, url in urls.items()]
    axes = [axis for axis in cell.axes if axis.measure is not None and axis.table is not None]
    parts += [_axis(cell, axis) for axis in axes]
    if site.plan:
        parts += _plan(cell, {axis.letter: axis.name for axis in axes}, gear)
    return "\n".join(parts)


def _identity(cell: CellFile) -> dict[str, str]:
    """What else the machine is known by, as `init` would read it of the control that the cell file describes."""
    return {"version": cell.machine.nck_version, "axes": " ".join(axis.name for axis in cell.axes)}


def _times(cell: CellFile) -> dict[str, Any]:
    """How quick this cell's person, control and gear inspection are, for who reckons a day at it."""
    who, gear = cell.operator, next((one for one in cell.instruments if isinstance(one, InspectionMachine)), None)
    boot_s = cell.machine.switches.get("boot_s", _BOOT_S)
    times = {"start_s": who.start_delay_s, "restart_s": who.activate_delay_s + boot_s, "warm_up_min": 0.0}
    times |= {"mounting_min": round(who.setup_delay_s / 60.0, 3), "clamping_min": round(who.load_delay_s / 60.0, 3)}
    if gear is not None and cell.part is not None:
        points = _POINTS_PER_SPACE * cell.part.gear.zc
        times["inspection_min"] = round(points * gear.seconds_per_point / 60.0, 3)
    return times


def _patience(cell: CellFile) -> dict[str, Any]:
    return {"timeout_s": cell.site.patience_s} if cell.site.patience_s else {}


def _quiet(cell: CellFile, driver: str) -> dict[str, Any]:
    """How long a stream may be silent."""
    return {"stale_s": cell.site.patience_s} if cell.site.patience_s and driver != "bridge-gear" else {}


def _instrument(cell: CellFile, name: str, url: str) -> str:
    spec = next(found for found in cell.instruments if found.name == name)
    driver = {"umd": "umd", "gear": "bridge-gear"}.get(spec.kind, "bridge")
    serial = spec.serial if driver != "umd" else ""  # a uMD counter has no serial number of its own
    keys: dict[str, Any] = {"name": name, "driver": driver, "url": url, "serial": serial, **_patience(cell)}
    settings = {**_quiet(cell, driver), **spec.settings}
    return section("[instruments]", keys | ({"settings": settings} if settings else {}))


def _axis(cell: CellFile, axis: CellAxis) -> str:
    measure = dict(axis.measure or {})
    setup = _setup(cell, axis, str(measure.get("component", "")))
    if setup is not None and "file" not in measure:
        measure.setdefault("instrument", setup.instrument)
        measure.setdefault("dead_path_mm", setup.dead_path_mm)
    keys = {
        "name": axis.name,
        "letter": axis.letter,
        "kind": axis.kind,
        "travel": list(axis.travel),
        "reference": axis.reference,
        "modulo": axis.modulo,
    } | ({"encoder": axis.encoder} if axis.encoder else {})
    return "\n".join(
        (section("[axes]", keys), section("axes.measure", measure), section("axes.table", axis.table or {}))
    )


def _plan(cell: CellFile, axes: Mapping[str, str], gear: str) -> list[str]:
    """Every set-up beyond the axes' own, those along a bar with the table at 0 and at 180, and the work.

    An axis' own one is there too where its reflector stands off the point that counts, so that the lever is known.
    """
    own = {(str((axis.measure or {}).get("component", "")), axis.letter) for axis in cell.axes}
    parts = []
    for setup in cell.setups:
        if setup.axis in axes and ((setup.component, setup.axis) not in own or any(setup.offset_mm)):
            turns = (0.0, 180.0) if setup.optics == "bar" and setup.axis == "Z" and "C" in axes else (None,)
            parts += [section("[setups]", _planned(cell, setup, axes, turn)) for turn in turns]
    if cell.part is not None and gear:
        work = {"gear": gear, "height_mm": cell.part.grinding.height_mm}
        parts.append(section("work", work | _wheel(cell) | _inspector(cell)))
    return parts


def _wheel(cell: CellFile) -> dict[str, Any]:
    """The dresser's axis, which is not measured, so no other part of a site file has it; and what places the wheel."""
    letters: dict[str, CellAxis] = {axis.letter: axis for axis in cell.axes}
    dresser, carrier = letters.get(cell.wheel.dresser), letters.get(cell.wheel.place)
    keys: dict[str, Any] = {"dresser": ""}
    if dresser is not None:
        keys = {"dresser": dresser.name, "dresser_letter": dresser.letter}
    if carrier is not None:
        keys |= {"wheel_place": carrier.name, "wheel_letter": carrier.letter, "wheel_travel": list(carrier.travel)}
    elif cell.wheel.parameter is not None:
        keys |= {"wheel_place": cell.wheel.place}
    return keys | {"wheel_on": "S1500 M3", "wheel_off": "M5"}


def _inspector(cell: CellFile) -> dict[str, Any]:
    """The gear inspection machine of the cell, if it has one."""
    return next(({"inspector": one.name} for one in cell.instruments if one.kind == "gear"), {})


def _planned(cell: CellFile, setup: Setup, axes: Mapping[str, str], turn: float | None) -> dict[str, Any]:
    keys: dict[str, Any] = {"axis": axes[setup.axis], "component": setup.component, "instrument": setup.instrument}
    if any(setup.offset_mm):
        keys["offset_mm"] = list(setup.offset_mm)
    certified = getattr(next(spec for spec in cell.instruments if spec.name == setup.instrument), "certified_u", None)
    if certified is not None:
        keys["U"] = certified
    return keys | setup.plan | ({"park": {axes["C"]: turn}} if turn is not None else {})


def gear_text(part: Part) -> str:
    """The part's gear file."""
    gear = {key: item for key, item in part.gear.model_dump().items() if item or key not in {"drp", "drrp", "drot"}}
    distance = {"centre_distance_mm": part.grinding.centre_distance_mm}
    return "\n".join((f"name = {quoted(part.name)}\n", section("gear", gear), section("grinding", distance)))


def _setup(cell: CellFile, axis: CellAxis, component: str) -> Setup | None:
    found = (s for s in cell.setups if s.axis == axis.letter and s.component == component)
    return next(found, None)


def section(name: str, keys: Mapping[str, Any]) -> str:
    """One TOML table with its keys, ended by an empty line."""
    lines = [f"{key} = {value(item)}" for key, item in keys.items()]
    return "\n".join((f"[{name}]", *lines, ""))


def value(item: Any) -> str:
    """A value in TOML: text, numbers, true and false, lists and inline tables."""
    match item:
        case bool():
            return "true" if item else "false"
        case int() | float():
            return repr(item)
        case list() | tuple():
            return "[" + ", ".join(value(each) for each in item) + "]"
        case Mapping():
            return "{ " + ", ".join(f"{key} = {value(each)}" for key, each in item.items()) + " }"
        case _:
            return quoted(str(item))


def quoted(text: str) -> str:
    """A TOML basic string."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    plain = "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped)
    return f'"{plain}"'
