"""The corrected copy: every commanded position carries its correction, long moves split where that bends.

A control moves each block's axes in proportion. The correction is a function of the commanded positions of all axes,
so along a block it bends. A block is halved until at seven places between the ends the correction differs from a
straight line by the chord tolerance at most; an arc is split until its chords leave it by no more. No piece is longer
than the caller's `longest`, so no knot of a table is stepped over. What a rapid move passes is not cut: its end alone
is corrected.

Sign: what is added to a command is q = -d, d the deviation that a compensation table would hold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import acos, ceil, hypot

import numpy as np

from drivers.message import digits, fixed
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import deviation_scale
from gateway.errors import ModelError
from gateway.shadow.reading import ProgramAxis, ProgramBlock, ProgramMove, plain_number

Correction = Callable[[Mapping[str, float]], Mapping[str, float]]
DEEPEST, INSIDE = 14, 7
DIGITS = 6  # decimals of mm and deg
LAST = ("G9", "M0", "M1", "M2", "M02", "M30", "M17", "RET")
SHORT_TURN, TURN = 179.0, 360.0
BARELY = 1e-9


@dataclass(frozen=True, slots=True)
class CopySettings:
    """Tolerances and limits of a copy: of a chord, and of the correction itself, in mm and deg.

    ``longest`` is the longest piece by axis letter, mm or deg.
    """

    chord_mm: float = 1e-4
    chord_deg: float = 1e-5
    most_mm: float = 0.2
    most_deg: float = 0.05
    longest: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class CopiedPoint:
    """One written position: its line in the original, the positions told there, and what was added, by letter."""

    file: str
    line: int
    cuts: bool
    positions: Mapping[str, float]
    added: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class ProgramCopy:
    """The text of a corrected program and every position it goes to.

    ``uncorrected`` are lines of rapid moves before all places were known that the correction depends on.
    """

    text: str
    points: tuple[CopiedPoint, ...]
    blocks: int
    uncorrected: tuple[int, ...] = ()

    def largest(self) -> dict[str, float]:
        """The largest correction by axis letter, mm or deg."""
        found: dict[str, float] = {}
        for point in self.points:
            for letter, value in point.added.items():
                if abs(value) >= abs(found.get(letter, 0.0)):
                    found[letter] = value
        return found


class TableCorrection:
    """What tables would add, without those that act: a function of commanded positions by letter.

    ``wanted`` and ``acting`` are tables by the control's axis names, ``letters`` the letter of each.
    """

    def __init__(
        self,
        wanted: Sequence[CompensationTable],
        acting: Sequence[CompensationTable] = (),
        *,
        letters: Mapping[str, str],
    ) -> None:
        """Raises ModelError (E-SHADOW-TABLE) for tables that a commanded position cannot carry."""
        for one in (*wanted, *acting):
            if one.kind == "reversal" or one.direction or one.reverse or one.multiply_by:
                raise ModelError("E-SHADOW-TABLE", "shadow", table=one.called)
        self._terms = [(one, -1.0) for one in wanted] + [(one, 1.0) for one in acting]
        self._letters = letters

    @property
    def inputs(self) -> frozenset[str]:
        """Letters of the axes that it depends on."""
        return frozenset(self._letters[one.input_axis] for one, _ in self._terms)

    @property
    def longest(self) -> dict[str, float]:
        """Half a step of the finest table over each axis: no knot is stepped over."""
        found: dict[str, float] = {}
        for one, _ in self._terms:
            letter = self._letters[one.input_axis]
            step = float(np.min(np.diff(one.positions))) if one.positions.size > 1 else float("inf")
            found[letter] = min(0.5 * step, found.get(letter, float("inf")))
        return found

    def __call__(self, at: Mapping[str, float]) -> dict[str, float]:
        """What is added by output letter, mm or deg."""
        found: dict[str, float] = {}
        for one, sign in self._terms:
            value = float(one.at(np.asarray(at[self._letters[one.input_axis]])))
            letter = self._letters[one.output_axis]
            found[letter] = found.get(letter, 0.0) + sign * value / deviation_scale(one.output_unit)
        return found


class FieldCorrection:
    """A correction known on a grid of stroke and index, straight between: for what no table can hold, X(Z, C).

    ``values`` by output letter are (Z, C) in mm or deg; the index is endless, its grid equal over a whole turn.
    """

    def __init__(
        self, stroke: str, places: FloatArray, index: str, turn_deg: FloatArray, values: Mapping[str, FloatArray]
    ) -> None:
        self._stroke, self._index = stroke, index
        self._places, self._turn, self._values = places, turn_deg, values

    @property
    def inputs(self) -> frozenset[str]:
        """Letters of the axes that it depends on."""
        return frozenset((self._stroke, self._index))

    @property
    def longest(self) -> dict[str, float]:
        """One step of the grid."""
        return {
            self._stroke: float(self._places[1] - self._places[0]),
            self._index: float(self._turn[1] - self._turn[0]),
        }

    def __call__(self, at: Mapping[str, float]) -> dict[str, float]:
        """What is added by output letter; beyond the ends of the stroke that at its end."""
        z = float(np.clip(at[self._stroke], self._places[0], self._places[-1]))
        row = min(int(np.searchsorted(self._places, z, side="right")) - 1, self._places.size - 2)
        share = (z - self._places[row]) / (self._places[row + 1] - self._places[row])
        step = float(self._turn[1] - self._turn[0])
        turned = ((at[self._index] - self._turn[0]) % TURN) / step
        column, along = int(turned), turned - int(turned)
        n = self._turn.size
        found = {}
        for letter, grid in self._values.items():
            low, high = grid[row], grid[row + 1]
            line = (1.0 - share) * low + share * high
            found[letter] = float((1.0 - along) * line[column % n] + along * line[(column + 1) % n])
        return found


def write_copy(
    blocks: Sequence[ProgramBlock],
    axes: Sequence[ProgramAxis],
    correction: TableCorrection | FieldCorrection,
    settings: CopySettings | None = None,
    *,
    title: str = "corrected copy",
) -> ProgramCopy:
    """The copy of a program that `gateway.shadow.reading` has read, and all positions it goes to.

    Raises ModelError with file and line: E-SHADOW-START (a cut before all places are known), E-SHADOW-LIMIT,
    E-SHADOW-TRAVEL, E-SHADOW-FEED, E-SHADOW-ACCELERATION, E-SHADOW-AXIS (no such axis in the program).
    """
    wanted = settings or CopySettings(longest=correction.longest)
    writer = _Writer({axis.letter: axis for axis in axes}, correction, wanted)
    missing = [letter for letter in correction.inputs if letter not in writer.axes]
    if missing:
        raise ModelError("E-SHADOW-AXIS", title, axes=", ".join(sorted(missing)))
    lines = [f"; {title}: commanded positions carry the correction, tables are left as they are", "G90"]
    for block in blocks:
        lines += writer.block(block)
    return ProgramCopy("\n".join(lines) + "\n", tuple(writer.points), len(blocks), tuple(writer.uncorrected))


class _Writer:
    """Writes block after block; ``_written`` are the commanded positions of the copy so far."""

    def __init__(
        self, axes: Mapping[str, ProgramAxis], correction: TableCorrection | FieldCorrection, settings: CopySettings
    ) -> None:
        self.axes = axes
        self.points: list[CopiedPoint] = []
        self.uncorrected: list[int] = []
        self._correction, self._settings = correction, settings
        self._written: dict[str, float] = {}
        self._feed: float | None = None

    def block(self, block: ProgramBlock) -> list[str]:
        """The lines of one block."""
        move = block.move
        remark = f" {block.remark}" if block.remark else ""
        if move is None:
            kept = " ".join(block.kept)
            return [f"{kept}{remark}".strip()] if kept or remark else [""] if not block.text.strip() else []
        shares = self._shares(move, block)
        self._check_motion(move, block, shares)
        first = [one for one in block.kept if one not in LAST]
        last = [one for one in block.kept if one in LAST]
        found = []
        for number, share in enumerate(shares):
            words = [*(first if number == 0 else ()), "G0" if move.kind == "rapid" else "G1"]
            words += ["SUPA"] if block.in_machine else []
            words += self._words(move, block, share)
            if move.feed is not None and move.feed != self._feed:
                words.append(f"F{_number(move.feed)}")
                self._feed = move.feed
            words += last if number == len(shares) - 1 else []
            found.append(" ".join(words) + (remark if number == 0 else ""))
        return found

    def _added(self, at: Mapping[str, float], block: ProgramBlock) -> dict[str, float] | None:
        """The correction, checked; None where it depends on places that nobody has told yet."""
        if not self._correction.inputs <= at.keys():
            if block.move is not None and block.move.kind == "rapid":
                return None
            axis = ", ".join(sorted(self._correction.inputs - at.keys()))
            raise ModelError("E-SHADOW-START", _place(block), axis=axis)
        added = self._correction(at)
        unknown = sorted(added.keys() - at.keys())
        if unknown and block.move is not None and block.move.kind != "rapid":
            raise ModelError("E-SHADOW-START", _place(block), axis=", ".join(unknown))
        found = {letter: value for letter, value in added.items() if letter in at}
        for letter, value in found.items():
            most = self._settings.most_deg if self.axes[letter].rotary else self._settings.most_mm
            if not abs(value) <= most:
                raise ModelError(
                    "E-SHADOW-LIMIT",
                    _place(block),
                    axis=letter,
                    value=fixed(value, 6, signed=True),
                    limit=digits(most, 6),
                )
        return found

    def _shares(self, move: ProgramMove, block: ProgramBlock) -> list[float]:
        """Ends of the pieces, as shares of the way."""
        if move.kind == "rapid":
            return [1.0]
        unknown = sorted(self._correction.inputs - move.start.keys())
        if unknown:  # where the cut begins
            raise ModelError("E-SHADOW-START", _place(block), axis=", ".join(unknown))
        count = 1
        for letter, step in self._settings.longest.items():
            way = abs(move.end.get(letter, 0.0) - move.start.get(letter, move.end.get(letter, 0.0)))
            if move.arc is not None and letter in move.plane:
                way = move.length(self.axes)
            count = max(count, ceil(way / step - BARELY))
        if move.arc is not None:
            centre, turn = move.arc
            a, b = move.plane
            radius = hypot(move.start[a] - centre[a], move.start[b] - centre[b])
            widest = 2.0 * acos(max(1.0 - self._settings.chord_mm / radius, -1.0))
            count = max(count, ceil(abs(turn) / widest))
        edges = np.linspace(0.0, 1.0, count + 1).tolist()
        found: list[float] = []
        for low, high in pairwise(edges):
            self._halve(move, block, (low, high), found, 0)
        return found

    def _halve(
        self, move: ProgramMove, block: ProgramBlock, part: tuple[float, float], found: list[float], depth: int
    ) -> None:
        low, high = part
        ends = [self._added(move.at(share), block) or {} for share in part]
        straight = True
        for n in range(1, INSIDE + 1):
            share = n / (INSIDE + 1)
            real = self._added(move.at(low + share * (high - low)), block) or {}
            for letter, value in real.items():
                line = (1.0 - share) * ends[0].get(letter, 0.0) + share * ends[1].get(letter, 0.0)
                most = self._settings.chord_deg if self.axes[letter].rotary else self._settings.chord_mm
                straight = straight and abs(value - line) <= most
        if straight or depth >= DEEPEST:
            found.append(high)
            return
        middle = 0.5 * (low + high)
        self._halve(move, block, (low, middle), found, depth + 1)
        self._halve(move, block, (middle, high), found, depth + 1)

    def _words(self, move: ProgramMove, block: ProgramBlock, share: float) -> list[str]:
        """Axis words of one position: what the block names, and what its correction has moved."""
        at = move.at(share)
        added = self._added(at, block)
        if added is None:
            self.uncorrected.append(block.line)
        words = []
        for letter, place in at.items():
            target = round(place + (added or {}).get(letter, 0.0), DIGITS)
            before = self._written.get(letter)
            if letter not in block.named and before is not None and abs(target - before) < 10.0**-DIGITS:
                continue
            axis = self.axes[letter]
            if axis.travel is not None and not axis.modulo and not axis.travel[0] <= target <= axis.travel[1]:
                low, high = axis.travel
                raise ModelError(
                    "E-SHADOW-TRAVEL",
                    _place(block),
                    axis=letter,
                    value=fixed(target, 6),
                    low=digits(low, 6),
                    high=digits(high, 6),
                )
            told = target - (0.0 if block.in_machine else block.shifts.get(letter, 0.0))
            words.append(self._word(axis, told, target, before))
            self._written[letter] = target
        self.points.append(
            CopiedPoint(block.file, block.line, move.kind != "rapid", positions=at, added=dict(added or {}))
        )
        return words

    def _word(self, axis: ProgramAxis, told: float, target: float, before: float | None) -> str:
        if not axis.modulo:
            return f"{axis.letter}{_number(told)}"
        away = 0.0 if before is None else target - before
        if abs(away) >= TURN:
            return f"{axis.letter}=IC({_number(away)})"
        mode = "DC" if abs(away) <= SHORT_TURN else "ACP" if away > 0.0 else "ACN"
        return f"{axis.letter}={mode}({_number(round(told % TURN, DIGITS) % TURN)})"

    def _check_motion(self, move: ProgramMove, block: ProgramBlock, shares: Sequence[float]) -> None:
        """Speed and acceleration of every axis in the copy against what the axis can do."""
        length = move.length(self.axes)
        if move.feed is None or length <= 0.0:
            return
        seconds = 60.0 * length / move.feed
        edges = [0.0, *shares]
        places = [self._commanded(move, block, share) for share in edges]
        times = [seconds * (high - low) for low, high in pairwise(edges)]
        for letter, axis in self.axes.items():
            if letter not in places[-1] or letter not in places[0]:
                continue
            speeds = [(b[letter] - a[letter]) / t for (a, b), t in zip(pairwise(places), times, strict=True)]
            plain = max(abs(self._plain_speed(move, letter, edges, times)), 0.0)
            fastest = max(abs(one) for one in speeds)
            if axis.velocity is not None and 60.0 * fastest > axis.velocity and fastest > plain + BARELY:
                value, limit = f"{60.0 * fastest:.1f}", f"{axis.velocity:g}"
                raise ModelError("E-SHADOW-FEED", _place(block), axis=letter, value=value, limit=limit)
            if axis.acceleration is None or move.arc is not None:
                continue
            most = axis.acceleration * (TURN if axis.rotary else 1000.0)
            changes = [
                2.0 * abs(b - a) / (s + t) for (a, b), (s, t) in zip(pairwise(speeds), pairwise(times), strict=True)
            ]
            if changes and max(changes) > most:
                value, limit = f"{max(changes):.1f}", f"{most:g}"
                raise ModelError("E-SHADOW-ACCELERATION", _place(block), axis=letter, value=value, limit=limit)

    def _plain_speed(self, move: ProgramMove, letter: str, edges: Sequence[float], times: Sequence[float]) -> float:
        places = [move.at(share)[letter] for share in edges]
        return max((abs(b - a) / t for (a, b), t in zip(pairwise(places), times, strict=True)), default=0.0)

    def _commanded(self, move: ProgramMove, block: ProgramBlock, share: float) -> dict[str, float]:
        at = move.at(share)
        added = self._added(at, block) or {}
        return {letter: place + added.get(letter, 0.0) for letter, place in at.items()}


def _number(value: float) -> str:
    return plain_number(round(value, DIGITS))


def _place(block: ProgramBlock) -> str:
    return f"{block.file}:{block.line}"
