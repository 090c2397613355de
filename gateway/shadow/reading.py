"""An NC program's moves: one block after the other, with what stays in force, in machine coordinates (mm, deg).

Understood are the words that a grinding program needs to move: G0, G1, G2, G3 (I J K or CR), G4, G17..G19, G90, G91,
G71, G94, exact stop and path mode, the frames that the caller declares (G54..G57 as shifts of the linear axes, G500,
G53, G153, SUPA), TRANS and ATRANS with numbers, positions as X10, X=10, AC, IC, DC, ACP, ACN, F, S, M, T0, D0, MSG,
STOPRE and silent words, and subprograms by name, which are put in their place. Everything else (variables, jumps,
loops, cycles, transformations, tools, inch, polar positions, rotations) is refused by its line: nobody can say where
such a block goes without being the control.

Signs and meaning: Siemens' Programming Manual Fundamentals (G functions, AC IC DC ACP ACN, I J K, CR), DIN 66025.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import atan2, cos, hypot, pi, sin, sqrt
from typing import Literal

from gateway.errors import ModelError

MOST_LINES, MOST_DEPTH = 200_000, 8
SILENT = frozenset(
    {"STOPRE", "SOFT", "BRISK", "FFWON", "FFWOF", "COMPOF", "NORM", "KONT", "CFC", "CFTCP", "SBLON", "SBLOF"}
    | {"DISPLON", "DISPLOF", "G40", "G60", "G64", "G641", "G642", "G601", "G602", "G603", "G9", "G94", "G71", "G710"}
    | {"DIAMOF", "TRAFOOF"}
)
ENDS = frozenset({"M17", "RET", "M30", "M2", "M02"})
MODES = ("AC", "IC", "DC", "ACP", "ACN")
PLANES = {"G17": ("X", "Y", "I", "J"), "G18": ("Z", "X", "K", "I"), "G19": ("Y", "Z", "J", "K")}
SAME = 1e-6
RADIUS_MM = 0.005  # that start and end of an arc may differ in their distance from its centre
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_WORD = re.compile(
    rf"""\s*(?:
      (?P<msg>MSG\s*\(\s*(?:"[^"]*")?\s*\))
    | (?P<axis>[A-Z])\s*(?:
          =\s*(?P<mode>AC|IC|DC|ACP|ACN)\s*\(\s*(?P<inner>{_NUMBER})\s*\)
        | =?\s*(?P<plain>{_NUMBER})
      )(?![\w.=])
    | (?P<radius>CR)\s*=\s*(?P<value>{_NUMBER})(?![\w.])
    | (?P<name>[A-Z_][A-Z0-9_]*)(?![\w=(\[])
    )""",
    re.VERBOSE,
)
_REMARK = re.compile(r'"[^"]*"|;.*$')


@dataclass(frozen=True, slots=True)
class ProgramAxis:
    """An axis of the program: its letter, whether it turns (deg) endlessly, its travel, and the most it can do.

    ``velocity`` in mm/min or deg/min, ``acceleration`` in m/s2 or rev/s2 as machines' data sheets give them; None where
    nobody said.
    """

    letter: str
    rotary: bool = False
    modulo: bool = False
    travel: tuple[float, float] | None = None
    velocity: float | None = None
    acceleration: float | None = None


@dataclass(frozen=True, slots=True)
class ProgramMove:
    """One block's motion: from where to where, by letter; ``arc`` (centre by letter, sense +1 ccw, turn in rad)."""

    kind: Literal["rapid", "line", "arc"]
    start: Mapping[str, float]
    end: Mapping[str, float]
    feed: float | None
    arc: tuple[Mapping[str, float], float] | None = None
    plane: tuple[str, str] = ("X", "Y")

    def at(self, share: float) -> dict[str, float]:
        """Positions of all known axes at a share of the way, 0 to 1."""
        found = {}
        for letter, last in self.end.items():
            first = self.start.get(letter, last)
            found[letter] = first + share * (last - first)
        if self.arc is not None:
            centre, turn = self.arc
            a, b = self.plane
            x, y = self.start[a] - centre[a], self.start[b] - centre[b]
            angle = turn * share
            found[a] = centre[a] + x * cos(angle) - y * sin(angle)
            found[b] = centre[b] + x * sin(angle) + y * cos(angle)
            if share >= 1.0:
                found[a], found[b] = self.end[a], self.end[b]
        return found

    def length(self, axes: Mapping[str, ProgramAxis]) -> float:
        """Of the path in mm; in deg where only rotary axes move."""
        linear, turned = 0.0, 0.0
        for letter, last in self.end.items():
            moved = last - self.start.get(letter, last)
            if axes[letter].rotary:
                turned += moved**2
            elif self.arc is None or letter not in self.plane:
                linear += moved**2
        if self.arc is not None:
            centre, turn = self.arc
            a, b = self.plane
            linear += (turn * hypot(self.start[a] - centre[a], self.start[b] - centre[b])) ** 2
        return sqrt(linear) if linear > SAME**2 else sqrt(turned)


@dataclass(frozen=True, slots=True)
class ProgramBlock:
    """One block: its line in its file, its text, the words that stay, its motion.

    ``named`` are the axes that the block names, ``modes`` how modulo axes were told; ``in_machine`` where frames are
    left out, ``shifts`` what the frames add to each axis then.
    """

    file: str
    line: int
    text: str
    kept: tuple[str, ...] = ()
    move: ProgramMove | None = None
    named: tuple[str, ...] = ()
    modes: Mapping[str, str] = field(default_factory=dict)
    in_machine: bool = False
    shifts: Mapping[str, float] = field(default_factory=dict)
    remark: str = ""


@dataclass
class _State:
    """What stays in force."""

    kind: str = ""
    absolute: bool = True
    plane: str = "G17"
    frame: Mapping[str, float] = field(default_factory=dict)
    shift: dict[str, float] = field(default_factory=dict)
    feed: float | None = None
    at: dict[str, float] = field(default_factory=dict)
    framed: dict[str, float] = field(default_factory=dict)
    """What the frames added where each axis was last told its position."""


class ProgramReader:
    """Reads one program on one machine. ``frames`` are shifts by G word and letter, e.g. {"G54": {"X": -160.0}}."""

    def __init__(
        self,
        axes: Sequence[ProgramAxis],
        *,
        frames: Mapping[str, Mapping[str, float]] | None = None,
        subprogram: Callable[[str], str | None] = lambda _name: None,
    ) -> None:
        """``subprogram`` gives the text of a subprogram by its name, None where there is none."""
        self._axes = {axis.letter: axis for axis in axes}
        self._frames = {name.upper(): dict(shift) for name, shift in (frames or {}).items()}
        self._subprogram = subprogram

    def read(self, text: str, name: str = "program") -> tuple[ProgramBlock, ...]:
        """All blocks in the order in which they run.

        Raises ModelError with line and reason: E-SHADOW-WORD (not understood), E-SHADOW-FRAME (a frame that nobody
        declared), E-SHADOW-ARC, E-SHADOW-VALUE, E-SHADOW-START (an arc or G91 from an unknown place), E-SHADOW-LONG.
        """
        found: list[ProgramBlock] = []
        self._run(text, name, _State(), found, 0)
        return tuple(found)

    def _run(self, text: str, name: str, state: _State, found: list[ProgramBlock], depth: int) -> None:
        lines = text.splitlines()
        if len(lines) + len(found) > MOST_LINES or depth > MOST_DEPTH:
            raise ModelError("E-SHADOW-LONG", name, most=MOST_LINES, depth=MOST_DEPTH)
        for number, line in enumerate(lines, start=1):
            if self._block(line, (name, number), state, found, depth):
                return

    def _block(self, line: str, at: tuple[str, int], state: _State, found: list[ProgramBlock], depth: int) -> bool:
        """One line; True where it ends its program."""
        remarks = [one for one in _REMARK.findall(line) if one.startswith(";")]
        body = line[: line.index(remarks[0])] if remarks else line
        block = _Words(at, line)
        self._split(body, block)
        if block.call:
            text = self._subprogram(block.call)
            if text is None or not block.calls_only:
                raise _refused(at, line, block.call)
            found.append(ProgramBlock(*at, line, remark=f"; {block.call}: put in its place"))
            self._run(text, block.call, state, found, depth + 1)
            return False
        move = self._move(block, state, at, line)
        ends = bool(ENDS & set(block.kept))
        kept = tuple(one for one in block.kept if depth == 0 or one not in ("M17", "RET"))
        shifts = {} if block.in_machine else self._shifts(state)
        found.append(
            ProgramBlock(
                *at,
                line,
                kept=kept,
                move=move,
                named=tuple(block.axes),
                modes=block.modes,
                in_machine=block.in_machine,
                shifts=shifts,
                remark="".join(remarks),
            )
        )
        return ends

    def _split(self, body: str, block: _Words) -> None:
        place = 0
        text = body.rstrip()
        if text.lstrip().startswith(("/", "%")):
            raise _refused((block.at[0], block.at[1]), block.line, text.strip()[:20])
        while place < len(text):
            one = _WORD.match(text.upper(), place)
            if one is None:
                raise _refused(block.at, block.line, text[place:].strip()[:20])
            if one["msg"]:
                block.kept.append(text[place : one.end()].strip())
            elif one["axis"]:
                self._address(one, block)
            elif one["radius"]:
                block.radius = float(one["value"])
            else:
                self._named(one["name"], block)
            place = one.end()

    def _address(self, one: re.Match[str], block: _Words) -> None:
        letter, mode = one["axis"], one["mode"] or ""
        value = float(one["inner"] if mode else one["plain"])
        if letter in self._axes:
            if letter in block.axes:
                raise _refused(block.at, block.line, f"{letter} {letter}")
            block.axes[letter] = value
            block.modes[letter] = mode
        elif mode:
            raise _refused(block.at, block.line, one.group().strip())
        elif letter == "N" and not block.started:
            block.kept.append(f"N{plain_number(value)}")
            return
        elif letter in "IJK":
            block.centre[letter] = value
        elif letter == "F":
            block.feed = value
        elif letter == "G":
            self._g(f"G{value:g}", block)
        elif letter in "SM" or (letter in "TD" and value == 0.0):
            block.kept.append(f"{letter}{plain_number(value)}")
        else:
            raise _refused(block.at, block.line, one.group().strip())
        block.started = True

    def _g(self, word: str, block: _Words) -> None:
        if word in SILENT:
            block.kept.append(word)
        elif word in ("G0", "G1", "G2", "G3", "G4", "G90", "G91", "G500", "G53", "G153", *PLANES) or word in (
            "G54", "G55", "G56", "G57",
        ):  # fmt: skip
            block.g.append(word)
        else:
            raise _refused(block.at, block.line, word)

    def _named(self, name: str, block: _Words) -> None:
        if name in SILENT or name == "RET":
            block.kept.append(name)
        elif name in ("SUPA", "TRANS", "ATRANS"):
            block.g.append(name)
        elif not block.started and not block.call:
            block.call = name
        else:
            raise _refused(block.at, block.line, name)
        block.started = True

    def _move(self, block: _Words, state: _State, at: tuple[str, int], line: str) -> ProgramMove | None:
        """Modal words into the state, then the block's motion."""
        dwell = "G4" in block.g
        for word in block.g:
            self._modal(word, block, state)
        if block.shifting:
            self._shift(block, state)
            return None
        if block.feed is not None:
            if dwell:
                block.kept.append(f"G4 F{plain_number(block.feed)}")
            elif not block.feed > 0.0:
                raise ModelError("E-SHADOW-VALUE", f"{at[0]}:{at[1]}", word=f"F{block.feed:g}")
            else:
                state.feed = block.feed
        if dwell and (block.axes or block.feed is None):
            raise _refused(at, line, "G4")
        if not block.axes and not (block.centre and state.kind in ("G2", "G3")):
            return None
        if not state.kind:
            raise _refused(at, line, f"{' '.join(block.axes)} (G0 .. G3?)")
        start = dict(state.at)
        end = start | {letter: self._end(letter, value, block, state) for letter, value in block.axes.items()}
        state.framed |= {letter: self._total(letter, block, state) for letter in block.axes}
        arc = self._arc(block, state, start, end) if state.kind in ("G2", "G3") else None
        if state.kind != "G0" and state.feed is None:
            raise ModelError("E-SHADOW-VALUE", f"{at[0]}:{at[1]}", word="F")
        state.at = end
        a, b, _, _ = PLANES[state.plane]
        kind: Literal["rapid", "line", "arc"] = {"G0": "rapid", "G1": "line"}.get(state.kind, "arc")  # type: ignore[assignment]
        feed = None if kind == "rapid" else state.feed
        return ProgramMove(kind, start, end, feed=feed, arc=arc, plane=(a, b))

    def _modal(self, word: str, block: _Words, state: _State) -> None:
        if word in ("G0", "G1", "G2", "G3"):
            state.kind = word
        elif word in ("G90", "G91"):
            state.absolute = word == "G90"
        elif word in PLANES:
            state.plane = word
            block.kept.append(word)
        elif word in ("G53", "G153", "SUPA"):
            block.in_machine = True
        elif word in ("TRANS", "ATRANS"):
            block.shifting = word
        elif word == "G500":
            state.frame = {}
            block.kept.append(word)
        elif word != "G4":
            if word not in self._frames:
                raise ModelError("E-SHADOW-FRAME", f"{block.at[0]}:{block.at[1]}", frame=word)
            state.frame = self._frames[word]
            block.kept.append(word)

    def _shift(self, block: _Words, state: _State) -> None:
        if block.feed is not None or block.centre or block.radius is not None:
            raise _refused(block.at, block.line, block.shifting)
        for letter in block.axes:
            if self._axes[letter].rotary or block.modes[letter]:
                raise _refused(block.at, block.line, block.shifting)
        added = state.shift if block.shifting == "ATRANS" else {}
        state.shift = {letter: added.get(letter, 0.0) + block.axes.get(letter, 0.0) for letter in {*added, *block.axes}}
        words = " ".join(f"{letter}{plain_number(value)}" for letter, value in block.axes.items())
        block.kept.append(f"{block.shifting} {words}".strip())
        block.axes.clear()

    def _shifts(self, state: _State) -> dict[str, float]:
        """What the frames add, by letter."""
        return {
            letter: state.frame.get(letter, 0.0) + state.shift.get(letter, 0.0)
            for letter in {*state.frame, *state.shift}
        }

    def _total(self, letter: str, block: _Words, state: _State) -> float:
        """What the frames add to an axis in this block."""
        return 0.0 if block.in_machine else self._shifts(state).get(letter, 0.0)

    def _end(self, letter: str, value: float, block: _Words, state: _State) -> float:
        mode = block.modes[letter] or ("AC" if state.absolute else "IC")
        axis, here = self._axes[letter], state.at.get(letter)
        if mode == "IC":
            if here is None:
                raise ModelError("E-SHADOW-START", f"{block.at[0]}:{block.at[1]}", axis=letter)
            if abs(self._total(letter, block, state) - state.framed.get(letter, 0.0)) > SAME:
                # A setting of the control says whether the change of the frame is travelled too: not in the program.
                raise _refused(block.at, block.line, f"{letter}=IC")
            return here + value
        value += self._total(letter, block, state)
        if not axis.modulo:
            if mode != "AC":
                raise _refused(block.at, block.line, f"{letter}={mode}")
            return value
        return _turned(here, mode, value)

    def _arc(
        self, block: _Words, state: _State, start: dict[str, float], end: dict[str, float]
    ) -> tuple[dict[str, float], float]:
        """Centre and turn in rad (+ counter-clockwise) of G2 or G3."""
        a, b, first, second = PLANES[state.plane]
        place = f"{block.at[0]}:{block.at[1]}"
        if a not in start or b not in start:
            raise ModelError("E-SHADOW-START", place, axis=a if a not in start else b)
        if self._axes[a].rotary or self._axes[b].rotary or set(block.centre) - {first, second}:
            raise ModelError("E-SHADOW-ARC", place, word=f"{state.plane}: {a} {b}")
        sense = 1.0 if state.kind == "G3" else -1.0
        x, y = end[a] - start[a], end[b] - start[b]
        if block.radius is not None:
            if block.centre or hypot(x, y) < SAME or 2.0 * abs(block.radius) < hypot(x, y) - SAME:
                raise ModelError("E-SHADOW-ARC", place, word=f"CR={plain_number(block.radius)}")
            half = sqrt(max(block.radius**2 - (x**2 + y**2) / 4.0, 0.0)) / hypot(x, y)
            side = sense if block.radius > 0.0 else -sense
            centre = {a: start[a] + x / 2.0 - side * half * y, b: start[b] + y / 2.0 + side * half * x}
        elif block.centre:
            centre = {a: start[a] + block.centre.get(first, 0.0), b: start[b] + block.centre.get(second, 0.0)}
        else:
            raise ModelError("E-SHADOW-ARC", place, word=f"{first} {second} CR")
        out = hypot(start[a] - centre[a], start[b] - centre[b])
        last = hypot(end[a] - centre[a], end[b] - centre[b])
        if out < SAME or abs(out - last) > RADIUS_MM:
            raise ModelError("E-SHADOW-ARC", place, word=f"{out:.4f} mm, {last:.4f} mm")
        begin = atan2(start[b] - centre[b], start[a] - centre[a])
        turn = (sense * (atan2(end[b] - centre[b], end[a] - centre[a]) - begin)) % (2.0 * pi)
        return centre, sense * (turn if turn > SAME else 2.0 * pi)


@dataclass
class _Words:
    """The words of one block as they are read."""

    at: tuple[str, int]
    line: str
    g: list[str] = field(default_factory=list)
    axes: dict[str, float] = field(default_factory=dict)
    modes: dict[str, str] = field(default_factory=dict)
    centre: dict[str, float] = field(default_factory=dict)
    radius: float | None = None
    feed: float | None = None
    kept: list[str] = field(default_factory=list)
    call: str = ""
    shifting: str = ""
    in_machine: bool = False
    started: bool = False

    @property
    def calls_only(self) -> bool:
        """Whether nothing stands next to the call, apart from the block's number."""
        words = [one for one in self.kept if not re.fullmatch(r"N\d+", one)]
        return not (words or self.axes or self.g or self.centre) and self.radius is None and self.feed is None


def plain_number(value: float) -> str:
    """As short as nine decimals allow, never in exponent form."""
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _turned(here: float | None, mode: str, value: float) -> float:
    """The end of an endless axis that counts its turns; AC stays within the turn it is in, as the control does."""
    if here is None:
        return value % 360.0
    away = (value - here) % 360.0
    if min(away, 360.0 - away) < SAME:
        return here
    if mode == "ACN" or (mode == "DC" and away > 180.0):
        away -= 360.0
    elif mode == "AC":
        away = value % 360.0 - here % 360.0
    return here + away


def _refused(at: tuple[str, int], line: str, word: str) -> ModelError:
    return ModelError("E-SHADOW-WORD", f"{at[0]}:{at[1]}", word=word, line=line.strip()[:60])
