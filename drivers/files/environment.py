"""The ENVIRONMENT section of a vendor file: two values a key, at the start and at the end of the capture."""

from __future__ import annotations

from drivers.errors import FileFormatError
from drivers.files.numbers import decimal, uses_comma
from drivers.files.rtltext import lookup
from drivers.types import Ambient

KEYS = (
    "Air temp",
    "Air press",
    "Air humid",
    "Mat temp 1",
    "Mat temp 2",
    "Mat temp 3",
    "Env factor",
    "Exp coeff",
    "Date Time",
    "Final Data",
)
NOT_CONNECTED_DEGC = -10.0
HPA_PER_KPA = 10.0
# The file's pressure is in kPa (its Env factor proves it); what reads like a barometer in hPa is taken so.
KPA_LIMITS, HPA_LIMITS = (50.0, 120.0), (500.0, 1200.0)

Pair = tuple[float | None, float | None]
Found = tuple[Ambient, Ambient, float | None, list[str]]


def environment(keys: dict[str, str], where: str) -> Found:
    """Ambient at start and end, expansion coefficient in ppm/K, warnings. Missing keys are unknown (None).

    Raises FileFormatError (E-FILE-VALUE) for a value that is no pair of numbers.
    """
    if not keys:
        return Ambient(), Ambient(), None, ["no ENVIRONMENT: temperatures and pressure are unknown"]
    air = _temperature(_pair(keys, "Air temp", where))
    pressure, doubts = _pressure(_pair(keys, "Air press", where))
    humidity = _pair(keys, "Air humid", where)
    material = [_temperature(_pair(keys, f"Mat temp {number}", where)) for number in (1, 2, 3)]
    expansion = _pair(keys, "Exp coeff", where)
    if expansion[0] != expansion[1]:
        doubts.append("the expansion coefficient was changed during the capture; its first value is used")
    ends = [Ambient(air[end], pressure[end], humidity[end], tuple(_known(material, end))) for end in (0, 1)]
    return ends[0], ends[1], expansion[0], doubts


def _known(material: list[Pair], end: int) -> list[float]:
    return [value for pair in material if (value := pair[end]) is not None]


def _pair(keys: dict[str, str], key: str, where: str) -> Pair:
    text = lookup(keys, key)
    if text is None or not text:
        return None, None
    comma = uses_comma(text)
    values = [decimal(token, comma=comma) for token in text.split()[:2]]
    if len(values) != 2 or None in values:
        raise FileFormatError("E-FILE-VALUE", where, key=key, value=text)
    return values[0], values[1]


def _temperature(pair: Pair) -> Pair:
    first, second = (None if value == NOT_CONNECTED_DEGC else value for value in pair)
    return first, second


def _pressure(pair: Pair) -> tuple[Pair, list[str]]:
    given = [value for value in pair if value is not None]
    if not given:
        return (None, None), []
    if all(HPA_LIMITS[0] <= value <= HPA_LIMITS[1] for value in given):
        return pair, ["air pressure reads like hPa, not like kPa, and was taken so"]
    if not all(KPA_LIMITS[0] <= value <= KPA_LIMITS[1] for value in given):
        return (None, None), [f"air pressure {given[0]:g} is no air pressure in kPa; it was left out"]
    first, second = (None if value is None else value * HPA_PER_KPA for value in pair)
    return (first, second), []
