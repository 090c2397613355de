"""Gear data exchange, GDE (VDI/VDE 2610), as far as public knowledge goes.

Public: it is XML, versions 2.5 and 3.4 are met, main parts exist, ``datum_face`` decides which flank is left.
Not public: the schema. So nothing of its names is supposed: which element is a point and where its numbers stand
is declared by the user (`GdeNames`) from the guideline he owns, and remembered outside.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError, FileFormatError
from drivers.files.gear import PointMap, Touch, inspection, touch, wrong_line
from drivers.files.numbers import decimal
from drivers.files.safexml import Element, read_elements
from drivers.files.text import read_bytes
from drivers.message import Message
from drivers.types.gears import GearInspection

DATUM_FACE = "datum_face"
MOST_NAMES = 40
AS_TABLE = Message.of("W-GEARFILE-EXPORT")
BALLBAR = (
    Message.of("W-GEARFILE-BALLBAR"),
    Message.of("W-GEARFILE-BALLBAR-DO"),
)
OTHERS = {
    "ballbar": (
        Message.of("W-GEARFILE-BALLBAR"),
        Message.of("W-GEARFILE-BALLBAR-DO"),
    ),
    "b5r": (
        Message.of("W-GEARFILE-BALLBAR"),
        Message.of("W-GEARFILE-BALLBAR-DO"),
    ),
    "qif": (Message.of("W-GEARFILE-QIF"), AS_TABLE),
    "calibrationcertificate": (
        Message.of("W-GEARFILE-DCC"),
        Message.of("W-GEARFILE-DCC-DO", table=AS_TABLE),
    ),
    "workbook": (Message.of("W-GEARFILE-XML-BOOK"), Message.of("W-GEARFILE-SAVE-XLSX")),
    "svg": (Message.of("W-GEARFILE-PICTURE"), Message.of("W-GEARFILE-CHOOSE")),
    "html": (Message.of("W-GEARFILE-WEB"), Message.of("W-GEARFILE-CHOOSE")),
}
UNKNOWN = (
    Message.of("W-GEARFILE-NO-KIND"),
    Message.of("W-GEARFILE-IF-GDE", table=AS_TABLE),
)


@dataclass(frozen=True, slots=True)
class GdeNames(PointMap):
    """Where a point's numbers stand: "@name" an attribute, "name" a child element, of the point or of what it is in.

    ``point`` is the element of one point; or ``triples`` that of a list of numbers x y z x y z ...
    """

    point: str = ""
    triples: str = ""
    x: str = "x"
    y: str = "y"
    z: str = "z"
    space: str = ""
    flank: str = ""
    deviation: str = ""

    def limits(self) -> Iterable[tuple[str, bool, str | Message]]:
        """See `PointMap.limits`."""
        return (
            *PointMap.limits(self),
            ("point", bool(self.point) != bool(self.triples), Message.of("W-GEARFILE-POINT-TRIPLES")),
            ("space", bool(self.space), Message.of("W-GEARFILE-WHERE-SPACE")),
            ("flank", bool(self.flank), Message.of("W-GEARFILE-WHERE-SIDE")),
            ("deviation", not (self.triples and self.deviation), Message.of("W-GEARFILE-TRIPLES-NO-DEV")),
        )


@dataclass(frozen=True, slots=True)
class GdeSurvey:
    """What was found in a file without knowing its schema."""

    root: str
    version: str
    parts: tuple[str, ...]
    datum_face: str
    names: Mapping[str, int]


class GdeFormat:
    """Gear file driver "gde": measured points by declared names."""

    def __init__(self, columns: Mapping[str, Any] | None = None) -> None:
        self._names = GdeNames.read(columns, "gde") if columns is not None else None

    def signature(self, path: Path) -> str:
        """Files of one program share root, version and main parts."""
        found = survey(read_bytes(path), str(path))
        return f"gde {found.root} {found.version} {' '.join(sorted(set(found.parts)))}"

    def read(self, path: Path) -> GearInspection:
        """Read a file. Raises ConfigError (E-FILE-GDE-MAP: what was found) without names, FileFormatError."""
        data, where = read_bytes(path), str(path)
        return read_gde(data, self._names, where)


def survey(data: bytes, where: str) -> GdeSurvey:
    """Root, version, main parts, datum_face and how often each element occurs; pure. Raises FileFormatError."""
    names: Counter[str] = Counter()
    parts: list[str] = []
    faces: list[str] = []
    root: list[Element] = []

    def ended(element: Element, above: list[Element]) -> None:
        names[element.name] += 1
        faces.extend(_faces(element))
        if len(above) == 1:
            parts.append(element.name)
        if not above:
            root.append(element)

    read_elements(data, ended, where)
    first = root[0]
    version = next((value for key, value in first.attributes.items() if "version" in key.lower()), "")
    version = version or next((text for key, text in first.children.items() if "version" in key.lower()), "")
    return GdeSurvey(
        root=first.name,
        version=version,
        parts=tuple(parts),
        datum_face=" ".join(dict.fromkeys(faces)),
        names=dict(names),
    )


def _faces(element: Element) -> list[str]:
    wanted = [value for key, value in element.attributes.items() if _is_face(key)]
    return [*wanted, "".join(element.text).strip()] if _is_face(element.name) else wanted


def _is_face(name: str) -> bool:
    return name.lower().replace("-", "_") in (DATUM_FACE, DATUM_FACE.replace("_", ""))


def read_gde(data: bytes, names: GdeNames | None, where: str) -> GearInspection:
    """Measured points, pure. Raises what `GdeFormat.read` raises."""
    seen = survey(data, where)
    parts = ", ".join(dict.fromkeys(seen.parts))
    if names is None:
        _refuse_others(seen, where)
        listed = ", ".join(f"{name} ({count})" for name, count in list(seen.names.items())[:MOST_NAMES])
        raise ConfigError("E-FILE-GDE-MAP", where, version=seen.version or "not said", parts=parts, names=listed)
    wanted = names.point or names.triples
    if wanted not in seen.names:
        raise FileFormatError("E-FILE-GDE-NAME", where, name=wanted, known=", ".join(list(seen.names)[:MOST_NAMES]))
    touches: list[Touch] = []
    beside: dict[str, None] = {}

    def ended(element: Element, above: list[Element]) -> None:
        if wanted in element.children:
            beside.update(dict.fromkeys(name for name in element.children if name != wanted))
        if element.name == wanted:
            touches.extend(_touches(element, above, names, where))

    read_elements(data, ended, where)
    face = seen.datum_face
    side = Message.of("S-FILE-GDE-SIDE", said=face) if face else Message.of("S-FILE-GDE-NO-SIDE")
    header = {"Format": "GDE (VDI/VDE 2610)", "Version": seen.version, "Parts": parts}
    header |= {"Datum face": seen.datum_face}
    more = (Message.of("S-FILE-GDE-NEXT", names=tuple(beside)),) if beside else ()
    return inspection(touches, names, where, warnings=(side, *more), header=header)


def _refuse_others(seen: GdeSurvey, where: str) -> None:
    """Raise FileFormatError (E-FILE-XML-OTHER) where nothing of an XML file is of gears: it says what it may be."""
    root = seen.root.lower()
    if "gde" in root or seen.datum_face or any("gear" in name.lower() for name in seen.names):
        return
    guess, advice = next((told for word, told in OTHERS.items() if word in root), UNKNOWN)
    raise FileFormatError("E-FILE-XML-OTHER", where, root=seen.root, guess=guess, advice=advice)


def _touches(element: Element, above: list[Element], names: GdeNames, where: str) -> list[Touch]:
    chain = [element, *reversed(above)]
    space = _found(chain, names.space, element.line, where)
    flank = _found(chain, names.flank, element.line, where)
    if names.triples:
        numbers = [decimal(token) for token in "".join(element.text).split()]
        if len(numbers) % 3:
            raise wrong_line(where, element.line, Message.of("W-GEARFILE-NO-TRIPLES", count=len(numbers)))
        triples = [numbers[at : at + 3] for at in range(0, len(numbers), 3)]
        return [touch(space, flank, numbers=list(triple), at=element.line, where=where) for triple in triples]
    wanted = [names.x, names.y, names.z, *([names.deviation] if names.deviation else [])]
    found = [decimal(element.look_up(name) or "") for name in wanted]
    return [touch(space, flank, numbers=found, at=element.line, where=where)]


def _found(chain: list[Element], name: str, line: int, where: str) -> str:
    """The nearest value of that name, from the point outward."""
    value = next((value for element in chain if (value := element.look_up(name)) is not None), None)
    if value is None:
        raise wrong_line(where, line, Message.of("W-GEARFILE-NAME-NONE", name=name))
    return value
