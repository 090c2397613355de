"""What the cells of a table's heading say: which quantity, in which unit, of which pass; in the words of the field.

English, German and Chinese, as spreadsheets and capture programs write them. A word that is not known says nothing.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from drivers.files.columns import DOWN, READING_UNITS, TARGET_UNITS, UP

Meaning = Literal["target", "direction", "repetition", "deviation", "position", ""]
# "position" stands alone as a reading of the place, and as the target where the reading is something else.
PLACE = "position"
WORDS: dict[Meaning, str] = {
    "target": "target, nominal, nominal value, commanded, setpoint, p_i, soll, sollwert, ziel, 目标, 理论, 指令, 名义",
    "direction": "direction, approach, dir, richtung, anfahrrichtung, 方向",
    "repetition": "repetition, run, cycle, pass, repeat, lauf, zyklus, wiederholung, 次数, 循环, 重复, 趟",
    "deviation": "deviation, dev, error, positioning deviation, positioning error, abweichung, fehler, 偏差, 误差",
    "position": "position, measured, measured value, actual, actual value, ist, istwert, 实际, 实测, 测量值, 位置",
}
_KNOWN: dict[str, Meaning] = {word: meaning for meaning, words in WORDS.items() for word in words.split(", ")}
_PLACES = ("position", " position", " pos", "位置", "值", "点")
UPWARD = UP | {"fwd", "forwards", "positive", "vor", "vorwärts", "↑", "→", "正", "正向", "正程"}
DOWNWARD = DOWN | {"bwd", "rev", "backwards", "negative", "zurück", "rückwärts", "↓", "←", "反", "反向", "负向", "反程"}
DIRECTIONS: dict[str, int] = dict.fromkeys(UPWARD, 0) | dict.fromkeys(DOWNWARD, 1)
_SPELLED = {"µ": "u", "μ": "u", "micron": "um", "microns": "um", "°": "deg", "in": "inch", '"': "arcsec", "″": "arcsec"}
_BRACKET = re.compile(r"[\[(（]\s*([^\[\]()（）]{1,12}?)\s*[\])）]\s*$")
_TAIL = re.compile(r"[_ ,/]+([a-zµμ]+)$")
_TOKEN = re.compile(r"[a-zäöüß]+|\d+|[+\-↑↓→←]|[\u4e00-\u9fff]+")
_BESIDE = frozenset({"x", "i", "j", "d", "no", "nr", "第", "次", *_KNOWN}) - {PLACE}


@dataclass(frozen=True, slots=True)
class HeadCell:
    """One cell: ``meaning`` ("" where no known word stands), ``unit`` ("" unsaid), ``words`` without the unit."""

    meaning: Meaning
    unit: str
    words: str


@dataclass(frozen=True, slots=True)
class HeadPass:
    """A column of readings of one pass: its number (0: unsaid), its way, what it reads where a word says so."""

    number: int
    way: int
    meaning: Meaning


def head_cell(text: str) -> HeadCell:
    """A cell of a heading."""
    words, unit = _unit_apart(text.strip().lower())
    words = " ".join(words.replace("_", " ").split()) if words != "p_i" else words
    front, mark, rest = text.strip().lower().partition("_")
    if mark and not unit and words not in _KNOWN and front in _KNOWN:
        return HeadCell(_KNOWN[front], rest, front)  # a unit that nobody knows is refused by whoever reads it
    return HeadCell(_meaning(words), unit, words)


def pass_of(cell: HeadCell) -> HeadPass | None:
    """The pass that a cell names, "Run 3 fwd", "x_i2↓", "Lauf 4 -", "反向3"; None where it names none, or more."""
    tokens = _TOKEN.findall(cell.words)
    tokens = [part for token in tokens for part in _chinese(token)]
    ways = [token for token in tokens if token in DIRECTIONS and not token.isdigit()]
    numbers = [token for token in tokens if token.isdigit()]
    others = {token for token in tokens if token not in DIRECTIONS and not token.isdigit()}
    if len(ways) != 1 or len(numbers) > 1 or not others <= _BESIDE:
        return None
    meanings = {_KNOWN[one] for one in others if one in _KNOWN} & {"deviation", "position"}
    if len(meanings) > 1:
        return None
    return HeadPass(int(numbers[0][:6]) if numbers else 0, DIRECTIONS[ways[0]], meanings.pop() if meanings else "")


def _chinese(token: str) -> list[str]:
    """A run of Chinese as the known words it consists of, or whole."""
    if token in DIRECTIONS or token in _BESIDE or not "\u4e00" <= token[0] <= "\u9fff":
        return [token]
    known = sorted({*DIRECTIONS, *_BESIDE}, key=len, reverse=True)
    found, rest = [], token
    while rest:
        word = next((one for one in known if rest.startswith(one)), "")
        if not word:
            return [token]
        found.append(word)
        rest = rest[len(word) :]
    return found


def _unit_apart(text: str) -> tuple[str, str]:
    """The words and the unit: in brackets, or as the last word."""
    for pattern in (_BRACKET, _TAIL):
        found = pattern.search(text)
        if found and (unit := _unit(found[1])):
            return text[: found.start()].strip(), unit
    found = _BRACKET.search(text)
    # What stands in brackets and is no unit we know is said, not lost: whoever reads it refuses it.
    return (text[: found.start()].strip(), found[1]) if found else (text, "")


def _unit(text: str) -> str:
    plain = _SPELLED.get(text, text.replace("µ", "u").replace("μ", "u"))
    return plain if plain in READING_UNITS or plain in TARGET_UNITS else ""


def _meaning(words: str) -> Meaning:
    if words in _KNOWN:
        return _KNOWN[words]
    for end in _PLACES:
        if words.endswith(end) and (found := _KNOWN.get(words.removesuffix(end).strip())) in ("target", "position"):
            return found
    return ""
