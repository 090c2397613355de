"""Quantities of a certificate by D-SI: a figure with its U, lists over the targets, the conditions of a capture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drivers.message import words
from drivers.units import AxisUnit, DeviationUnit
from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.domain.values import FloatArray
from gateway.report.certificate.tree import Node, node

UNITS = {
    "um": r"\micro\metre",
    "arcsec": r"\arcsecond",
    "mm": r"\milli\metre",
    "deg": r"\degree",
    "degc": r"\degreecelsius",
    "hpa": r"\hecto\pascal",
    "pct": r"\percent",
}
"""Our units as D-SI writes them, after the SI brochure."""
PROBABILITY = "0.95"
FACTOR = "2"


def figure(name: str, value: float, *, U: float | None, unit: DeviationUnit) -> Node:
    """One value with its expanded uncertainty (k = 2) where that is known."""
    doubt = None
    if U is not None and np.isfinite(U):
        doubt = node(
            "si:expandedUnc",
            (
                node("si:uncertainty", _number(U)),
                node("si:coverageFactor", FACTOR),
                node("si:coverageProbability", PROBABILITY),
            ),
        )
    return _quantity(name, node("si:real", (node("si:value", _number(value)), node("si:unit", UNITS[unit]), doubt)))


def deviations(found: Evaluation, axis_unit: AxisUnit) -> Node:
    """Targets, and the mean deviation of either approach at each; targets that lack an approach are left out."""
    known = np.isfinite(found.mean_up) & np.isfinite(found.mean_down)
    if not known.any():
        return node("dcc:text", node("dcc:content", words("S-DCC-ONE-SIDE")))
    return node(
        "dcc:list",
        (
            _list("target position", found.targets[known], UNITS[axis_unit]),
            _list("mean deviation, forward", found.mean_up[known], UNITS[found.unit]),
            _list("mean deviation, reverse", found.mean_down[known], UNITS[found.unit]),
        ),
    )


def influences(capture: Capture, status: str) -> Node | None:
    """Air and material at the begin and at the end; None where nothing was read."""
    found = [
        node(
            "dcc:influenceCondition",
            (
                node("dcc:name", node("dcc:content", name, lang="en")),
                node("dcc:status", status),
                node("dcc:data", _list(words("S-DCC-FIRST-LAST"), np.asarray(values), unit)),
            ),
        )
        for name, values, unit in _read(capture)
    ]
    return node("dcc:influenceConditions", (*found,)) if found else None


def _read(capture: Capture) -> Iterator[tuple[str, list[float], str]]:
    ends = capture.ambient_start, capture.ambient_end
    for name, key, unit in (
        ("air temperature", "air_degc", "degc"),
        ("air pressure", "pressure_hpa", "hpa"),
        ("relative humidity", "humidity_pct", "pct"),
    ):
        values = [float(value) for one in ends if (value := getattr(one, key)) is not None]
        if values:
            yield name, values, UNITS[unit]
    for place in range(max(len(one.material_degc) for one in ends)):
        values = [one.material_degc[place] for one in ends if place < len(one.material_degc)]
        yield f"material temperature {place + 1}", values, UNITS["degc"]


def _list(name: str, values: FloatArray, unit: str) -> Node:
    told = " ".join(_number(float(one)) for one in values)
    return _quantity(name, node("si:realListXMLList", (node("si:valueXMLList", told), node("si:unitXMLList", unit))))


def _quantity(name: str, inside: Node) -> Node:
    return node("dcc:quantity", (node("dcc:name", node("dcc:content", name, lang="en")), inside))


def _number(value: float) -> str:
    """Shortest decimal that is read back to a billionth of it, never "nan" nor an exponent of our own making."""
    return f"{value:.9g}"
