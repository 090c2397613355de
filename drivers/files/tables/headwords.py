"""What the cells of a table's heading say: which quantity, in which unit, of which pass; in the words of the field.

English, German and Chinese, and the commonest of other languages, as spreadsheets and capture programs write them. A
word that is not known says nothing.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from typing import Literal

from drivers.units import unit_named

UP, DOWN = {"+", "+1", "1", "up", "forward", "f", "pos"}, {"-", "-1", "down", "backward", "reverse", "r", "b", "neg"}
Meaning = Literal["target", "direction", "repetition", "deviation", "position", ""]
# "position" stands alone as a reading of the place, and as the target where the reading is something else.
PLACE = "position"
PLACES = ("position", "pos", "mpos", "machine position", "axis position")
WORDS: dict[Meaning, str] = {
    "target": (
        "target, nominal, nominal value, commanded, command, setpoint, set, set point, p_i, p i, tgt, tgt pos, "
        "setpoint value, set value, demand, demand position, desired, sollmaß, sollmass, "
        "pi, target position pi, target pi, position pi, "
        "soll, sollwert, ziel, sollposition, zielposition, 目标, 理论, 指令, 名义, 目標, position "
        "cible, cible, consigne, position nominale, quota nominale, quota, posizione "
        "nominale, posición objetivo, posición nominal, objetivo, pozycja zadana, позиция, "
        "заданная позиция"
    ),
    "direction": (
        "direction, approach, direction of approach, approach direction, dir, way, richtung, "
        "anfahrrichtung, anfahrt, verfahrrichtung, 方向, sens, direzione, senso, verso, richting, dirección, sentido, "
        "kierunek, направление"
    ),
    "repetition": (
        "repetition, run, cycle, pass, repeat, run no, run number, pass no, pass number, cycle no, rep, j, "
        "lauf, zyklus, lauf nr, zyklus nr, "
        "wiederholung, messreihe, 次数, 循环, 重复, 趟, 回数, passage, ciclo, passata, pasada, "
        "przejazd, проход, цикл"
    ),
    "deviation": (
        "deviation, dev, error, err, diff, difference, positioning deviation, positioning error, x_ij, x ij, "
        "pitch, yaw, roll, differenz, "
        "abweichung, fehler, positionsabweichung, 偏差, 误差, 誤差, écart, erreur, scostamento, "
        "errore, deviazione, desviación, odchyłka, отклонение"
    ),
    "position": (
        "position, mpos, machine position, axis position, measured, measured value, measured position, "
        "actual, actual value, act, reading, pos, ist, "
        "istwert, istposition, messwert, 实际, 实测, 测量值, 位置, position mesurée, mesure, quota "
        "misurata, posizione misurata, posición medida, medida"
    ),
}
_KNOWN: dict[str, Meaning] = {
    word.strip(): meaning for meaning, words in WORDS.items() for word in words.split(",") if word.strip()
}
_ENDS = ("position", " position", " pos", "位置", "值", "点")
UP_WORDS = (
    "fwd, forwards, positive, positiv, vor, vorwärts, hin, auf, aufwärts, ↑, →, 正, 正向, 正程, aller, avanti, andata, "
    "adelante, ida, прямое, прямой, прямо, вперёд, вперед, туда, 往, heen"
)
DOWN_WORDS = (
    "bwd, rev, backwards, negative, negativ, zurück, rückwärts, rück, her, ab, abwärts, ↓, ←, 反, 反向, 负, 負, 负向, "
    "反程, retour, indietro, ritorno, atrás, vuelta, обратное, обратный, обратно, назад, 復, terug"
)
UPWARD, DOWNWARD = UP | set(UP_WORDS.split(", ")), DOWN | set(DOWN_WORDS.split(", "))
DIRECTIONS: dict[str, int] = dict.fromkeys(UPWARD, 0) | dict.fromkeys(DOWNWARD, 1)
STATISTIC_WORDS = (
    "mean, average, avg, std, stdev, sd, s, sigma, min, max, minimum, maximum, range, spread, median, result, "
    "reversal, summary, results, mittel, mittelwert, standardabweichung, streuung, spannweite, umkehrspanne, ergebnis, "
    "moyenne, média, media, promedio, 平均, 平均值, 标准差, 标准偏差, 最大, 最小, b, r, e, a, m, u"
)
STATISTICS = frozenset(STATISTIC_WORDS.split(", "))
INCH_OR_ARCSEC = ('"', "\N{DOUBLE PRIME}")
"""Marks that stand for inches beside lengths and for seconds of arc beside angles."""
_BRACKET = re.compile(r"[\[(（]\s*([^\[\]()（）]{1,12}?)\s*[\])）]\s*$")
_TAIL = re.compile(r"[_ ,/]+([a-zµμмк]+|[微毫]米)$")
# "Grad" is a degree in German, "grad" a hundredth of a right angle in other languages: nobody can tell from that alone.
_GON = re.compile(r"(?<![^\W_])grad(?![^\W_])")
_COUNTED = re.compile(r"\(\s*[ij]\s*\)(?=\s*(?:[\[(].*)?$)")
_TOKEN = re.compile(r"[\u4e00-\u9fff]+|[^\W\d_\u4e00-\u9fff]+|[0-9]+|[+\-↑↓→←]")
_BESIDE = frozenset({"x", "i", "j", "d", "no", "nr", "ref", "第", "次", *_KNOWN}) - {PLACE}
_INDEX = frozenset(
    {
        "",
        "no",
        "no.",
        "nr",
        "nr.",
        "#",
        "n",
        "n°",
        "i",
        "index",
        "idx",
        "test",
        "stop",
        "point",
        "pt",
        "punkt",
        "序号",
        "编号",
    }
)


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


@functools.lru_cache(maxsize=1024)
def head_cell(text: str) -> HeadCell:
    """A cell of a heading."""
    words, unit = _unit_apart(_COUNTED.sub("", text.strip().lower()))
    words = " ".join(words.replace("_", " ").split()) if words != "p_i" else words
    if unit == "deg" and _GON.search(text):
        unit = "grad?"
    front, mark, rest = text.strip().lower().partition("_")
    if mark and not unit and words not in _KNOWN and front in _KNOWN:
        return HeadCell(_KNOWN[front], rest, front)  # a unit that nobody knows is refused by whoever reads it
    return HeadCell(_meaning(words), unit, words)


def pass_of(cell: HeadCell) -> HeadPass | None:
    """The pass that a cell names, "Run 3 fwd", "x_i2↓", "Lauf 4 -", "反向3"; None where it names none, or more."""
    tokens = [part for token in _TOKEN.findall(cell.words) for part in _chinese(token)]
    if cell.meaning == "target":
        return None
    # Beside a "ref" the word "pos" is a position, not the positive way.
    ways = [one for one in tokens if _is_way(one) and not (one == "pos" and "ref" in tokens)]
    numbers = [token for token in tokens if token[0] in "0123456789"]
    others = {token for token in tokens if token not in ways and token[0] not in "0123456789"}
    if len(ways) != 1 or len(numbers) > 1 or not others <= _BESIDE:
        return None
    meanings = {_KNOWN[one] for one in others if one in _KNOWN} & {"deviation", "position"}
    if len(meanings) > 1:
        return None
    return HeadPass(int(numbers[0][:6]) if numbers else 0, DIRECTIONS[ways[0]], meanings.pop() if meanings else "")


def _is_way(token: str) -> bool:
    return token in DIRECTIONS and token[0] not in "0123456789"


def pass_of_text(text: str) -> bool:
    """Whether a cell names a pass, or one way alone."""
    return pass_of(head_cell(text)) is not None


def names_run(text: str) -> bool:
    """Whether a cell names a pass without its way: "Run 3 [um]", "4"."""
    return run_of(head_cell(text)) > 0


def run_of(cell: HeadCell) -> int:
    """The number of a pass whose way the cell does not say, 0 where it names none."""
    tokens = [part for token in _TOKEN.findall(cell.words) for part in _chinese(token)]
    numbers = [token for token in tokens if token[0] in "0123456789"]
    others = {token for token in tokens if token[0] not in "0123456789"}
    return int(numbers[0][:6]) if len(numbers) == 1 and others <= _BESIDE else 0


def is_way_or_unit(text: str) -> bool:
    """Whether a cell is nothing but a direction, or a unit, in brackets or not."""
    plain = text.strip().lower().strip("[]()（）").strip()
    return plain in DIRECTIONS or bool(unit_named(plain))


def way_in(text: str) -> str:
    """ "up" or "down" where a line above a table names one way in words, "" where it names none, or both."""
    ways = {DIRECTIONS[token] for token in _TOKEN.findall(text.lower()) if len(token) > 1 and token in DIRECTIONS}
    return ("up", "down")[ways.pop()] if len(ways) == 1 else ""


def is_index(cell: HeadCell) -> bool:
    """Whether a column only counts the rows, or is empty."""
    return cell.words in _INDEX


def is_statistic(text: str) -> bool:
    """Whether a cell names a figure that was worked out of readings: a mean, a spread, a largest one."""
    tokens = _TOKEN.findall(head_cell(text).words.replace("x\u0304", "mean"))
    return bool(tokens) and tokens[0] in STATISTICS


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
        if found and (unit := unit_named(found[1])):
            mark = found[1].strip()
            return text[: found.start()].strip(), mark if mark in INCH_OR_ARCSEC else unit
    found = _BRACKET.search(text)
    # What stands in brackets and is no unit we know is said, not lost: whoever reads it refuses it.
    return (text[: found.start()].strip(), found[1]) if found else (text, "")


def _meaning(words: str) -> Meaning:
    if words in _KNOWN:
        return _KNOWN[words]
    for end in _ENDS:
        if words.endswith(end) and (found := _KNOWN.get(words.removesuffix(end).strip())) in ("target", "position"):
            return found
    return ""
