"""The control's own lists: words of the language, machine and setting data, system variables, groups of G commands.

``dictionary.json`` holds names, numbers, types and index counts; its licence is the text file next to it.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources

_TYPES = {"DOUBLE": "REAL", "DWORD": "INT", "UDWORD": "INT", "BYTE": "INT", "UBYTE": "INT", "BOOLEAN": "BOOL"}
_PRINTED = {"Keywords": ("PROC",)}  # what the manuals print and the list lacks
_AXIAL = ("$MA_", "$SA_")  # their axis is one index more than the list counts


@dataclass(frozen=True)
class Datum:
    """A machine datum, setting datum or system variable: language type, number of indices, its number or None."""

    type: str
    indices: int
    number: int | None


@dataclass(frozen=True)
class Dictionary:
    """Data by name (with $), and the words of the language by class."""

    data: Mapping[str, Datum]
    words: Mapping[str, frozenset[str]]

    @functools.cached_property
    def reserved(self) -> frozenset[str]:
        """Every word that the language keeps for itself."""
        return frozenset().union(*self.words.values()) | {name for name in self.data if not name.startswith("$")}

    @functools.cached_property
    def functions(self) -> frozenset[str]:
        """Words that return a value."""
        return self.words["Functions"]

    @functools.cached_property
    def procedures(self) -> frozenset[str]:
        """Words that are called for what they do, the maker's cycles among them."""
        return self.words["Procedures"] | self.words["Cycles"] | self.words["Proc Attributes"]

    @functools.cached_property
    def commands(self) -> frozenset[str]:
        """G commands, with number or with a name."""
        return self.words["Commands"]

    @functools.cached_property
    def addresses(self) -> frozenset[str]:
        """Words that take a value behind an equals sign."""
        return self.words["Address"]

    @functools.cached_property
    def keywords(self) -> frozenset[str]:
        """Words that stand at the head of a statement."""
        return self.words["Keywords"]


@functools.cache
def dictionary() -> Dictionary:
    """Read the package's list, once."""
    raw = json.loads(resources.files(__package__).joinpath("dictionary.json").read_text(encoding="utf-8"))
    data: dict[str, Datum] = {}
    for part in ("machine_data", "setting_data", "variables"):
        data.update({name: _datum(name, entry) for name, entry in raw[part].items()})
    return Dictionary(data, {name: _words(name, listed) for name, listed in raw["words"].items()})


def _datum(name: str, entry: Mapping[str, object]) -> Datum:
    kind = str(entry["type"])
    number = entry.get("number")
    count = int(str(entry["indices"])) + name.startswith(_AXIAL)
    return Datum(_TYPES.get(kind, kind), count, None if number is None else int(str(number)))


def _words(name: str, listed: list[str]) -> frozenset[str]:
    """Headings of the list (Address, Command) stand in mixed case and are no words."""
    return frozenset(word for word in listed if word == word.upper()) | frozenset(_PRINTED.get(name, ()))


# The groups of G commands, as the manuals' list prints them: one of each group in a block.

_PRINTED_GROUPS = {
    1: "G0 G1 G2 G3 CIP ASPLINE BSPLINE CSPLINE POLY G33 G331 G332 OEMIPO1 OEMIPO2 CT G34 G35 INVCW INVCCW G335 G336",
    2: "G4 G63 G74 G75 REPOSL REPOSQ REPOSH REPOSA REPOSQA REPOSHA G147 G247 G347 G148 G248 G348 G5 G7",
    3: "TRANS ROT SCALE MIRROR ATRANS AROT ASCALE AMIRROR G25 G26 G110 G111 G112 G58 G59 ROTS AROTS",
    4: "STARTFIFO STOPFIFO FIFOCTRL",
    6: "G17 G18 G19",
    7: "G40 G41 G42",
    8: "G500 G54 G55 G56 G57 " + " ".join(f"G{number}" for number in range(505, 600)),
    9: "G53 SUPA G153",
    10: "G60 G64 G641 G642 G643 G644 G645",
    11: "G9",
    12: "G601 G602 G603",
    13: "G70 G71 G700 G710",
    14: "G90 G91",
    15: "G93 G94 G95 G96 G97 G931 G961 G971 G942 G952 G962 G972 G973",
    16: "CFC CFTCP CFIN",
    17: "NORM KONT KONTT KONTC",
    18: "G450 G451",
    19: "BNAT BTAN BAUTO",
    20: "ENAT ETAN EAUTO",
    21: "BRISK SOFT DRIVE",
    22: "CUT2D CUT2DF CUT3DC CUT3DF CUT3DFS CUT3DFF CUT3DCC CUT3DCCD",
    23: "CDOF CDON CDOF2",
    24: "FFWOF FFWON",
    25: "ORIWKS ORIMKS",
    26: "RMB RMI RME RMN",
    27: "ORIC ORID",
    28: "WALIMON WALIMOF",
    29: "DIAMOF DIAMON DIAM90 DIAMCYCOF",
    30: "COMPOF COMPON COMPCURV COMPCAD",
    33: "FTOCOF FTOCON",
    35: "SPOF SON PON SONS PONS",
    36: "PDELAYON PDELAYOF",
    37: "FNORM FLIN FCUB",
    38: "SPIF1 SPIF2",
    39: "CPRECOF CPRECON",
    40: "CUTCONOF CUTCONON",
    41: "LFOF LFON",
    42: "TCOABS TCOFR TCOFRZ TCOFRY TCOFRX",
    43: "G140 G141 G142 G143",
    44: "G340 G341",
    45: "SPATH UPATH",
    46: "LFTXT LFWP LFPOS",
    47: "G290 G291",
    48: "G460 G461 G462",
    49: "CP PTP PTPG0",
    52: "PAROTOF PAROT",
    57: "FENDNORM G62 G621",
    59: "DYNNORM DYNPOS DYNROUGH DYNSEMIFIN DYNFINISH",
    60: " ".join(f"WALCS{number}" for number in range(11)),
}

GROUP_OF: Mapping[str, int] = {word: group for group, listed in _PRINTED_GROUPS.items() for word in listed.split()}
