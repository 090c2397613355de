"""Lines around a table that say how its numbers are to be understood: a factor, a zero, a turned sign; pure.

Nothing of it is applied silently, and nothing is passed over: a line that may concern the readings is named, and a
person says what it means. A factor of 1 and an offset of 0 say nothing.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from typing import Literal, NamedTuple

from drivers.types.doubts import Doubt
from drivers.units import unit_named

Concern = Literal["factor", "zero", "sign", "unit", "raw"]
"""What a line may change of the readings."""
CODES: Mapping[Concern, str] = {
    "factor": "S-READ-FACTOR",
    "zero": "S-READ-ZERO",
    "sign": "S-READ-SIGN",
    "raw": "S-READ-RAW",
    "unit": "S-READ-UNITS",
}
LONGEST, MOST_TOLD = 60, 3
MOST_ABOVE, MOST_BELOW = 100, 100
"""Lines of a text that are looked at, from its beginning and from its end."""
_BREAK = re.compile(r"\r\n|\n|\r")

_FACTORS = (
    "scale, scaling, scale factor, scaling factor, scalefactor, factor, multiplier, multiply by, multiply with, "
    "divisor, divider, divide by, gain, magnification, amplification, sensitivity, conversion, conversion factor, "
    "calibration factor, correction factor, unit factor, exponent, power of ten, "
    "faktor, skalierung, skalierungsfaktor, skalenfaktor, massstab, maßstab, multiplikator, teiler, verstärkung, "
    "vergrößerung, empfindlichkeit, umrechnung, umrechnungsfaktor, kalibrierfaktor, korrekturfaktor, "
    "facteur, facteur d'échelle, échelle, multiplicateur, diviseur, gain, sensibilité, "
    "fattore, fattore di scala, scala, moltiplicatore, divisore, guadagno, "
    "escala, factor de escala, multiplicador, ganancia, współczynnik, skala, mnożnik, "
    "масштаб, множитель, коэффициент, делитель, 比例, 比例因子, 系数, 倍数, 倍率, 缩放, 因子, 增益, 换算系数"
)
_ZEROS = (
    "offset, zero offset, zero point offset, datum offset, preset, bias, shift, zero shift, reading offset, "
    "position offset, nullpunktverschiebung, nullpunktversatz, versatz, verschiebung, décalage, scostamento di zero, "
    "desplazamiento, przesunięcie, смещение, 偏移, 零点偏移, 零偏"
)
_SIGNS = (
    "sign, polarity, sense, inverted, invert, reversed sign, sign convention, sign reversed, vorzeichen, polarität, "
    "invertiert, signe, inversé, segno, invertito, signo, invertido, znak, знак, 符号, 极性, 取反"
)
_BESIDE = (
    "data, readings, reading, values, value, deviation, deviations, error, errors, y, werte, messwerte, abweichung, "
    "abweichungen, mesures, valeurs, letture, lecturas, 数据, 读数, 偏差"
)
_WHAT = ("", *_BESIDE.split(", "))


def _named(words: str) -> frozenset[str]:
    return frozenset(f"{front} {word}".strip() for word in words.split(", ") for front in _WHAT) | frozenset(
        f"{word} {behind}".strip() for word in words.split(", ") for behind in _WHAT
    )


_WORDS: tuple[tuple[str, Concern], ...] = ((_SIGNS, "sign"), (_ZEROS, "zero"), (_FACTORS, "factor"))
_KEYS: dict[str, Concern] = {word: concern for words, concern in _WORDS for word in _named(words)}
_NUMBER = r"[+-]?\d*[.,]?\d+(?:\s?(?:e|\*?\s?10\s?(?:\^|\*\*))\s?[+-]?\d+)?"
_PAIR = re.compile(r"\s*\"?([^:=;,\t|\"]{2,40}?)\"?\s*(?:[:=;,\t|]|\s(?=[+-]?[\d.,]))\s*\"?(\S.*?)[\s\";,|\t]*\Z")
_VALUE = re.compile(rf"(?:[x×*÷/]|by|with|durch|mit|mal)?\s*({_NUMBER}(?:\s?[/:]\s?{_NUMBER})?)\s*([^\d\s].*)?\Z")
_TURNED = re.compile(
    r"(?:-|−|neg\w*|minus|invert\w*|revers\w*|flip\w*|yes|true|on|ja|oui|s[ií]|target\s*[-−]\s*\w+|nominal\s*[-−]\s*\w+"
    r"|umgekehrt|invers\w*|是|反|负)\Z"
)
_POWER = r"(?:10+|10\s?(?:\^|\*\*)\s?[+-]?\d+|0[.,]\d*[1-9]\d*|1\s?/\s?\d{2,}|\d+(?:[.,]\d+)?e[+-]?\d+)"
_SMALL = r"(?:10\s?(?:\^|\*\*)\s?-\s?\d+|0[.,]\d*[1-9]\d*|1\s?/\s?\d{2,}|\d+(?:[.,]\d+)?e-\d+)"
_UNIT = r"(?P<unit>[^\W\d]+\b|[\"'′″])(?!\s*(?:step|schritt|interval|pas\b|pitch))"
_SPOKEN: tuple[tuple[str, Concern], ...] = (
    # "x10", "× 0.1", "*1000": not "10 x 10 mm".
    (rf"(?<![\d\w])(?<!\d )[x×*÷]\s?{_POWER}(?![\d.,\w])", "factor"),
    (r"\b(?:divided?|dividing|multipl(?:y|ied)|scaled\s+by|teilen|geteilt|dividier\w*|multiplizier\w*|skalier\w*"
     r"|divis\w*|multipli\w*|divid\w*|diviser|moltiplic\w*)\b[^\n]*\d", "factor"),
    (r"(?:除以|乘以|放大|缩小)\s*\d", "factor"),
    # "values in 0.1 um", "unit: 1/10 µm", "1 digit = 0.1 um"
    (rf"\b(?:in|of|en)\s+{_SMALL}\s*{_UNIT}", "factor"),
    (rf"(?:\bunits?|\beinheit(?:en)?|\bunités?|单位)\s*(?:[:=：]|of|von|de)?\s*{_POWER}\s*{_UNIT}", "factor"),
    (r"\b(?:factor|faktor|facteur|fattore)\s+(?:of\s+|von\s+|de\s+|di\s+)?\d|\b(?:mal|times)\s+\d", "factor"),
    (rf"\b(?:counts?|digits?|div(?:isions?)?|lsb|inc(?:rements?)?|inkremente?|pulses?|ticks?|skt|scale)\b\s*=\s*"
     rf"{_NUMBER}", "factor"),
    (r"\b(?:tenths?|hundredths?|thousandths?|thous?|zehntel\w*|hundertstel\w*|tausendstel\w*|dixièmes?|centièmes?"
     r"|millièmes?)\b", "factor"),
    (r"\b(?:sign|signs|vorzeichen|signe|segno|signo)\b[^\n]*\b(?:invert\w*|revers\w*|chang\w*|negat\w*|flip\w*"
     r"|umgekehrt\w*|vertauscht\w*)", "sign"),
    # Everywhere a deviation is measured minus target.
    (r"\b(?:target|nominal|command(?:ed)?|setpoint|soll\w*|set)(?:\s+\w+)?\s*(?:[-−–]|\bminus\b)\s*(?:measured|actual|act"
     r"|reading|laser|position|ist\w*|mess\w*)", "sign"),
    (r"\b(?:doubled|halved|half values?|double values?|double deviations?|verdoppelte?"
     r"|halbierte?|doppelte werte|halbe werte)\b"
     r"|\b(?:readings?|values?|deviations?|errors?|data|werte|messwerte)\s+[x×*]\s?\d", "factor"),
    # Figures suppose readings that the instrument corrected.
    (r"\b(?:expansion|thermal|temperature|material|air|environment\w*|refracti\w*|wavelength)\b[^\n]*"
     r"\b(?:not|un|without)[ -]?(?:been )?(?:correct|compensat|applied)\w*"
     r"|\b(?:not|un)[ -]?(?:correct|compensat)ed for\b"
     r"|\bwithout (?:air|material|expansion|temperature|thermal|environment\w*)\b"
     r"|\bohne \w*kompensation\b|\bnicht (?:kompensiert|korrigiert)\b|\bnon (?:compensé|corrigé)|未补偿|未修正", "raw"),
    (r"(?:subtract|deduct|add)(?:ed)?\b[^\n]*\d", "zero"),
)  # fmt: skip
_IN_UNIT = re.compile(
    r"\b(?:(?P<own>deviations?|errors?|readings?|abweichung(?:en)?|fehler|messwerte?|écarts?)"
    r"|(?:values?|data|werte|valeurs)|(?P<every>all (?:values|data)|alle werte))"
    r"\s+(?:are\s+|is\s+|sind\s+)?(?:given\s+)?(?:in|en)\s+(?P<unit>[^\W\d]+|[\"″])\.?\Z"
)
_PHRASES = tuple((re.compile(pattern), concern) for pattern, concern in _SPOKEN)


class Statement(NamedTuple):
    """A line that may change what the readings of a table mean: its number, its words and what they may change."""

    line: int
    text: str
    concern: Concern


def statements_of(lines: Iterable[tuple[int, str]]) -> tuple[Statement, ...]:
    """Every line (number, text) around a table that says more than nothing about factor, zero or sign of readings."""
    found = []
    for at, line in lines:
        plain = " ".join(line.strip(" #;,\t|").lower().split())
        concern = _concern(plain) if plain else None
        if concern is not None:
            found.append(Statement(at, " ".join(line.strip(" #;,\t|").split())[:LONGEST], concern))
    return tuple(found)


def remarks(
    lines: Iterable[tuple[int, str]],
    where: str,
    *,
    settled: Collection[Concern] = (),
    units: tuple[str, str] = ("", ""),
    confirmed: bool = False,
) -> tuple[Doubt, ...]:
    """A doubt for each thing that lines around a table may change, and that nobody ``settled``.

    It blocks, but for readings that were not corrected for air or expansion. ``units`` are those of targets and
    readings, "" where they are not known.
    """
    every = list(lines)
    found: dict[Concern, list[Statement]] = {}
    for one in statements_of(every):
        found.setdefault(one.concern, []).append(one)
    for at, line in every if units[1] else ():
        named = _IN_UNIT.search(" ".join(line.strip(" #;,\t|").lower().split()))
        unit = unit_named(named["unit"]) if named else ""
        if named and unit and unit not in (units[1:] if named["own"] or named["every"] else units):
            found.setdefault("unit", []).append(Statement(at, line.strip()[:LONGEST], "unit"))
    return tuple(
        Doubt(
            CODES[concern],
            where,
            blocking=not confirmed and concern != "raw",
            names={"found": ", ".join(units), "stated": "; ".join(map(_told, own[:MOST_TOLD]))},
        )
        for concern, own in found.items()
        if concern not in settled
    )


def _told(one: Statement) -> str:
    return f"{one.text!r} (line {one.line})" if one.line else repr(one.text)


def lines_above(text: str, at: int) -> list[tuple[int, str]]:
    """The numbered lines above line ``at``, as many as are looked at."""
    return list(enumerate(_BREAK.split(text, min(at, MOST_ABOVE))[: min(at - 1, MOST_ABOVE)], start=1))


def lines_around(text: str, own: Collection[int]) -> list[tuple[int, str]]:
    """The first and the last lines of a text without those of its table (``own``)."""
    every = list(enumerate(_BREAK.split(text), start=1))
    near = every if len(every) <= MOST_ABOVE + MOST_BELOW else every[:MOST_ABOVE] + every[-MOST_BELOW:]
    return [(at, line) for at, line in near if at not in own]


def _concern(line: str) -> Concern | None:
    pair = _PAIR.match(line)
    if pair is not None:
        key = re.sub(r"\s*[\[(（].*?[\])）]\s*", " ", pair[1].replace("_", " ").replace("-", " "))
        known = _KEYS.get(" ".join(key.split()).strip(" .#"))
        if known is not None and (_says(pair[2], known) or _VALUE.match(pair[2])):
            return known if _says(pair[2], known) else None
    for phrase, concern in _PHRASES:
        found = phrase.search(line)
        if found and ("unit" not in phrase.groupindex or unit_named(found["unit"])):
            return concern
    return None


def _says(value: str, concern: Concern) -> bool:
    """Whether a value changes anything: a factor other than 1, an offset other than 0, a turned sign."""
    plain = value.strip(" .;\"'()[]")
    found = _VALUE.match(plain)
    if found is None:
        return concern == "sign" and _TURNED.match(plain) is not None
    number = _number(found[1])
    if number is None or concern == "zero":
        return number != 0.0
    if concern == "sign":
        return number < 0.0
    return number != 1.0 or bool(unit_named((found[2] or "").strip()))


def _number(text: str) -> float | None:
    """The number, of a quotient too; None where it is none that can be compared."""
    parts = [part.strip().replace(",", ".").replace(" ", "") for part in re.split(r"[/:]", text)]
    try:
        first, *rest = (float(re.sub(r"\*?10(?:\^|\*\*)", "e", part)) if "^" in part else float(part) for part in parts)
        return first / rest[0] if rest else first
    except (ValueError, ZeroDivisionError):
        return None
