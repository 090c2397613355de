"""The questions of `init` in turn, and the survey of the control between them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from drivers import registry
from drivers.checks import ControlAxis, ControlFacts, TrustView
from drivers.clock import Clock, LoopClock
from drivers.errors import TrueflankError, words
from drivers.local.names import is_name, shown
from drivers.local.ownfiles import open_own
from drivers.ports.controller import Controller
from drivers.ports.devices import Survey
from drivers.settings import SPEED_KEYS
from drivers.types.moves import FEED_DEG, FEED_MM
from gateway.cli.setup.questions import (
    NONE,
    SAMPLE,
    Objection,
    Questioner,
    check_address,
    check_gear_file,
    check_instrument,
    check_optics,
    keep_password,
    keep_token,
    objection,
    split_gear_height,
)
from gateway.cli.setup.site_tree import (
    ROTARY,
    SAMPLE_GEAR,
    TURN,
    AxisToMeasure,
    axis_tree,
    grinds,
    letter_of,
    plan_axis,
    setup_trees,
    used_letters,
    work_tree,
)

TIMEOUT_S = 10.0
_UA, _PLC, _CARRIED, _AGENT = "sinumerik-opcua", "sinumerik-modbus", "sinumerik-offline", "linuxcnc-agent"
ROADS = {"opcua": _UA, "mailbox": _PLC, "carried": _CARRIED, "linuxcnc": _AGENT, "files": "none"}
WIRELESS = ("carried", "files")
URLS = {"opcua": "opc.tcp://192.168.214.1:4840", "mailbox": "tcp://192.168.214.1:502"}
URLS |= {"linuxcnc": "tcp://127.0.0.1:5011", "carried": "carried://stick"}
CERTIFICATE = "control.der"
STORE = "runs"
USUAL_AXES = {"linuxcnc": "X Y Z"}
USUAL_GRINDER = "X1 Z1 C1"
USUAL_TRAVEL = (0.0, 500.0)
GEAR = "gear.toml"
TYPED = ("manual", "terminal://")
MOST_TABLES = 62
"""What an instrument without a driver is: a person reads it and types."""
_TRAVEL = re.compile(r"(\w+)\s+([+-]?\d+(?:\.\d+)?)\s+([+-]?\d+(?:\.\d+)?)")
_PLACE = re.compile(_TRAVEL.pattern + r"|\w+\s+any")


def wizard_text(file: Path, asker: Questioner) -> str:
    """The text of a site file by answers. Raises ConfigError (E-INIT-ANSWER, E-INIT-ENDED)."""
    from gateway.config import site_text

    folder = file.resolve().parent
    known = _check_one_of(tuple(ROADS))
    road = _normalise_key(asker.ask("road", "P-INIT-ROAD", "opcua", lambda text: known(_normalise_key(text))))
    name = asker.ask("name", "P-INIT-NAME", "mill" if road == "linuxcnc" else "grinder", _check_machine_name)
    control = _ask_connection(asker, road, folder)
    facts = _read_control(road, control, folder, asker)
    if road != "files":
        control["serial"] = facts.serial if facts else asker.ask("serial", "P-INIT-SERIAL", "unknown", _check_not_empty)
        known = {fact: value for fact, value in facts.identity.items() if fact != "serial"} if facts else {}
        control |= {"identity": known} if known else {}
    axes, notes = _ask_axes(asker, facts, USUAL_AXES.get(road, USUAL_GRINDER))
    instruments = _ask_instruments(asker, road, {axis.unit for axis, _ in axes})
    pair = (instruments[0]["name"], instruments[-1]["name"]) if instruments else ("", "")
    plans = used_letters([plan_axis(axis, travel, pair) for axis, travel in axes])
    tree: dict[str, Any] = {"site": {"name": name, "store": STORE}, "controller": control, "instruments": instruments}
    tree["axes"] = [axis_tree(plan) for plan in plans]
    others = [axis.name for axis in (facts.axes if facts else ())]
    if road == "carried":
        others = _ask_axis_order(asker, [axis.name for axis, _ in axes])
        control["settings"] |= {"axes": " ".join(others)}
    if road != "files":
        safe = _ask_safe_positions(asker, [*dict.fromkeys([*(axis.name for axis, _ in axes), *others])])
        tree["moves"] = {"safe": safe, "feed_mm": FEED_MM, "feed_deg": FEED_DEG}
    if grinds(plans):
        _ask_gear(asker, tree, plans, folder, facts)
    version = facts.version if facts else words("P-INIT-UNREAD")
    head = words("P-INIT-HEAD-FILES", name=name) if road == "files" else ""
    return site_text(tree, head or words("P-INIT-HEAD", name=name, version=version, road=road), notes)


def _ask_connection(asker: Questioner, road: str, folder: Path) -> dict[str, Any]:
    if road == "files":
        return {"driver": ROADS[road]}
    control: dict[str, Any] = {"driver": ROADS[road], "url": URLS["opcua"], "serial": ""}
    if road == "carried":
        tables = int(asker.ask("cross", "P-INIT-CROSS", "0", _check_count))
        return control | {"url": URLS[road], "settings": {"folder": "carried", "axes": "", "cross_tables": tables}}
    driver = ROADS[road]
    control["url"] = asker.ask("url", "P-INIT-URL", URLS[road], lambda url: check_address(driver, "controller", url))
    if road == "mailbox":
        return control | {"settings": {"unit": 1, "word_order": "high-first"}}
    if road == "linuxcnc":
        return control | {"settings": keep_token(asker, folder)}
    settings = {"user": asker.ask("user", "P-INIT-USER", "OpcUaClient", _check_not_empty)}
    return control | {"settings": settings | keep_password(asker, folder) | {"server_certificate": CERTIFICATE}}


def _read_control(road: str, control: dict[str, Any], folder: Path, asker: Questioner) -> ControlFacts | None:
    """What the control tells; None, with the reason said, where it cannot be asked now."""
    if road in WIRELESS:
        return None
    settings = dict(control["settings"])
    for key in ("password_file", "server_certificate", "token_file"):
        settings |= {key: str(folder / settings[key])} if key in settings else {}
    try:
        if road == "opcua" and not _trust_certificate(control, settings, folder, asker):
            return None
        at = (control["driver"], control["url"])
        facts = asker.found(
            ("survey", *at, str(settings)),
            lambda: survey_control(*at, settings, clock=LoopClock(), timeout_s=TIMEOUT_S),
        )
    except TrueflankError as error:
        asker.tell("P-INIT-NO-CONTROL", loud=True, why=str(error))
        return None
    names = " ".join(axis.name for axis in facts.axes)
    told: dict[str, Any] = {"serial": facts.serial, "version": facts.version, "units": facts.unit_system, "axes": names}
    asker.tell("P-INIT-FOUND", **told)
    return facts


def _trust_certificate(control: dict[str, Any], settings: dict[str, Any], folder: Path, asker: Questioner) -> bool:
    """Whether the certificate that the control shows is accepted: a person typed its thumbprint."""
    from gateway.workflow.run.identity import pin_certificate

    clock = LoopClock()
    trust = registry.load(f"{control['driver']}-trust", "trust")("control", control["url"], settings, clock)
    view: TrustView = asker.found(("trust", control["url"]), lambda: trust.show(TIMEOUT_S))
    if view.equal:
        return True
    asker.tell("P-INIT-SHOWN", subject=view.shown.subject, sha256=view.shown.sha256, sha1=view.shown.sha1)

    def judge(text: str) -> Objection | None:
        return None if not text or view.shown.is_called(text) else objection("W-INIT-THUMBPRINT")

    typed = asker.ask("thumbprint", "P-INIT-THUMBPRINT", "", judge)
    if not typed:
        asker.tell("P-INIT-NOT-TRUSTED", loud=True)
        return False
    how: dict[str, Any] = {"clock": clock, "timeout_s": TIMEOUT_S}
    asker.found(("accept", typed), lambda: pin_certificate(trust, folder / STORE, typed, asker.who, **how))
    return True


AxesWithTravel = list[tuple[ControlAxis, tuple[float, float]]]


def _ask_axes(asker: Questioner, facts: ControlFacts | None, names: str) -> tuple[AxesWithTravel, dict[str, str]]:
    """The axes to be measured with their travel, and which keys the control told; ``names`` where it told none."""
    known = {axis.name: axis for axis in facts.axes} if facts else {}
    default = " ".join(known) or names
    asked = asker.ask("axes", "P-INIT-AXES", default, lambda text: _check_axis_names(text, known, default))
    chosen = [
        known.get(name) or ControlAxis(name, "deg" if letter_of(name) in ROTARY else "mm")
        for name in _split_names(asked)
    ]
    usual = {axis.name: (0.0, TURN) if axis.unit == "deg" else USUAL_TRAVEL for axis in chosen}
    untold = [axis.name for axis in chosen if axis.travel is None and not axis.modulo]
    typed: dict[str, tuple[float, float]] = {}
    if untold:
        default = ", ".join(f"{name} {usual[name][0]:g} {usual[name][1]:g}" for name in untold)
        typed = _parse_ranges(asker.ask("travel", "P-INIT-TRAVEL", default, lambda text: _check_travel(text, untold)))
    told = words("P-INIT-TOLD")
    notes = {f"{axis.name}.travel": told for axis in chosen if axis.travel is not None}
    notes |= {f"{axis.name}.encoder": told for axis in chosen if axis.encoder is not None}
    return [(axis, axis.travel or typed.get(axis.name) or usual[axis.name]) for axis in chosen], notes


def _ask_axis_order(asker: Questioner, measured: Sequence[str]) -> list[str]:
    """Every axis of the control in its own order: programs that are carried name them by their numbers."""

    def judge(text: str) -> Objection | None:
        left_out = [name for name in measured if name not in _split_names(text)]
        return (
            objection("W-INIT-ORDER", names=", ".join(left_out))
            if left_out
            else _check_axis_names(text, {}, " ".join(measured))
        )

    return _split_names(asker.ask("order", "P-INIT-ORDER", " ".join(measured), judge))


def _ask_safe_positions(asker: Questioner, names: Sequence[str]) -> dict[str, Any]:
    """Where each axis of the control may stand while programs move others; what is left out is asked before a push."""

    def judge(text: str) -> Objection | None:
        parts = [part.strip() for part in text.split(",")] if text.strip() else []
        right = all(_PLACE.fullmatch(part) and part.split()[0] in names for part in parts)
        ordered = all(low < high for low, high in _parse_ranges(text).values())
        return None if right and ordered else objection("W-INIT-SAFE", names=", ".join(names))

    text = asker.ask("safe", "P-INIT-SAFE", "", judge, axes=", ".join(names))
    anywhere = dict.fromkeys(re.findall(r"(\w+)\s+any", text), "any")
    return anywhere | {name: list(ends) for name, ends in _parse_ranges(text).items()}


def _ask_instruments(asker: Questioner, road: str, units: set[str]) -> list[dict[str, Any]]:
    """What measures linear axes, and what measures rotary ones."""
    if road == "files":
        return []
    if road in WIRELESS:
        return [{"name": "typed", "driver": "manual", "url": "terminal://"}]
    found = []
    if "mm" in units:
        found.append(("laser", asker.ask("laser", "P-INIT-LASER", "umd COM5", check_instrument)))
    if "deg" in units:
        default = "bridge tcp://127.0.0.1:7001"
        found.append(("calibrator", asker.ask("calibrator", "P-INIT-CALIBRATOR", default, check_instrument)))
    split = [(name, *text.split(maxsplit=1)) for name, text in found]
    return [{"name": name, "driver": driver, "url": url, **_speed_settings(driver)} for name, driver, url in split]


def _speed_settings(driver: str) -> dict[str, Any]:
    """The key that says how fast a counting instrument follows, not known (0) until a person reads its data sheet."""
    spec = registry.known().get(driver)
    model = spec.load_settings() if spec is not None else None
    if model is None or not model.counts_motion:
        return {}
    open_ = [key for key in SPEED_KEYS if key in model.model_fields and model.model_fields[key].default == 0.0]
    return {"settings": dict.fromkeys(open_, 0.0)}


def _ask_gear(
    asker: Questioner, tree: dict[str, Any], axes: Sequence[AxisToMeasure], folder: Path, facts: ControlFacts | None
) -> None:
    """The gear that is ground, and the set-ups of the errors that further optics show; nothing where there is none."""
    answer = asker.ask("gear", "P-INIT-GEAR", NONE, lambda text: check_gear_file(text, folder))
    if answer == NONE:
        return
    asked = asker.ask("optics", "P-INIT-OPTICS", NONE, check_optics)
    found = [] if asked == NONE else [part.split(maxsplit=2) for part in asked.split(",")]
    tree["instruments"] += [
        {"name": name, **dict(zip(("driver", "url"), rest or TYPED, strict=True))} for name, *rest in found
    ]
    tree["setups"] = setup_trees(axes, [name for name, *_ in found])
    measured = {axis.name for axis in axes}
    others = [axis for axis in (facts.axes if facts else ()) if axis.name not in measured]
    name, height = split_gear_height(answer)
    tree["work"] = work_tree(axes, _write_sample_gear(folder) if name == SAMPLE else name, height, others)


def _write_sample_gear(folder: Path) -> str:
    """The sample's file, for a person to change; one that is there is kept."""
    if not (folder / GEAR).exists():
        with open_own(folder / GEAR, "xb") as file:
            file.write(SAMPLE_GEAR.encode())
    return GEAR


# ---- checks of answers


def _normalise_key(text: str) -> str:
    """A word as its key has it: "OPC UA" and "OpcUa" are opcua."""
    return re.sub(r"[ _-]", "", text.lower())


def _check_one_of(allowed: tuple[str, ...]) -> Any:
    return lambda text: None if text in allowed else objection("W-CFG-ONE-OF", allowed=", ".join(allowed))


def _check_not_empty(text: str) -> Objection | None:
    return None if text.strip() else objection("W-CFG-MISSING")


def _check_count(text: str) -> Objection | None:
    is_count = text.isascii() and text.isdigit() and int(text) <= MOST_TABLES
    return None if is_count else objection("W-INIT-COUNT", most=MOST_TABLES)


def _check_machine_name(text: str) -> Objection | None:
    return None if is_name(text) and re.fullmatch(r"[A-Za-z0-9_.-]+", text) else objection("W-CFG-SITE-NAME")


def _split_names(text: str) -> list[str]:
    return [name for name in re.split(r"[\s,;]+", text) if name]


def _check_axis_names(text: str, known: dict[str, ControlAxis], usual: str) -> Objection | None:
    names = _split_names(text)
    wrong = [name for name in names if not is_name(name) or (known and name not in known)]
    if wrong or not names or len(set(names)) < len(names):
        return objection("W-INIT-AXES", wrong=shown(", ".join(wrong) or text), known=usual)
    return None


def _parse_ranges(text: str) -> dict[str, tuple[float, float]]:
    return {name: (float(low), float(high)) for name, low, high in _TRAVEL.findall(text)}


def _check_travel(text: str, names: list[str]) -> Objection | None:
    found = _parse_ranges(text)
    right = all(name in found and found[name][0] < found[name][1] for name in names)
    return None if right else objection("W-INIT-TRAVEL", names=", ".join(names))


# ---- the survey of a control, by its own survey where the connection has one, else through the port


async def survey_control(
    driver: str, url: str, settings: Mapping[str, Any], *, clock: Clock, timeout_s: float
) -> ControlFacts:
    """Everything the road can tell. Raises what opening it raises, ConfigError (E-CFG-DRIVER)."""
    name = f"{driver}-survey"
    if name in registry.known("survey"):
        survey = cast(Survey, registry.load(name, "survey")("control", url, settings, clock))
        return await survey.survey(timeout_s)
    controller = cast(Controller, registry.load(driver, "controller")("control", url, settings, clock))
    try:
        await controller.open(timeout_s)
        return await _through_port(controller)
    finally:
        await controller.close()


async def _through_port(controller: Controller) -> ControlFacts:
    machine, state = await controller.identify(), await controller.state()
    axes = [
        ControlAxis(name, state.axes[name].unit, points=await _reserved_points(controller, name))
        for name in machine.axis_names
        if name in state.axes
    ]
    return ControlFacts(machine.serial, machine.version, machine.unit_system, tuple(axes), identity=machine.facts)


async def _reserved_points(controller: Controller, axis: str) -> int | None:
    try:
        return (await controller.table_limits(axis)).reserved_points
    except TrueflankError:
        return None
