"""A site file with a plan of set-ups, as data."""

from __future__ import annotations

from typing import Any

from gateway.config import SiteFile
from gateway.config.loading import site_of as site_of_tree


def axis(name: str, kind: str, travel: list[float], component: str, **measure: Any) -> dict[str, Any]:
    keys = {
        "instrument": "laser" if kind == "linear" else "calibrator",
        "component": component,
        "targets": {"first": travel[0], "last": travel[1], "count": 11 if kind == "linear" else 13},
        "feed": 3000.0,
        "stable": 0.5,
    }
    low, high = travel
    return {
        "name": name,
        "letter": name[0],
        "kind": kind,
        "travel": travel,
        "modulo": kind == "rotary",
        "measure": keys | measure,
        "table": {"minimum": low, "maximum": high, "step": (high - low) / 10.0},
    }


def setup(component: str, on: str, instrument: str = "straightness", **keys: Any) -> dict[str, Any]:
    return {"axis": on, "component": component, "instrument": instrument} | keys


SETUPS = [
    setup("EYX", "X1", offset_mm=[0.0, 8.0, 12.0]),
    setup("B0Z", "X1"),
    setup("EAX", "X1", "level"),
    setup("EXZ", "Z1"),
    setup("B0Z-R", "Z1"),
    setup("EZX", "X1"),
    setup("B0Z", "Z1"),
    setup("B0Z-R", "X1"),
    setup("EXC", "C1", "indicator", offset_mm=[0.0, 0.0, 25.0]),
    setup("A0C", "Z1", "indicator", park={"C1": 0.0}),
    setup("A0C", "Z1", "indicator", park={"C1": 180.0}),
    setup("EBZ", "Z1", "", source="none", assumed=3.0),
]


def site_data(setups: list[dict[str, Any]] | None = None, **more: Any) -> dict[str, Any]:
    names = ("laser", "calibrator", "straightness", "level", "indicator")
    return {
        "site": {"name": "grinder"},
        "controller": {"url": "opc.tcp://127.0.0.1:4840", "serial": "1"},
        "instruments": [{"name": name, "driver": "bridge", "url": "tcp://127.0.0.1:1"} for name in names],
        "axes": [
            axis("X1", "linear", [-400.0, 0.0], "EXX"),
            axis("Z1", "linear", [0.0, 300.0], "EZZ"),
            axis("C1", "rotary", [0.0, 360.0], "ECC"),
        ],
        "setups": SETUPS if setups is None else setups,
    } | more


def site_of(setups: list[dict[str, Any]] | None = None, **more: Any) -> SiteFile:
    return site_of_tree(site_data(setups, **more), "site")
