"""Which table goes into which memory: the largest first, each into the smallest that holds it; pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

Rooms = Mapping[int, Mapping[int, int]]
"""Points of every free table number, by the number of the table that asks: the same memory may differ by axis."""


def seated(needs: Mapping[int, int], rooms: Rooms, ranked: Sequence[int] = ()) -> Mapping[int, int]:
    """A free number for each table that gets one; ``needs`` are points by table.

    Where there is no room for all, those come first that are ``ranked`` first; else the largest.
    """
    chosen: list[int] = []
    for one in ranked or _largest_first(needs, needs):
        if _seats(needs, rooms, [*chosen, one]) is not None:
            chosen.append(one)
    return _seats(needs, rooms, chosen) or {}


def _largest_first(needs: Mapping[int, int], which: Sequence[int] | Mapping[int, int]) -> list[int]:
    return sorted(which, key=lambda one: (-needs[one], one))


def _seats(needs: Mapping[int, int], rooms: Rooms, which: Sequence[int]) -> Mapping[int, int] | None:
    """All of these in a place of their own, or None where one has none."""
    found: dict[int, int] = {}
    for one in _largest_first(needs, which):
        free = {number: points for number, points in rooms[one].items() if number not in found.values()}
        enough = [number for number, points in free.items() if points >= needs[one]]
        if not enough:
            return None
        found[one] = min(enough, key=lambda number: (free[number], number))
    return found
