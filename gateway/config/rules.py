"""Rules between keys that several sections share: ranges of an axis, names of other sections, targets."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Any

from drivers import registry
from drivers.errors import words
from drivers.local.names import guess
from drivers.message import Message, fixed
from drivers.settings import SPEED_KEYS, DriverSettings
from gateway.config.faults import Fault, Path, value_at
from gateway.config.model_faults import broken_rule

LINEAR, ROTARY = "XYZUVW", "ABC"
TURN_DEG = 360.0
NEAR = 1e-9
GEAR_MACHINE = "gear-inspector"


def bounds(axis: Any) -> tuple[float, float]:
    """Where an axis can stand: its travel, or one turn; infinite where that is not known."""
    if axis.modulo:
        travel = axis.travel if is_pair(axis.travel) else (0.0, TURN_DEG)
        return min(0.0, *travel), max(TURN_DEG, *travel)
    if not is_pair(axis.travel) or axis.travel[0] >= axis.travel[1]:
        return float("-inf"), float("inf")
    return axis.travel[0], axis.travel[1]


def is_pair(value: Any) -> bool:
    """Whether a value is [low, high] as far as its kind goes."""
    return isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(one, int | float) for one in value)


def is_within(value: Any, low: float, high: float) -> bool:
    """Whether a position lies in a range, its ends included."""
    return not isinstance(value, int | float) or low - NEAR <= value <= high + NEAR


def is_below(value: Any, other: Any) -> bool:
    """Whether both are numbers, the first less than the second."""
    return isinstance(value, int | float) and isinstance(other, int | float) and value < other


def no_such(
    tree: Mapping[str, Any], path: Path, what: str | Message, known: Iterable[str], *, by_key: bool = False
) -> Fault:
    """A name of nothing in this file, with those that there are; ``by_key`` where the key is the name."""
    names = sorted(known)
    name = path[-1] if by_key else value_at(tree, path)
    text = (", ".join(names) or words("W-CFG-NONE")) + guess(str(name), names)
    return broken_rule(tree, path, Message.of("W-CFG-NO-SUCH", what=what, known=text))


def all_named(sections: Iterable[Any]) -> bool:
    """Whether there are any, each with a name that is in order: one that is refused may be the one that is meant."""
    names = [getattr(one, "name", None) for one in sections]
    return bool(names) and all(isinstance(name, str) for name in names)


def instrument_faults(tree: Mapping[str, Any], site: Any, path: Path, name: Any) -> Iterator[Fault]:
    """A name that no instrument of the site has, or one that cannot measure an axis."""
    drivers = {one.name: one.driver for one in site.instruments if isinstance(one.name, str)}
    if not isinstance(name, str) or not name:
        return
    if name not in drivers:
        if all_named(site.instruments):
            yield no_such(tree, path, "instrument", drivers)
    elif drivers[name] in registry.known(GEAR_MACHINE):
        yield broken_rule(tree, path, words("W-CFG-GEAR-MACHINE"))


def feed_faults(
    tree: Mapping[str, Any], site: Any, axis: Any, *, instrument: object = None, place: Path = ()
) -> Iterator[Fault]:
    """A feed at which the axis' instrument loses counts, or that of a set-up: its name and ``place``."""
    measure = axis.measure
    if not isinstance(measure.feed, int | float):
        return
    linear, name = axis.kind == "linear", measure.instrument if instrument is None else instrument
    unit, feed = "mm/min" if linear else "deg/min", f"{measure.feed:g}"
    place = place or (*measure.place, "feed")
    for one in site.instruments:
        known = _counter(one) if one.name == name else None
        if known is None:
            continue
        limit = known.followed_feed_mm_min if linear else known.followed_feed_deg_min
        if limit is not None and measure.feed > limit:
            told = words("W-CFG-FRINGES", limit=fixed(limit, 0), unit=unit, feed=feed, **_who(one, known))
            yield broken_rule(tree, place, told)


def unchecked_feed(site: Any, axis: Any, instrument: str = "") -> tuple[Message, ...]:
    """That nobody knows whether the axis' instrument follows its feed; () where that was checked.

    ``instrument`` is that of a set-up with one of its own.
    """
    name, linear = instrument or axis.measure.instrument, axis.kind == "linear"
    unit, feed = "mm/min" if linear else "deg/min", f"{axis.measure.feed:g}"
    found = []
    for one in site.instruments:
        known = _counter(one) if one.name == name else None
        if known is not None and known.counts_motion:
            limit = known.followed_feed_mm_min if linear else known.followed_feed_deg_min
            told = Message.of("W-CFG-FRINGES-OPEN", unit=unit, feed=feed, **_who(one, known))
            found += [Message.of("S-TABLE-WHY", name=axis.name, why=told)] if limit is None else []
    return tuple(found)


def _counter(section: Any) -> DriverSettings | None:
    """An instrument's settings as its driver reads them; None where they are in fault."""
    spec = registry.known().get(str(section.driver))
    model = spec.load_settings() if spec is not None else None
    if model is None or not isinstance(section.settings, Mapping) or model.faults(section.settings):
        return None
    return model.read(section.settings, str(section.name))


def _who(section: Any, known: DriverSettings) -> dict[str, str]:
    """Name of an instrument, and its keys that say how fast it follows."""
    keys = [key for key in SPEED_KEYS if key in type(known).model_fields]
    return {"instrument": str(section.name), "keys": ", ".join(keys)}


def target_faults(tree: Mapping[str, Any], axis: Any, targets: Any, overrun: Any) -> Iterator[Fault]:
    """Targets beyond what the axis can reach; those that are twice there or no range."""
    if not hasattr(targets, "place"):
        return
    low, high = bounds(axis)
    given = dict(_positions(targets))
    for path, value in given.items():
        if not is_within(value, low, high):
            yield broken_rule(tree, path, words("W-CFG-OUTSIDE", low=low, high=high))
    for key in ("first", "last"):
        if targets.count and targets.first is not None and targets.first == targets.last and key == "last":
            yield broken_rule(tree, (*targets.place, key), words("W-CFG-DIFFER"))
    if isinstance(targets.positions, list):
        for number, value in enumerate(targets.positions):
            if value in targets.positions[:number]:
                yield broken_rule(tree, (*targets.place, "positions", number), words("W-CFG-AGAIN"))
        if len(targets.positions) == 1:
            yield broken_rule(tree, (*targets.place, "positions"), words("W-CFG-TWO"))
    yield from _order(tree, targets)
    yield from _overrun(tree, axis, given, overrun)


def target_positions(targets: Any) -> list[Any]:
    """About where the axis stops, rising; () where that is not known. The standard's count is taken as five."""
    if isinstance(targets.positions, list) and targets.positions:
        found = [one for one in targets.positions if isinstance(one, int | float)]
        return sorted(found)
    count = 5 if isinstance(targets.count, str) else targets.count
    if not isinstance(count, int) or count < 2 or targets.first is None or targets.last is None:
        return []
    low, high = min(targets.first, targets.last), max(targets.first, targets.last)
    return [low + (high - low) * number / (count - 1) for number in range(count)]


def _order(tree: Mapping[str, Any], targets: Any) -> Iterator[Fault]:
    """An end of the range that is left out, and positions that fall: both are read, and may not be meant."""
    missing = [key for key in ("first", "last") if targets.count and key not in value_at(tree, targets.place)]
    for key in missing:
        yield broken_rule(tree, targets.place, words("W-CFG-LEFT-OUT", key=key, value=0), doubt=True)
    if targets.count and not missing and is_below(targets.last, targets.first):
        yield broken_rule(tree, (*targets.place, "first"), words("W-CFG-RISING"), doubt=True)
    listed = targets.positions if isinstance(targets.positions, list) else []
    if any(is_below(now, before) for before, now in pairwise(listed)):
        yield broken_rule(tree, (*targets.place, "positions"), words("W-CFG-RISING"), doubt=True)


def _overrun(tree: Mapping[str, Any], axis: Any, given: Mapping[Path, Any], overrun: Any) -> Iterator[Fault]:
    """The axis turns beyond its outer targets: doubtful where that lies outside its travel.

    A doubt and no fault: who takes a table back or reads files is not kept from it by how the axis is measured.
    """
    low, high = bounds(axis)
    inside = {
        path: value for path, value in given.items() if isinstance(value, int | float) and is_within(value, low, high)
    }
    if axis.modulo or not inside or not isinstance(overrun, int | float):
        return
    for path, ends in ((min(inside, key=inside.__getitem__), -overrun), (max(inside, key=inside.__getitem__), overrun)):
        end = inside[path] + ends
        if not is_within(end, low, high):
            yield broken_rule(tree, path, words("W-CFG-OVERRUN", end=end, low=low, high=high), doubt=True)


def _positions(targets: Any) -> Iterator[tuple[Path, Any]]:
    """Every position that a targets section names."""
    if targets.count:
        yield from (((*targets.place, key), getattr(targets, key)) for key in ("first", "last"))
    if isinstance(targets.positions, list):
        yield from (((*targets.place, "positions", number), one) for number, one in enumerate(targets.positions))
    if hasattr(targets.window, "place"):
        yield from (((*targets.window.place, key), getattr(targets.window, key)) for key in ("first", "last"))
