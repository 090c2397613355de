"""Labels and the jumps to them: there, in the right direction, not into a structure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from drivers.sinumerik.legality.findings import Finding, Illegal, finding
from drivers.sinumerik.legality.statements import Jump
from drivers.sinumerik.legality.structures import Path

Places = Mapping[str, Sequence[tuple[int, Path]]]  # label: the lines where it stands, and what is open there


@dataclass(frozen=True)
class Departure:
    """A jump with its line and the structures that are open there."""

    line: int
    path: Path
    jump: Jump


def judge(departures: Sequence[Departure], places: Places) -> Iterator[Finding]:
    """Everything wrong with these jumps."""
    for departure in departures:
        wrong = _judge(departure, places.get(departure.jump.target, ()))
        if wrong is not None:
            yield finding(departure.line, wrong)


def _judge(departure: Departure, there: Sequence[tuple[int, Path]]) -> Illegal | None:
    word, target = departure.jump
    if not there:
        return None if word == "GOTOC" else Illegal("E-LEGAL-LABEL", word=word, label=target)
    reached = [(line, path) for line, path in there if _ahead(word, departure.line, line)]
    if not reached:
        return Illegal("E-LEGAL-DIRECTION", word=word, label=target, line=there[0][0])
    if all(path != departure.path[: len(path)] for _, path in reached):
        return Illegal("E-LEGAL-INTO", word=word, label=target, structure=reached[0][1][-1].word)
    return None


def _ahead(word: str, here: int, there: int) -> bool:
    """GOTOF looks below, GOTOB above (its own block included), every other word everywhere."""
    if word == "GOTOF":
        return there > here
    return word != "GOTOB" or there <= here
