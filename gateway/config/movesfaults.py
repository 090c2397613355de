"""What a site file says wrong of safe places, and which axes still need one before anything is pushed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from drivers.errors import words
from gateway.config.faults import Fault
from gateway.config.keyfaults import broken
from gateway.config.places import held
from gateway.config.reaching import by_files
from gateway.config.rules import bounds, is_pair, within

_SAFE = ("moves", "safe")
ANY = "any"
_FEEDS = (("feed_mm", 20.0, "mm"), ("feed_deg", 5.0, "deg"))
"""Feeds below which a push would crawl from place to place, per minute: more likely a slip of the unit."""


def moves_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Places that are no range or beyond the travel, feeds of another unit, and every axis without a place."""
    written = held(tree, _SAFE)
    given = written if isinstance(written, Mapping) else {}
    axes = {axis.name: axis for axis in site.axes if isinstance(axis.name, str)}
    for name, place in given.items():
        if place == ANY and getattr(axes.get(name), "kind", None) == "linear":
            yield broken(tree, (*_SAFE, name), words("W-CFG-PLACE-ANY"), doubt=True)
        if not is_pair(place):
            continue
        if place[0] >= place[1]:
            yield broken(tree, (*_SAFE, name), words("W-CFG-TRAVEL"))
        elif name in axes:
            low, high = bounds(axes[name])
            beyond = not (within(place[0], low, high) and within(place[1], low, high))
            if beyond:
                apart = place[1] <= low or place[0] >= high
                yield broken(tree, (*_SAFE, name), words("W-CFG-OUTSIDE", low=low, high=high), doubt=not apart)
    for key, least, unit in _FEEDS:
        feed = getattr(site.moves, key, None)
        if isinstance(feed, int | float) and 0.0 < feed < least:
            yield broken(tree, ("moves", key), words("W-CFG-UNIT-SLOW", unit=unit), doubt=True)
    dresser = getattr(site.work, "dresser", None)
    known = [*axes, *([dresser] if isinstance(dresser, str) and dresser else [])]
    missing = [name for name in known if name not in given]
    for name in given:
        # An axis of the control that the file measures nothing of may well have a place: only a likely slip is told.
        if name not in known and (meant := [one for one in missing if one[:1] == name[:1].upper()]):
            missing.remove(meant[0])
            yield broken(tree, (*_SAFE, name), words("W-CFG-PLACE-MEANT", meant=meant[0]), doubt=True)
    if missing and not by_files(site):
        yield broken(tree, _SAFE, words("W-CFG-NO-PLACE", axes=", ".join(missing), first=missing[0]), doubt=True)
