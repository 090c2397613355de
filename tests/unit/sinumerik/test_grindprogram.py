"""The program of a test part: its text, its moves walked block by block, what is refused before anything is sent."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ConfigError, LocalProtocolError
from drivers.sinumerik.ncprogram.backup import ReservedPoints
from drivers.sinumerik.ncprogram.checks import check_program
from drivers.sinumerik.ncprogram.grinding import GrindSetting, build_grinding_program, fixed_axes
from drivers.sinumerik.ncprogram.words import Words
from drivers.sinumerik.opcua.grinding import preview_program
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.workpiece import GrindAxis, GrindPlan, check_plan
from simulators.nck.language.parser import parse

GOLDEN = Path(__file__).parents[2] / "golden" / "sinumerik" / "grind.mpf"
MEMORY = {name: ReservedPoints(2, (0, 0), ("X1", "Y1", "Z1", "C1")) for name in ("X1", "Z1", "C1")}
PLAN = GrindPlan(
    name="TFGRIND_C1",
    part="RV-40E BEFORE",
    infeed=GrindAxis("X1", "X", (-420.0, 20.0)),
    stroke=GrindAxis("Z1", "Z", (-10.0, 320.0)),
    index=GrindAxis("C1", "C"),
    dresser=GrindAxis("Y1", "Y", (-60.0, 60.0)),
    spaces=39,
    centre_distance_mm=160.0,
    height_mm=150.0,
    face_mm=10.0,
    root_mm=59.7,
    tip_mm=62.3,
    stock_mm=0.25,
    wheel_on="S1500 M3",
    wheel_off="M5",
)
SHIFTED = replace(PLAN, wheel=GrindAxis("V1", "V", (-60.0, 60.0)), wheel_mm=12.5)


@dataclass
class Walk:
    """Does the blocks of a program as an ideal machine would; every move is (letter, from, to)."""

    plan: GrindPlan
    r: dict[str, Any]
    at: dict[str, float]
    moves: list[tuple[str, float, float]] = field(default_factory=list)
    cuts: list[tuple[float, float, float]] = field(default_factory=list)
    feeds: list[float] = field(default_factory=list)
    loops: list[tuple[int, str, str]] = field(default_factory=list)
    stood: list[tuple[dict[str, float], float]] = field(default_factory=list)
    runs: bool = False
    running: list[bool] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    counted_at: list[dict[str, float]] = field(default_factory=list)
    abort_after: int = 10**6

    def run(self, text: str) -> None:
        lines, line = text.splitlines(), 0
        labels = {one[:-1]: place for place, one in enumerate(lines) if one.endswith(":")}
        while lines[line] != "M30":
            line = self._do(lines, line, labels) + 1

    def _do(self, lines: list[str], line: int, labels: dict[str, int]) -> int:
        block = lines[line]
        jump = re.fullmatch(r"IF (.+) GOTOF (\w+)", block)
        if jump:
            return labels[jump[2]] if self._value(jump[1]) else line
        if block.startswith("IF "):
            return line if self._value(block[3:]) else _next(lines, line, "ELSE", "ENDIF")
        if block == "ELSE":
            return _next(lines, line, "ENDIF")
        if block.startswith(("FOR ", "ENDFOR")):
            return self._loop(block, line)
        if block.startswith("SUPA G1 "):
            self._move(*block.split()[2].split("=", 1))
            self.feeds.append(self._value(block.split()[3].removeprefix("F=")))
            self.running.append(self.runs)
        elif not self._noted(block):
            self._assign(block)
        return line

    def _loop(self, block: str, line: int) -> int:
        loop = re.fullmatch(r"FOR (\w+)=(.+) TO (.+)", block)
        if loop:
            self.r[loop[1]] = int(self._value(loop[2]))
            self.loops.append((line, loop[1], loop[3]))
            return line
        begin, name, last = self.loops[-1]
        self.r[name] += 1
        if self.r[name] <= self._value(last):
            return begin
        self.loops.pop()
        return line

    def _noted(self, block: str) -> bool:
        if block in ("S1500 M3", "M5"):
            self.runs = block != "M5"
        elif block.startswith("G4 F"):
            self.stood.append((dict(self.at), float(block[4:])))
        elif block.startswith("MSG("):
            self.said.append(block)
        else:
            return False
        return True

    def _assign(self, block: str) -> None:
        filled = re.fullmatch(r"(\w+)\[(\d+)\]=SET\((.+)\)", block)
        if filled:
            row = self.r.setdefault(filled[1], {})
            row |= {int(filled[2]) + place: float(one) for place, one in enumerate(filled[3].split(","))}
        elif re.fullmatch(r"R80=R80\+1", block):
            self.r["R80"] += 1
            self.counted_at.append(dict(self.at))
            self.r["R86"] = float(self.r["R80"] >= self.abort_after)
        elif re.fullmatch(r"[A-Z]\w*=[^\"]+", block):
            name, value = block.split("=", 1)
            self.r[name] = self._value(value)
        else:
            assert re.match(r"(;|DEF|G17|TRAFOOF$|STOPRE$|M0$|TF_|ENDIF)", block), block

    def _value(self, text: str) -> float:
        said = text.replace("<>", "!=").replace(" AND ", " and ").replace(" OR ", " or ")
        return float(eval(said, {"ABS": abs, **self.r}))  # noqa: S307 - our own text

    def _move(self, letter: str, word: str) -> None:
        found = re.fullmatch(r"(?:(DC|ACP|ACN)\()?([^()]+)\)?", word)
        assert found is not None
        to, here = self._value(found[2]), self.at[letter]
        if found[1]:
            ahead = (to - here) % 360.0
            to = here + (ahead - 360.0 if found[1] == "ACN" or (found[1] == "DC" and ahead > 180.0) else ahead)
        self.at[letter] = to
        self.moves.append((letter, here, to))
        if letter == "Z" and self.at["X"] > self.plan.retracted_mm + 1e-9:
            self.cuts.append((self.at["X"], self.at["C"], to - here))


def _next(lines: list[str], line: int, *ends: str) -> int:
    """The end of the branch that begins at a line, past all that is within it."""
    depth = 0
    for place in range(line + 1, len(lines)):
        block = lines[place]
        if not depth and block in ends:
            return place
        depth += (block.startswith("IF ") and "GOTOF" not in block) - (block == "ENDIF")
    raise AssertionError("no end")


def walked(
    plan: GrindPlan, abort_after: int = 10**6, start: tuple[float, float] = (-3.0, 200.0), *, loops: bool = True
) -> Walk:
    """The program of a plan, from somewhere with C turned somewhere."""
    values = {"R77": plan.x_mm, "R78": plan.c_deg, "R79": plan.dressing_mm, "R86": 0.0, "R89": 123456.0}
    walk = Walk(plan, values, {"X": start[0], "V": 7.0, "Z": 3.0, "C": start[1]}, abort_after=abort_after)
    text = build_grinding_program(replace(plan, save_tables=False), 123456, GrindSetting(Words(), {}, loops=loops))
    parse(text)
    walk.run(text)
    return walk


def test_the_text_is_the_golden_one() -> None:
    plain = build_grinding_program(replace(PLAN, save_tables=False), 123456, GrindSetting(Words(), {}))
    assert plain == GOLDEN.read_text(encoding="ascii")
    assert len(plain.splitlines()) < 110
    text = build_grinding_program(PLAN, 123456, GrindSetting(Words(), MEMORY))
    parse(text)
    assert "MA_MM_" not in text
    assert not re.search(r"^\$(AA_ENC|AN_CEC|MA_|MN_|SN_)", text, re.MULTILINE)  # reads tables, writes none


@settings(max_examples=15, deadline=None)
@given(
    x=st.floats(-0.2, 0.2),
    c=st.floats(-0.05, 0.05),
    y=st.floats(-0.2, 0.2),
    spaces=st.integers(3, 60),
    rough=st.sampled_from([(), (0.05,), (0.05, 0.02), (0.1, 0.05, 0.01)]),
    spark=st.integers(0, 3),
    sense=st.sampled_from([1, -1]),
    turned=st.floats(-720.0, 720.0),
)
def test_every_axis_comes_from_one_side_and_c_turns_only_with_the_wheel_clear(
    x: float, c: float, y: float, spaces: int, rough: tuple[float, ...], spark: int, sense: int, turned: float
) -> None:
    values = {"x_mm": round(x, 6), "c_deg": round(c, 6), "dressing_mm": round(y, 6)}
    plan = replace(
        SHIFTED, **values, spaces=spaces, rough_mm=rough, spark_out=spark, index_sense=sense, overrun_mm=12.0
    )
    walk = walked(plan, start=(-3.0, turned))
    assert len(walk.cuts) == spaces * len(plan.strokes)
    for number, (at_x, at_c, _) in enumerate(walk.cuts):
        space, stroke = divmod(number, len(plan.strokes))
        assert at_x == pytest.approx(-160.0 + plan.x_mm - plan.strokes[stroke], abs=1e-9)
        off = (at_c - plan.c_deg - sense * 360.0 * space / spaces + 180.0) % 360.0 - 180.0
        assert off == pytest.approx(0.0, abs=1e-7)
    last = {"X": 0.0, "V": 0.0, "Z": 0.0, "C": 0.0}
    at = {"X": -3.0, "V": 7.0, "Z": 3.0, "C": turned}
    for letter, here, to in walk.moves:
        if letter in "CV":
            assert at["X"] == plan.retracted_mm
            assert at["Z"] <= 150.0 - 5.0 - 6.0 or at["Z"] >= 150.0 + 5.0 + 6.0
        if letter == "Z" and at["X"] > plan.retracted_mm:  # cutting: who stands must have come from his side
            assert (last["X"], last["C"], last["V"]) == (1.0, float(sense), 1.0)
        last[letter] = math.copysign(1.0, to - here) if to != here else last[letter]
        at[letter] = to
    assert at["V"] == pytest.approx(12.5 + plan.dressing_mm, abs=1e-9)
    assert not any(on for (letter, *_), on in zip(walk.moves, walk.running, strict=True) if letter == "V")
    assert walk.r["R90"] == 7


def test_a_control_that_takes_no_tables_gets_the_same_strokes_one_by_one() -> None:
    for rough, spark in (((0.05, 0.02), 1), ((), 0), ((0.1, 0.05, 0.01), 3)):
        plan = replace(SHIFTED, rough_mm=rough, spark_out=spark, x_mm=0.01, overrun_mm=12.0, spaces=5)
        looped, unrolled = walked(plan), walked(plan, loops=False)
        moved = [
            [one for one in zip(walk.moves, walk.feeds, walk.running, strict=True) if one[0][1] != one[0][2]]
            for walk in (looped, unrolled)
        ]
        assert moved[0] == moved[1]
        assert looped.cuts == unrolled.cuts
    assert "SET(" not in build_grinding_program(plan, 123456, GrindSetting(Words(), MEMORY, loops=False))
    shown = [
        build_grinding_program(plan, 1, GrindSetting(Words(), MEMORY, loops=loops)).partition("DEF")[0]
        for loops in (True, False)
    ]
    assert shown[0] == shown[1]  # and people read the same of both


def test_people_come_to_a_clear_wheel_and_spaces_are_counted_with_the_wheel_clear() -> None:
    walk = walked(PLAN)
    assert [one for one in walk.said if one != 'MSG("")'] == [
        'MSG("TRUEFLANK LOAD BLANK RV-40E BEFORE")',
        'MSG("TRUEFLANK UNLOAD PART RV-40E BEFORE")',
    ]
    text = build_grinding_program(PLAN, 123456, GrindSetting(Words(), MEMORY))
    loaded = text.index("LOAD BLANK")
    on, first = text.index("S1500 M3"), text.index("FOR USPACE=0")
    assert text.index('"M17"') < text.index("SUPA G1 X=-170.0") < loaded < on < first
    assert text.index("R90=13") < text.index("SUPA")
    assert len(walk.counted_at) == 39
    assert all(at["X"] == -170.0 and at["Z"] == 137.0 for at in walk.counted_at)
    assert 180.0 < PLAN.seconds < 480.0


def outside(x_mm: float, z_mm: float, stock_mm: float) -> bool:
    """Whether a wheel at these axis places touches no point of a blank with this stock along its normals.

    Curve of the disc and dressed section by hand: pin radius 3 inside the path of a pin, e^it 64 - 1.3 e^40it; the
    wheel's radius at y is 160 less the space's x there; a blank's point is hit where it lies nearer to its axis.
    """
    t = np.linspace(1e-6, np.pi / 39.0, 4001)
    first, second = 64.0 * np.exp(1j * t), 1.3 * np.exp(40j * t)
    normal = (first - 40.0 * second) / np.abs(first - 40.0 * second)
    flank = first - second - 3.0 * normal
    blank = (flank + stock_mm * normal)[::20]
    radius = 160.0 - np.interp(np.abs(blank.imag), flank.imag, flank.real)
    heights = np.linspace(145.0, 155.0, 101)[:, None]
    return bool(np.all(np.hypot(-x_mm - blank.real, heights - z_mm) > radius))


def test_the_wheel_meets_no_stock_at_positioning_feed_nor_while_it_is_fed_in() -> None:
    assert not outside(-160.05, 137.0, 0.3)  # in the space, 8 mm beyond the face: where the approach ended before
    plan = replace(PLAN, spaces=3, stock_mm=0.25, x_mm=0.2, positioning_feed=2999.0, overrun_mm=9.5)
    walk = walked(plan)
    at, approaches, fed = {"X": -3.0, "V": 7.0, "Z": 3.0, "C": 200.0}, 0, 0
    for (letter, here, to), feed in zip(walk.moves, walk.feeds, strict=True):
        way = np.linspace(here, to, 30)
        ends = [(x, at["Z"]) for x in way] if letter == "X" else [(at["X"], z) for z in way] if letter == "Z" else []
        if feed == 2999.0 and at["X"] <= -160.0:
            assert all(outside(x, z, 0.149) for x, z in ends)  # 0.25 mm along X, by the steepest flank's 0.596
            approaches += letter == "X" and to > here
        elif letter == "X" and feed == 200.0:
            assert all(outside(x, z, 0.149) for x, z in ends)
            fed += 1
        at[letter] = to
    assert (approaches, fed) == (3, 3)


def test_a_site_that_does_not_name_what_places_the_wheel_gets_no_word_for_it() -> None:
    text = build_grinding_program(PLAN, 123456, GrindSetting(Words(), MEMORY))
    assert not re.search(r"\b[YV]\d*\s*=|R79", text)
    assert {letter for letter, *_ in walked(PLAN).moves} == {"X", "Z", "C"}
    running = build_grinding_program(SHIFTED, 123456, GrindSetting(Words(), MEMORY)).splitlines()
    moves = [place for place, block in enumerate(running) if block.startswith("SUPA G1 V=")]
    assert running.index("M5") < moves[0] < moves[-1] < running.index("S1500 M3")


def test_a_block_that_moves_the_dresser_is_never_sent() -> None:
    text = build_grinding_program(PLAN, 123456, GrindSetting(Words(), MEMORY))
    names = {"X1", "Y1", "Z1", "C1", "X", "Y", "Z", "C"}
    path = "/_N_MPF_DIR/_N_TFGRIND_C1_MPF"
    assert check_program(path, text, names, still=fixed_axes(PLAN)).program.text == text
    for block in ("SUPA G1 Y=UXSET F=3000.0", "G1 X=-170.0 Y-2.0", "Y1=3", "SUPA G1 Y1 = IC(1.0) F=100.0"):
        changed = text.replace("S1500 M3", f"S1500 M3\n{block}")
        with pytest.raises(LocalProtocolError) as caught:
            check_program(path, changed, names, still=fixed_axes(PLAN))
        assert (caught.value.code, caught.value.fields["line"]) == (
            "E-PROGRAM-MOVES",
            changed.splitlines().index(block) + 1,
        )


def test_the_abort_word_is_obeyed_between_spaces_with_the_wheel_clear() -> None:
    walk = walked(PLAN, abort_after=4)
    assert (walk.r["R80"], walk.r["R90"]) == (4, 8)
    assert (walk.at["X"], walk.at["Z"]) == (-170.0, 137.0)


def test_a_program_whose_gateway_has_gone_or_whose_values_are_wrong_moves_nothing() -> None:
    text = build_grinding_program(replace(PLAN, save_tables=False), 123456, GrindSetting(Words(), {}))
    twice = walked(PLAN)
    moved = len(twice.moves)
    twice.run(text)
    assert len(twice.moves) == moved  # a second NC START does nothing
    offset = replace(PLAN, wheel_offset=200, save_tables=False)
    text = build_grinding_program(offset, 123456, GrindSetting(Words(), {}))
    right = {"R77": 0.0, "R78": 0.0, "R79": 0.0, "R86": 0.0, "R89": 123456.0, "R200": 0.0}
    for wrong, phase in (
        ({"R89": 0.0}, None),
        ({"R77": 0.21}, 14),
        ({"R78": -0.06}, 14),
        ({"R79": 1.0}, 14),
        ({"R79": 0.01}, 14),  # not what the wheel was dressed with
        ({"R200": 0.01}, 14),
        ({"R86": 1.0}, 8),
    ):
        walk = Walk(PLAN, right | wrong, {"X": 0.0, "V": 0.0, "Z": 0.0, "C": 0.0})
        walk.run(text)
        assert walk.moves == []
        assert walk.r.get("R90") == phase


NAN = float("nan")


@pytest.mark.parametrize(
    ("change", "code", "says"),
    [
        ({"x_mm": 0.2001}, "E-GRIND-VALUE", "x_mm"),
        ({"x_mm": NAN}, "E-GRIND-VALUE", "x_mm"),
        ({"c_deg": -0.051}, "E-GRIND-VALUE", "c_deg"),
        ({"dressing_mm": float("inf")}, "E-GRIND-VALUE", "dressing_mm"),
        ({"centre_distance_mm": NAN}, "E-GRIND-VALUE", "centre_distance_mm"),
        ({"height_mm": NAN}, "E-GRIND-VALUE", "height_mm"),
        ({"overrun_mm": 6.0}, "E-GRIND-VALUE", "overrun_mm"),
        ({"retract_mm": 0.1}, "E-GRIND-VALUE", "retract_mm"),
        ({"rough_mm": (-0.01,)}, "E-GRIND-VALUE", "rough_mm"),
        ({"rough_mm": (0.02, 0.05)}, "E-GRIND-VALUE", "rough_mm"),
        ({"stroke_feed": 0.0}, "E-GRIND-VALUE", "stroke_feed"),
        ({"dwell_s": -1.0}, "E-GRIND-VALUE", "dwell_s"),
        ({"spaces": 2}, "E-GRIND-VALUE", "spaces"),
        ({"centre_distance_mm": 415.0}, "E-GRIND-TRAVEL", "X1"),
        ({"height_mm": 310.0}, "E-GRIND-TRAVEL", "Z1"),
        ({"index": GrindAxis("C1", "C", (-180.0, 180.0))}, "E-GRIND-TRAVEL", "C1"),
        ({"wheel": GrindAxis("V1", "V", (-1.0, 1.0))}, "E-GRIND-TRAVEL", "V1"),
        ({"dressing_mm": 0.01}, "E-GRIND-PLACE", "0.01"),
        ({"dresser": None, "dressing_mm": 0.01}, "E-GRIND-PLACE", "0.01"),
        ({"wheel": GrindAxis("Y1", "Y")}, "E-GRIND-DRESSER", "Y1"),
        ({"wheel": GrindAxis("V1", "Y")}, "E-GRIND-DRESSER", "V1"),
        ({"dresser": GrindAxis("X1", "X")}, "E-GRIND-DRESSER", "X1"),
        ({"wheel_offset": 80}, "E-GRIND-OFFSET", "R80"),
        ({"wheel_offset": 77}, "E-GRIND-OFFSET", "R77"),
        ({"stock_mm": 7.0}, "E-GRIND-STOCK", "10.1 mm"),
        ({"stock_mm": 0.35}, "E-GRIND-STOCK", "overrun_mm"),
        ({"stock_mm": NAN}, "E-GRIND-VALUE", "stock_mm"),
        ({"retract_mm": 3.2}, "E-GRIND-STOCK", "retract_mm"),
        ({"air_cut_feed": 501.0}, "E-GRIND-VALUE", "air_cut_feed"),
        ({"root_mm": 160.0}, "E-GRIND-VALUE", "root_mm"),
        ({"wheel_off": "M5 M=Y"}, "E-GRIND-WHEEL", "M=Y"),
        ({"wheel_on": "M3 M30"}, "E-GRIND-WHEEL", "M30"),
        ({"wheel_off": "M00"}, "E-GRIND-WHEEL", "M00"),
        ({"wheel_on": "G1 X=0"}, "E-GRIND-WHEEL", "G1"),
        ({"part": 'X") M30'}, "E-PROGRAM-MESSAGE", 'X"'),
        ({"stroke": GrindAxis("Z1 M30", "Z")}, "E-PROGRAM-NAME", "Z1 M30"),
    ],
)
def test_what_could_harm_is_refused_before_anything_is_sent(change: dict[str, object], code: str, says: str) -> None:
    with pytest.raises((ConfigError, LocalProtocolError)) as caught:
        build_grinding_program(replace(PLAN, **change), 1, GrindSetting(Words(), MEMORY))
    assert caught.value.code == code
    assert says in caught.value.what
    assert caught.value.hint


def test_what_is_allowed_at_the_limits_is_not_refused() -> None:
    check_plan(replace(SHIFTED, x_mm=0.2, c_deg=-0.05, dressing_mm=-0.2, overrun_mm=9.5))
    check_plan(replace(PLAN, wheel_offset=79, dressing_mm=0.2))
    check_plan(replace(PLAN, dresser=None, wheel_on="S1=1500 M1=3 M8"))


def test_a_preview_shows_the_moves_and_would_do_nothing() -> None:
    text = preview_program(PLAN, {"security": "None", "r_first": 500}, "site")
    assert "R577" not in text
    assert "UXSET=R497" in text
    assert "WRITE" not in text
    assert "IF R509<>999999 GOTOF TF_STALE" in text


@pytest.mark.parametrize(
    ("given", "first"), [({}, 77), ({"r_first": 2}, 22), ({"r_first": 0, "r_setup": 40}, 40), ({"r_setup": 100}, 100)]
)
def test_where_the_set_up_values_travel(given: dict[str, int], first: int) -> None:
    assert UaSettings.read({"security": "None", **given}, "site").words.setup == first


@pytest.mark.parametrize("number", [78, 80, 99, -2, 40000])
def test_set_up_values_keep_clear_of_the_words(number: int) -> None:
    with pytest.raises(ConfigError) as caught:
        UaSettings.read({"security": "None", "r_setup": number}, "site")
    assert caught.value.fields["key"] == "r_setup"
