"""Tables in a program's own variables, and one loop over them in place of a block for each row.

Printed (Job Planning): DEF of an array, and NAME[n]=SET(value, value, ...), which fills it from element n on. A control
that does not take these words (its self-test tells) gets the same moves and stops written out one by one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from drivers.sinumerik.ncprogram.heads import section
from drivers.sinumerik.ncprogram.motion import Motion, Way, number
from drivers.types.stops import Stop

MOST_BYTES = 24_000
"""Of all arrays of one program. Local variables have memory of their own (MD28040), as recalled 50 kB by default."""
_LONGEST = 160
_BYTES = {"INT": 4, "REAL": 8}
PASS, STEP, AT = "UPASS", "USTEP", "UAT"
COUNTERS = f"{PASS}, {STEP}, {AT}"
_TARGET, _TURN, _LABEL, _SWITCH = "UTARGET", "UTURN", "ULABEL", "USWITCH"
_VISITED = "UROUNDS"
_FROM, _COUNT, _SIDE, _REPETITION, _WAY, _LEAD = "UFROM", "UCOUNT", "USIDE", "UREP", "UWAY", "ULEAD"


@dataclass(frozen=True, slots=True)
class Array:
    """One table of a program: values as it writes them."""

    name: str
    kind: Literal["INT", "REAL"]
    values: tuple[str, ...]

    @property
    def filled(self) -> list[str]:
        """The blocks that fill it, none much longer than a line of a screen."""
        out, begin = [], 0
        while begin < len(self.values):
            end, text = begin + 1, self.values[begin]
            while end < len(self.values) and len(text) + len(self.values[end]) < _LONGEST:
                text, end = f"{text},{self.values[end]}", end + 1
            out.append(f"{self.name}[{begin}]=SET({text})")
            begin = end
        return out


def declared(arrays: Iterable[Array]) -> list[str]:
    """A DEF for each kind; an array that is filled several times is as large as it ever must be."""
    sizes: dict[str, dict[str, int]] = {"INT": {}, "REAL": {}}
    for one in arrays:
        known = sizes[one.kind]
        known[one.name] = max(known.get(one.name, 0), len(one.values))
    return [
        f"DEF {kind} {', '.join(f'{name}[{size}]' for name, size in known.items())}"
        for kind, known in sizes.items()
        if known
    ]


def fits(arrays: Iterable[Array]) -> bool:
    """Whether a control is asked for no more memory than `MOST_BYTES`."""
    largest: dict[str, int] = {}
    for one in arrays:
        largest[one.name] = max(largest.get(one.name, 0), len(one.values) * _BYTES[one.kind])
    return sum(largest.values()) <= MOST_BYTES


@dataclass(frozen=True, slots=True)
class _Place:
    """A row of the table of targets."""

    target: float
    label: int
    switch: int


@dataclass(slots=True)
class _Pass:
    """Some targets in a row: from which place, how many, from which side, how the first is reached."""

    first: int
    count: int
    side: int
    repetition: int
    way: Way
    lead: float

    def goes_on(self, stop: Stop, row: int, visited: Sequence[int]) -> bool:
        """Whether a stop is the next of this pass: nothing but rows that are done with is passed over."""
        if self.way not in (Way.STRAIGHT, Way.LED) or (stop.approach, stop.repetition) != (self.side, self.repetition):
            return False
        between = range(self.first + self.count * self.side, row, self.side)
        ahead = (row - self.first) * self.side >= self.count
        return ahead and all(visited[passed] <= stop.repetition for passed in between)


@dataclass(frozen=True, slots=True)
class Visits:
    """All stops of a plan as tables; ``head`` goes before the loop, ``moves`` and the words of a stop into it."""

    arrays: tuple[Array, ...]
    head: tuple[str, ...]
    moves: tuple[str, ...]
    lead: tuple[str, ...]
    label: str
    switch: str
    """The place of the switch's state in the tables; "" where no stop switches."""
    switched_always: bool
    skips: bool
    count: int

    @property
    def repetition(self) -> str:
        """The repetition of the stop under way, as an expression."""
        return f"{_REPETITION}[{PASS}]"

    @property
    def side(self) -> str:
        """The sign of its approach."""
        return f"{_SIDE}[{PASS}]"

    @property
    def target(self) -> str:
        """Its target as the plan has it."""
        return f"{_TARGET}[{AT}]"

    def around(self, inner: Iterable[str]) -> list[str]:
        """The loop: every pass, every stop of it, with the blocks that belong to a stop behind its moves."""
        out = [section("targets, and the passes over them"), *(block for one in self.arrays for block in one.filled)]
        out += [*self.head, f"FOR {PASS}=0 TO {self.count - 1}", *self.lead]
        out += [f"FOR {STEP}=1 TO {_COUNT}[{PASS}]", f"{AT}={_FROM}[{PASS}]+({STEP}-1)*{_SIDE}[{PASS}]"]
        stop = [*self.moves, *inner]
        if self.skips:
            stop = [f"IF {_REPETITION}[{PASS}]<{_VISITED}[{AT}]", *stop, "ENDIF"]
        return [*out, *stop, "ENDFOR", "ENDFOR"]


def visits(stops: Sequence[Stop], motion: Motion) -> Visits | None:
    """The tables of a plan's stops, in their very order; None where a loop cannot do the same moves."""
    if not stops or (motion.modulo and motion.overrun >= 360.0):
        return None
    keys = [_Place(stop.target, stop.label, -1 if stop.switch is None else int(stop.switch)) for stop in stops]
    places = sorted(dict.fromkeys(keys), key=lambda one: (one.target, one.label, one.switch))
    index = {place: row for row, place in enumerate(places)}
    rows = [index[key] for key in keys]
    visited = _visited(stops, rows)
    passes = list(_passes(stops, rows, visited, motion))
    head = motion.begin(stops[0])
    if passes[0].way is Way.STRAIGHT:  # as every other pass: from where `head` leads, or to there
        passes[0].way = Way.LED
        passes[0].lead = 0.0 if motion.modulo else stops[0].target - stops[0].approach * motion.overrun
        head = head if motion.modulo else ""
    turned = [motion.place(one.target) for one in places]
    arrays = [*_rows(places, turned, visited), *_columns(passes)]
    switched = {one.switch for one in places}
    goes = f"{_TURN if turned != [number(one.target) for one in places] else _TARGET}[{AT}]"
    return Visits(
        tuple(arrays),
        head=(head,) if head else (),
        moves=_moves(motion, goes, {one.way for one in passes}),
        lead=_led(motion, {one.way for one in passes}),
        label=AT if all(row == one.label for row, one in enumerate(places)) else f"{_LABEL}[{AT}]",
        switch=f"{_SWITCH}[{AT}]" if switched != {-1} else "",
        switched_always=-1 not in switched,
        skips=len(set(visited)) > 1,
        count=len(passes),
    )


def _visited(stops: Sequence[Stop], rows: Sequence[int]) -> list[int]:
    """Before which repetition each row's last visit is: rows of check stops are left out of later passes."""
    found: dict[int, int] = {}
    for stop, row in zip(stops, rows, strict=True):
        found[row] = max(found.get(row, 0), stop.repetition + 1)
    return [found[row] for row in range(len(found))]


def _passes(stops: Sequence[Stop], rows: Sequence[int], visited: Sequence[int], motion: Motion) -> Iterator[_Pass]:
    """Stops that follow one another in the table, straight on from one side and in one repetition, are one pass."""
    now: _Pass | None = None
    for stop, row, (way, lead) in zip(stops, rows, motion.ways(stops), strict=True):
        if now is not None and way is Way.STRAIGHT and now.goes_on(stop, row, visited):
            now.count = abs(row - now.first) + 1
            continue
        if now is not None:
            yield now
        now = _Pass(row, 1, stop.approach, stop.repetition, way, lead)
    if now is not None:
        yield now


def _rows(places: Sequence[_Place], turned: Sequence[str], visited: Sequence[int]) -> Iterator[Array]:
    targets = tuple(number(one.target) for one in places)
    yield Array(_TARGET, "REAL", targets)
    if tuple(turned) != targets:
        yield Array(_TURN, "REAL", tuple(turned))
    if any(row != one.label for row, one in enumerate(places)):
        yield Array(_LABEL, "INT", tuple(str(one.label) for one in places))
    if any(one.switch >= 0 for one in places):
        yield Array(_SWITCH, "INT", tuple(str(one.switch) for one in places))
    if len(set(visited)) > 1:
        yield Array(_VISITED, "INT", tuple(str(one) for one in visited))


def _columns(passes: Sequence[_Pass]) -> Iterator[Array]:
    yield Array(_FROM, "INT", tuple(str(one.first) for one in passes))
    yield Array(_COUNT, "INT", tuple(str(one.count) for one in passes))
    yield Array(_SIDE, "INT", tuple(str(one.side) for one in passes))
    yield Array(_REPETITION, "INT", tuple(str(one.repetition) for one in passes))
    ways = {one.way for one in passes}
    if len(ways) > 1:
        yield Array(_WAY, "INT", tuple(str(int(one.way)) for one in passes))
    if ways & {Way.LED, Way.STEP}:
        yield Array(_LEAD, "REAL", tuple(number(one.lead) for one in passes))


def _led(motion: Motion, ways: set[Way]) -> tuple[str, ...]:
    """What comes before a pass: back beyond its first target, so that this is reached from its own side."""
    if not ways & {Way.LED, Way.STEP}:
        return ()
    block = motion.block(f"IC({_LEAD}[{PASS}])" if motion.modulo else f"{_LEAD}[{PASS}]")
    always = not ways & {Way.STAYS, Way.STRAIGHT}
    return (block,) if always else (f"IF {_WAY}[{PASS}]>={int(Way.LED)}", block, "ENDIF")


def _moves(motion: Motion, place: str, ways: set[Way]) -> tuple[str, ...]:
    """To the target, where it is not reached already."""
    if not ways & {Way.STRAIGHT, Way.LED}:
        return ()
    blocks: tuple[str, ...] = (motion.block(place),)
    if motion.modulo:
        up, down = (motion.block(f"{word}({place})") for word in ("ACP", "ACN"))
        blocks = (f"IF {_SIDE}[{PASS}]>0", up, "ELSE", down, "ENDIF")
    if not ways & {Way.STAYS, Way.STEP}:
        return blocks
    goes = (int(Way.STRAIGHT), int(Way.LED))
    return f"IF ({_WAY}[{PASS}]=={goes[0]}) OR ({_WAY}[{PASS}]=={goes[1]})", *blocks, "ENDIF"
