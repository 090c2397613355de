"""What a person types at a simulated machine, as the judge's questions and orders; pure."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from simulators.operator import KEYS

Order = dict[str, Any]
WEATHER = {"AIR": "air_degc", "MATERIAL": "material_degc", "PRESSURE": "pressure_hpa", "HUMIDITY": "humidity_pct"}
NUMBER = r"(?P<value>[+-]?\d+(?:\.\d+)?)"
WORDS: Mapping[str, str] = {
    "reset | nc start | nck reset": "a key of the machine's panel",
    "auto off | auto on": "whether the operator does by himself what the control's message says",
    "mount EXX X1": "mount the set-up of that component on that axis",
    "break laser | clear laser": "something stands in the beam of that instrument; it is gone",
    "pull laser | plug laser": "the instrument's cable",
    "load blank | take part": "clamp a new blank; take off what is on the table",
    "air 25 | material 23 | pressure 980 | humidity 40": "the weather from now on, in degC, hPa and %",
    "jog X1 -200 | mode AUTO": "move an axis by hand; AUTO, JOG or MDA",
    "confirm | release on | release off": "the PLC's panel",
    "power": "the main switch off and on",
    "status": "channel, message, positions and what the operator did",
    "help": "these words",
}

Made = Callable[[re.Match[str], str], Order]


def _same(order: Order) -> Made:
    return lambda _found, _line: order


PATTERNS: tuple[tuple[str, Made], ...] = (
    ("|".join(KEYS), lambda found, _line: {"set": "press", "key": found[0]}),
    (r"AUTO (?P<how>ON|OFF)", lambda found, _line: {"set": "operator", "options": {"auto": found["how"] == "ON"}}),
    (
        r"MOUNT (?P<what>\S+) (?P<axis>\S+)",
        lambda f, _l: {"set": "mount", "component": f["what"], "axis": f["axis"]},
    ),
    (r"(?P<how>BREAK|CLEAR) \S+", lambda f, line: {**_named("beam", line), "broken": f["how"] == "BREAK"}),
    (r"PULL \S+", lambda _f, line: _named("pull", line)),
    (r"PLUG \S+", lambda _f, line: _named("plug", line)),
    (r"LOAD BLANK", _same({"set": "load_blank"})),
    (r"TAKE PART", _same({"set": "unload_part"})),
    (
        rf"(?P<what>{'|'.join(WEATHER)}) {NUMBER}",
        lambda f, _line: {"set": "weather", WEATHER[f["what"]]: float(f["value"])},
    ),
    (rf"JOG (?P<axis>\S+) {NUMBER}", lambda f, _line: {"set": "jog", "axis": f["axis"], "value": float(f["value"])}),
    (r"MODE (?P<mode>AUTO|JOG|MDA)", lambda f, _line: {"set": "mode", "value": f["mode"]}),
    (r"CONFIRM", _same({"set": "confirm"})),
    (r"RELEASE (?P<how>ON|OFF)", lambda f, _line: {"set": "release", "value": f["how"] == "ON"}),
    (r"POWER", _same({"set": "power_cycle"})),
    (r"STATUS", _same({"ask": "status"})),
)


def _named(what: str, line: str) -> Order:
    """Instruments are named as they are written."""
    return {"set": what, "instrument": line.split()[1]}


def order_of(line: str) -> Order | None:
    """What a typed line asks for; None when it is none of `WORDS`. Names of instruments are taken as typed."""
    typed = " ".join(line.split())
    for pattern, made in PATTERNS:
        found = re.fullmatch(pattern, typed.upper())
        if found is not None:
            return made(found, typed)
    return None
