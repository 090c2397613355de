"""The ENVIRONMENT section of a vendor file: two values a key, at the start and at the end of the capture."""

from __future__ import annotations

from drivers.errors import FileFormatError
from drivers.files.numbers import decimal, uses_comma
from drivers.files.rtltext import lookup
from drivers.message import Message, Quantity
from drivers.types.sensing import Ambient

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
Found = tuple[Ambient, Ambient, float | None, list[Message]]


def environment(keys: dict[str, str], where: str) -> Found:
    """Ambient at start and end, expansion coefficient in ppm/K, warnings. Missing keys are unknown (None).

    Raises FileFormatError (E-FILE-VALUE) for a value that is no pair of numbers.
    """
    if not keys:
        return Ambient(), Ambient(), None, [Message.of("S-FILE-NO-ENVIRONMENT")]
    air = _temperature(_pair(keys, "Air temp", where))
    pressure, doubts = _pressure(_pair(keys, "Air press", where))
    humidity = _pair(keys, "Air humid", where)
    material = [_temperature(_pair(keys, f"Mat temp {number}", where)) for number in (1, 2, 3)]
    expansion = _pair(keys, "Exp coeff", where)
    if expansion[0] != expansion[1]:
        doubts.append(Message.of("S-FILE-EXPANSION"))
    ends = [Ambient(air[end], pressure[end], humidity[end], tuple(_known(material, end))) for end in (0, 1)]
    return ends[0], ends[1], expansion[0], doubts


def environment_words(start: Ambient, end: Ambient, expansion_ppm_per_k: float | None) -> dict[str, str]:
    """The keys of an ENVIRONMENT section from known readings; the inverse of `environment`. Empty if none is known."""
    found: dict[str, str] = {}
    for key, first, last in (
        ("Air temp", start.air_degc, end.air_degc),
        ("Air press", _kpa(start.pressure_hpa), _kpa(end.pressure_hpa)),
        ("Air humid", start.humidity_pct, end.humidity_pct),
        *_materials(start, end),
        ("Exp coeff", expansion_ppm_per_k, expansion_ppm_per_k),
    ):
        if first is not None or last is not None:
            pair = [value for value in (first, last) if value is not None]
            found[key] = f"{pair[0]:.6f} {pair[-1]:.6f} {int(key == 'Air press')}"
    return found


def _kpa(pressure_hpa: float | None) -> float | None:
    return None if pressure_hpa is None else pressure_hpa / HPA_PER_KPA


def _materials(start: Ambient, end: Ambient) -> list[tuple[str, float | None, float | None]]:
    """Up to three sensors; one that is not connected reads -10 in such a file."""
    count = min(max(len(start.material_degc), len(end.material_degc)), 3)
    if not count:
        return []
    found: list[tuple[str, float | None, float | None]] = []
    for index in range(3):
        pair = [one.material_degc[index] for one in (start, end) if index < len(one.material_degc)]
        first, last = (pair[0], pair[-1]) if pair else (NOT_CONNECTED_DEGC, NOT_CONNECTED_DEGC)
        found.append((f"Mat temp {index + 1}", first, last))
    return found


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


def _pressure(pair: Pair) -> tuple[Pair, list[Message]]:
    given = [value for value in pair if value is not None]
    if not given:
        return (None, None), []
    if all(HPA_LIMITS[0] <= value <= HPA_LIMITS[1] for value in given):
        return pair, [Message.of("S-FILE-HPA")]
    if not all(KPA_LIMITS[0] <= value <= KPA_LIMITS[1] for value in given):
        return (None, None), [Message.of("S-FILE-KPA", value=Quantity(given[0]))]
    first, second = (None if value is None else value * HPA_PER_KPA for value in pair)
    return (first, second), []
