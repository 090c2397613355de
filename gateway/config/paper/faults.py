"""What the register of equipment and the tolerances say wrong of axes, instruments, standards and figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from drivers.errors import words
from gateway.config.faults import Fault
from gateway.config.keyfaults import broken
from gateway.config.places import held
from gateway.config.rules import no_such
from gateway.errors import ModelError
from gateway.evaluate.standards.conformity import FIGURES
from gateway.evaluate.standards.registry import standard

LEAST_LIMIT, MOST_LIMIT = 0.05, 1000.0
OF_CLASS = ("module_mm", "diameter_mm", "width_mm")


def paper_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Names of nothing, standards that nobody knows, figures that a standard has not, dates in the wrong order."""
    instruments = [one.name for one in site.instruments if isinstance(one.name, str)]
    before: dict[tuple[str, str], int] = {}
    for number, one in enumerate(site.equipment, start=1):
        first = before.setdefault((str(one.name), str(one.serial)), number)
        if first != number and isinstance(one.name, str):
            yield broken(tree, (*one.place, "name"), words("W-CFG-SAME-EQUIPMENT", number=first), doubt=True)
        if isinstance(one.instrument, str) and one.instrument and one.instrument not in instruments:
            yield no_such(tree, (*one.place, "instrument"), "instrument", instruments)
        if one.calibrated and one.due and str(one.due) <= str(one.calibrated):
            yield broken(tree, (*one.place, "due"), words("W-CFG-DUE", calibrated=one.calibrated))
    axes, limits = [axis.name for axis in site.axes if isinstance(axis.name, str)], set[tuple[str, str, str]]()
    for one in site.tolerances:
        if isinstance(one.axis, str) and one.axis not in axes:
            yield no_such(tree, (*one.place, "axis"), "axis", axes)
        yield from _figures(tree, one)
        yield from _limits(tree, one, limits)
    yield from _gear(tree, site.gear_tolerance)
    yield from _sides(tree, site.machine)


def _sides(tree: Mapping[str, Any], machine: Any) -> Iterator[Fault]:
    """An axis carries the work or the tool, once."""
    seen: list[Any] = []
    for key in ("work_side", "tool_side"):
        for number, letter in enumerate(getattr(machine, key, None) or ()):
            if letter in seen:
                yield broken(tree, ("machine", key, number), words("W-CFG-SIDE-TWICE"))
            seen.append(letter)


def _limits(tree: Mapping[str, Any], one: Any, before: set[tuple[str, str, str]]) -> Iterator[Fault]:
    """No limit at all, one that no machine keeps, or the same figure of one axis twice."""
    if not isinstance(one.limits, Mapping):
        return
    if not one.limits:
        yield broken(tree, (*one.place, "limits"), words("W-CFG-LIMITS-NONE"))
    for name, limit in one.limits.items():
        path, key = (*one.place, "limits", name), (str(one.axis), str(one.standard), name)
        if isinstance(limit, int | float) and 0 < limit < LEAST_LIMIT:
            yield broken(tree, path, words("W-CFG-UNIT-LIMIT"), doubt=True)
        if isinstance(limit, int | float) and limit > MOST_LIMIT:
            yield broken(tree, path, words("W-CFG-UNIT-LIMIT-MUCH"), doubt=True)
        if key in before:
            yield broken(tree, path, words("W-CFG-LIMIT-TWICE"))
        before.add(key)


def _figures(tree: Mapping[str, Any], one: Any) -> Iterator[Fault]:
    if not isinstance(one.standard, str):
        return
    try:
        known = standard(one.standard).parameters
    except ModelError as error:
        yield broken(tree, (*one.place, "standard"), words("W-CFG-STANDARD", known=error.fields["known"]))
        return
    for name in one.limits if isinstance(one.limits, Mapping) else ():
        if name not in known:
            yield no_such(tree, (*one.place, "limits", name), "figure", known, by_key=True)


def _gear(tree: Mapping[str, Any], one: Any) -> Iterator[Fault]:
    if not hasattr(one, "place"):
        return
    for name, limit in one.limits.items() if isinstance(one.limits, Mapping) else ():
        if name not in FIGURES:
            yield no_such(tree, (*one.place, "limits", name), "figure", FIGURES, by_key=True)
        elif isinstance(limit, int | float) and 0 < limit < LEAST_LIMIT:
            yield broken(tree, (*one.place, "limits", name), words("W-CFG-UNIT-LIMIT"), doubt=True)
    missing = [key for key in OF_CLASS if getattr(one, key) is None]
    if one.grade is not None and missing:
        yield broken(tree, (*one.place, "grade"), words("W-CFG-CLASS", missing=", ".join(missing)))
    if "grade" not in held(tree, one.place) and one.grade is None and not one.limits:
        yield broken(tree, one.place, words("W-CFG-NO-LIMIT"))
