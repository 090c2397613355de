"""Blocks that all our programs are made of: comments, motion, and loops over tables.

Motion blocks are in machine coordinates (SUPA), exact stop fine (G60 G601), feed per minute (G94). A modulo rotary axis
turns with C=ACP() in the positive and C=ACN() in the negative direction; 0 and 360 are one place.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from enum import IntEnum
from itertools import groupby
from typing import Literal

from drivers.programs import NOBODY, Origin
from drivers.sinumerik.tablefile.grammar import position_text
from drivers.types.stops import Stop

# The comments of a program: a head that says what it is and does, and a line before each section.
#
# What it moves and which R parameters it uses is read from its own blocks, so that the head cannot say otherwise.

WIDTH = 100
_UNSAID = re.compile(r"[^\x20-\x7e]")
_R_WORD = re.compile(r"\bR(\d+)\b")
_TEXT = re.compile(r'"[^"]*"')
_MOVE = re.compile(r"SUPA G1 ([A-Z]\w*)=(.+) F=([\d.]+)")
_PLACE = re.compile(r"(?:(DC|ACP|ACN|IC)\()?(-?[\d.]+)\)?")
_WRITTEN = re.compile(r"(\$[AMS][A-Z]*_[A-Z0-9_]+)(?:\[[^\]]*\])?=(?!=)")


@dataclass(frozen=True, slots=True)
class ProgramHead:
    """What only the writer of a program knows: its path, purpose, and what a person does if it stops.

    Neither run nor number: a program that was read and signed before is sent with the same head.
    """

    path: str
    purpose: str
    stops: str
    origin: Origin = NOBODY
    also: str = ""


def section_comment(title: str) -> str:
    """The line before a section."""
    return f"; ---- {title}"


def add_head(head: ProgramHead, blocks: Sequence[str], moves: Sequence[str] = ()) -> list[str]:
    """The blocks behind their head of comments; ``moves``: its moves, where the blocks take them from tables."""
    origin = head.origin
    name = head.path.rpartition("/")[2]
    whose = f"site {_shown_text(origin.site)}, machine {_shown_text(origin.machine)}"
    said = [
        f"{name}: {head.purpose}",
        f"{whose}, trueflank {_shown_text(origin.version)}",
        f"Moves: {'; '.join(_move_comments(moves or blocks)) or 'nothing'}. {head.also}".rstrip(),
        f"Writes: {', '.join(_assigned_names(blocks)) or 'no table, no datum'}.",
        f"R parameters: {', '.join(_ranges(_r_numbers(blocks))) or 'none'}.",
        f"If it stops: {head.stops}",
    ]
    return [*(line for text in said for line in _comment(text)), *blocks]


def _comment(text: str) -> list[str]:
    plain = _UNSAID.sub("?", text)
    return textwrap.wrap(plain, WIDTH, initial_indent="; ", subsequent_indent=";   ", break_on_hyphens=False)


def _shown_text(text: str) -> str:
    return text or "(not given)"


def _r_numbers(blocks: Iterable[str]) -> list[int]:
    code = (_TEXT.sub("", block.partition(";")[0]) for block in blocks)
    return sorted({int(number) for block in code for number in _R_WORD.findall(block)})


def _ranges(numbers: Sequence[int]) -> list[str]:
    """R80 to R85, R87: numbers in a row together."""
    found = []
    for _, group in groupby(enumerate(numbers), key=lambda item: item[1] - item[0]):
        row = [number for _, number in group]
        found.append(f"R{row[0]}" if len(row) == 1 else f"R{row[0]} to R{row[-1]}")
    return found


def _assigned_names(blocks: Iterable[str]) -> list[str]:
    """Names of the tables' variables and data that blocks assign to, each once."""
    found = (match[1] for block in blocks if (match := _WRITTEN.match(block)))
    return list(dict.fromkeys(found))


def _move_comments(blocks: Iterable[str]) -> list[str]:
    moves = [match.groups() for block in blocks if (match := _MOVE.fullmatch(block))]
    letters = dict.fromkeys(letter for letter, _, _ in moves)
    return [
        _letter_comment(letter, [(place, feed) for each, place, feed in moves if each == letter]) for letter in letters
    ]


def _letter_comment(letter: str, moves: list[tuple[str, str]]) -> str:
    """X between -405.0 and 5.0, F 2000.0 to 6000.0 (machine coordinates, all else stands)."""
    asked = any(_R_WORD.search(place) for place, _ in moves)
    read = [_PLACE.fullmatch(place) for place, _ in moves if not _R_WORD.search(place)]
    fixed = sorted(float(found[2]) for found in read if found and found[1] != "IC")
    spans = [f"to {fixed[0]}" if fixed[0] == fixed[-1] else f"between {fixed[0]} and {fixed[-1]}"] if fixed else []
    ways = [f"{letter} {span}" for span in spans]
    ways += ["by steps"] if any(found and found[1] == "IC" for found in read) else []
    ways += [f"{letter} to places from set-up values"] if not all(read) else []
    ways += ["to places that readings ask for"] if asked else []
    feeds = sorted({float(feed) for _, feed in moves})
    return f"{', '.join(ways)}, F {feeds[0]:g}" + (f" to {feeds[-1]:g}" if len(feeds) > 1 else "")


# Positions -> motion blocks: every stop approached from its own side, with overrun at each reversal.
#
# Blocks are in machine coordinates (SUPA), exact stop fine (G60 G601), feed per minute (G94). A modulo rotary axis
# turns with C=ACP() in the positive and C=ACN() in the negative direction; 0 and 360 are one place.

_SAME = 1e-9


def format_number(value: float) -> str:
    """A position, feed or dwell for a block: six decimals at most."""
    return position_text(Decimal(repr(round(float(value), 6))))


class Approach(IntEnum):
    """How a stop is reached: not at all, straight on, back to its own side first, or by a distance alone."""

    STAYS = 0
    STRAIGHT = 1
    LED = 2
    STEP = 3


@dataclass(frozen=True, slots=True)
class Motion:
    """How one axis is driven: its program letter, whether it turns endlessly, feed and overrun."""

    letter: str
    modulo: bool
    feed: float
    overrun: float = 0.0

    def to(self, position: float) -> str:
        """Go to a position from anywhere, a modulo axis by the shortest way."""
        place = self.place(position)
        return self.block(f"DC({place})" if self.modulo else place)

    def by(self, distance: float) -> str:
        """Go on by a distance."""
        return self.block(f"IC({format_number(distance)})")

    def led(self, lead: str, place: str, side: str) -> list[str]:
        """Go to the place that one variable holds, by way of that in another; ``side`` has the approach's sign."""
        if not self.modulo:
            return [self.block(lead), self.block(place)]
        if not self.overrun:
            return [self.block(f"DC({place})")]
        ways = [self.block(f"{word}({place})") for word in ("ACP", "ACN")]
        return [self.block(f"DC({lead})"), f"IF {side}>0", ways[0], "ELSE", ways[1], "ENDIF"]

    def block(self, word: str) -> str:
        """The move to a place as it is written: -5.0, DC(90.0), or a variable that holds it."""
        return f"SUPA G1 {self.letter}={word} F={format_number(self.feed)}"

    def place(self, position: float) -> str:
        """A place as its block names it; 0 to 360 where the axis turns endlessly."""
        return format_number(round(position, 6) % 360.0) if self.modulo else format_number(position)

    def begin(self, stop: Stop) -> str:
        """From anywhere to where the first stop is approached from."""
        return self.to(stop.target - stop.approach * self.overrun)

    def ways(self, stops: Sequence[Stop]) -> Iterator[tuple[Approach, float]]:
        """How each stop is reached from the one before, the first from where `begin` leads.

        With `Way.LED` and `Way.STEP` goes where to, or how far: a place, or a distance of an endless axis.
        """
        before: Stop | None = None
        for stop in stops:
            yield self._ahead(stop.approach * self.overrun) if before is None else self._next(before, stop)
            before = stop

    def legs(self, stops: Sequence[Stop]) -> Iterator[list[str]]:
        """The blocks that lead to each stop in turn, the first from anywhere."""
        for place, (stop, (way, lead)) in enumerate(zip(stops, self.ways(stops), strict=True)):
            first = [] if place else [self.begin(stop)]
            yield first + self._leg(stop, way, lead)

    def _leg(self, stop: Stop, way: Approach, lead: float) -> list[str]:
        led = (
            [self.by(lead) if self.modulo else self.block(format_number(lead))]
            if way in (Approach.LED, Approach.STEP)
            else []
        )
        if way in (Approach.STAYS, Approach.STEP):
            return led
        if self.modulo and way is Approach.LED and self.overrun >= 360.0:
            return [*led, self.by(stop.approach * self.overrun)]
        place = self.place(stop.target)
        word = "ACP" if stop.approach > 0 else "ACN"
        return [*led, self.block(f"{word}({place})" if self.modulo else place)]

    def _ahead(self, distance: float) -> tuple[Approach, float]:
        """To a target that lies ``distance`` ahead of where the axis stands, in the sense of its approach."""
        if abs(distance) < _SAME:
            return Approach.STAYS, 0.0
        if self.modulo and abs(distance) >= 360.0:
            return Approach.STEP, distance
        return Approach.STRAIGHT, 0.0

    def _next(self, before: Stop, stop: Stop) -> tuple[Approach, float]:
        distance = stop.target - before.target
        ahead = distance * stop.approach
        if abs(distance) < _SAME and stop.approach == before.approach:
            return Approach.STAYS, 0.0
        if ahead >= self.overrun or (ahead > _SAME and stop.approach == before.approach):
            return self._ahead(distance)
        start = stop.target - stop.approach * self.overrun
        lead = start - before.target
        if abs(lead) < _SAME:
            return self._ahead(stop.target - start)
        if self.overrun < _SAME:
            return (Approach.STEP, lead) if self.modulo else (Approach.STRAIGHT, 0.0)
        return Approach.LED, lead if self.modulo else start


# Tables in a program's own variables, and one loop over them in place of a block for each row.
#
# Printed (Job Planning): DEF of an array, and NAME[n]=SET(value, value, ...), which fills it from element n on. A
# control that does not take these words (its self-test tells) gets the same moves and stops written out one by one.

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
class ProgramArray:
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


def declare_arrays(arrays: Iterable[ProgramArray]) -> list[str]:
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


def arrays_fit(arrays: Iterable[ProgramArray]) -> bool:
    """Whether a control is asked for no more memory than `MOST_BYTES`."""
    largest: dict[str, int] = {}
    for one in arrays:
        largest[one.name] = max(largest.get(one.name, 0), len(one.values) * _BYTES[one.kind])
    return sum(largest.values()) <= MOST_BYTES


@dataclass(frozen=True, slots=True)
class _TargetRow:
    """A row of the table of targets."""

    target: float
    label: int
    switch: int


@dataclass(slots=True)
class _PassRow:
    """Some targets in a row: from which place, how many, from which side, how the first is reached."""

    first: int
    count: int
    side: int
    repetition: int
    way: Approach
    lead: float

    def goes_on(self, stop: Stop, row: int, visited: Sequence[int]) -> bool:
        """Whether a stop is the next of this pass: nothing but rows that are done with is passed over."""
        if self.way not in (Approach.STRAIGHT, Approach.LED) or (stop.approach, stop.repetition) != (
            self.side,
            self.repetition,
        ):
            return False
        between = range(self.first + self.count * self.side, row, self.side)
        ahead = (row - self.first) * self.side >= self.count
        return ahead and all(visited[passed] <= stop.repetition for passed in between)


@dataclass(frozen=True, slots=True)
class StopTables:
    """All stops of a plan as tables; ``head`` goes before the loop, ``moves`` and the words of a stop into it."""

    arrays: tuple[ProgramArray, ...]
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
        out = [
            section_comment("targets, and the passes over them"),
            *(block for one in self.arrays for block in one.filled),
        ]
        out += [*self.head, f"FOR {PASS}=0 TO {self.count - 1}", *self.lead]
        out += [f"FOR {STEP}=1 TO {_COUNT}[{PASS}]", f"{AT}={_FROM}[{PASS}]+({STEP}-1)*{_SIDE}[{PASS}]"]
        stop = [*self.moves, *inner]
        if self.skips:
            stop = [f"IF {_REPETITION}[{PASS}]<{_VISITED}[{AT}]", *stop, "ENDIF"]
        return [*out, *stop, "ENDFOR", "ENDFOR"]


def tabulate_stops(stops: Sequence[Stop], motion: Motion) -> StopTables | None:
    """The tables of a plan's stops, in their very order; None where a loop cannot do the same moves."""
    if not stops or (motion.modulo and motion.overrun >= 360.0):
        return None
    keys = [_TargetRow(stop.target, stop.label, -1 if stop.switch is None else int(stop.switch)) for stop in stops]
    places = sorted(dict.fromkeys(keys), key=lambda one: (one.target, one.label, one.switch))
    index = {place: row for row, place in enumerate(places)}
    rows = [index[key] for key in keys]
    visited = _last_repetitions(stops, rows)
    passes = list(_passes(stops, rows, visited, motion))
    head = motion.begin(stops[0])
    if passes[0].way is Approach.STRAIGHT:  # as every other pass: from where `read_head` leads, or to there
        passes[0].way = Approach.LED
        passes[0].lead = 0.0 if motion.modulo else stops[0].target - stops[0].approach * motion.overrun
        head = head if motion.modulo else ""
    turned = [motion.place(one.target) for one in places]
    arrays = [*_target_columns(places, turned, visited), *_pass_columns(passes)]
    switched = {one.switch for one in places}
    goes = f"{_TURN if turned != [format_number(one.target) for one in places] else _TARGET}[{AT}]"
    return StopTables(
        tuple(arrays),
        head=(head,) if head else (),
        moves=_move_blocks(motion, goes, {one.way for one in passes}),
        lead=_lead_in(motion, {one.way for one in passes}),
        label=AT if all(row == one.label for row, one in enumerate(places)) else f"{_LABEL}[{AT}]",
        switch=f"{_SWITCH}[{AT}]" if switched != {-1} else "",
        switched_always=-1 not in switched,
        skips=len(set(visited)) > 1,
        count=len(passes),
    )


def _last_repetitions(stops: Sequence[Stop], rows: Sequence[int]) -> list[int]:
    """Before which repetition each row's last visit is: rows of check stops are left out of later passes."""
    found: dict[int, int] = {}
    for stop, row in zip(stops, rows, strict=True):
        found[row] = max(found.get(row, 0), stop.repetition + 1)
    return [found[row] for row in range(len(found))]


def _passes(stops: Sequence[Stop], rows: Sequence[int], visited: Sequence[int], motion: Motion) -> Iterator[_PassRow]:
    """Stops that follow one another in the table, straight on from one side and in one repetition, are one pass."""
    now: _PassRow | None = None
    for stop, row, (way, lead) in zip(stops, rows, motion.ways(stops), strict=True):
        if now is not None and way is Approach.STRAIGHT and now.goes_on(stop, row, visited):
            now.count = abs(row - now.first) + 1
            continue
        if now is not None:
            yield now
        now = _PassRow(row, 1, stop.approach, stop.repetition, way, lead)
    if now is not None:
        yield now


def _target_columns(
    places: Sequence[_TargetRow], turned: Sequence[str], visited: Sequence[int]
) -> Iterator[ProgramArray]:
    targets = tuple(format_number(one.target) for one in places)
    yield ProgramArray(_TARGET, "REAL", targets)
    if tuple(turned) != targets:
        yield ProgramArray(_TURN, "REAL", tuple(turned))
    if any(row != one.label for row, one in enumerate(places)):
        yield ProgramArray(_LABEL, "INT", tuple(str(one.label) for one in places))
    if any(one.switch >= 0 for one in places):
        yield ProgramArray(_SWITCH, "INT", tuple(str(one.switch) for one in places))
    if len(set(visited)) > 1:
        yield ProgramArray(_VISITED, "INT", tuple(str(one) for one in visited))


def _pass_columns(passes: Sequence[_PassRow]) -> Iterator[ProgramArray]:
    yield ProgramArray(_FROM, "INT", tuple(str(one.first) for one in passes))
    yield ProgramArray(_COUNT, "INT", tuple(str(one.count) for one in passes))
    yield ProgramArray(_SIDE, "INT", tuple(str(one.side) for one in passes))
    yield ProgramArray(_REPETITION, "INT", tuple(str(one.repetition) for one in passes))
    ways = {one.way for one in passes}
    if len(ways) > 1:
        yield ProgramArray(_WAY, "INT", tuple(str(int(one.way)) for one in passes))
    if ways & {Approach.LED, Approach.STEP}:
        yield ProgramArray(_LEAD, "REAL", tuple(format_number(one.lead) for one in passes))


def _lead_in(motion: Motion, ways: set[Approach]) -> tuple[str, ...]:
    """What comes before a pass: back beyond its first target, so that this is reached from its own side."""
    if not ways & {Approach.LED, Approach.STEP}:
        return ()
    block = motion.block(f"IC({_LEAD}[{PASS}])" if motion.modulo else f"{_LEAD}[{PASS}]")
    always = not ways & {Approach.STAYS, Approach.STRAIGHT}
    return (block,) if always else (f"IF {_WAY}[{PASS}]>={int(Approach.LED)}", block, "ENDIF")


def _move_blocks(motion: Motion, place: str, ways: set[Approach]) -> tuple[str, ...]:
    """To the target, where it is not reached already."""
    if not ways & {Approach.STRAIGHT, Approach.LED}:
        return ()
    blocks: tuple[str, ...] = (motion.block(place),)
    if motion.modulo:
        up, down = (motion.block(f"{word}({place})") for word in ("ACP", "ACN"))
        blocks = (f"IF {_SIDE}[{PASS}]>0", up, "ELSE", down, "ENDIF")
    if not ways & {Approach.STAYS, Approach.STEP}:
        return blocks
    goes = (int(Approach.STRAIGHT), int(Approach.LED))
    return f"IF ({_WAY}[{PASS}]=={goes[0]}) OR ({_WAY}[{PASS}]=={goes[1]})", *blocks, "ENDIF"
