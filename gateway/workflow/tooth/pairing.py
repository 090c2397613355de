"""Inspected discs from files: which two make a drive, in which tooth position, and what pairing is worth.

The gear file says which drive the discs are for. Every figure is predicted by the full model, not tested, and without
friction; u draws what the inspection may be wrong by, and pins, cranks and datum by their tolerances.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.message import Message, Quantity, fixed
from drivers.types.gears import GearInspection
from gateway.correct.outlook.drive_outlook import drawn_apart, drawn_flanks
from gateway.correct.part.inspected import USUAL_CLAMPING_UM, InspectionSource, inspected_flank, inspection_patterns
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.measured_points import Heights
from gateway.reducer.figures import Transmission, transmission, without_limit
from gateway.reducer.pairing import Matching, Pair, match
from gateway.reducer.records import Reducer
from gateway.reducer.uncertainty import Expected, uncertainty
from gateway.store import Value
from gateway.study.drive import reducer_of
from gateway.study.inputs import gear_of, load_gear
from gateway.tooth import InspectedFlank
from gateway.workflow.files.reading import ReadOptions, read_file

TRIALS = 30


@dataclass(frozen=True, slots=True)
class DiscFile:
    """How files of flank points are read: zero of their heights, columns where they are said, clamping (um, k = 2)."""

    heights: Heights = "lower-face"
    columns: Mapping[str, Value] | None = None
    clamping_um: float = USUAL_CLAMPING_UM


@dataclass(frozen=True, slots=True)
class MatchedPair:
    """One drive: its discs by their names, the tooth position and angle of the second, its figures, expected ones."""

    first: str
    second: str
    mark: int
    mark_deg: float
    figures: Transmission
    assembles: bool
    expected: Mapping[str, Expected] | None = None

    def as_data(self) -> dict[str, Any]:
        """Plain data, arcsec and deg."""
        plain: dict[str, Any] = {
            "first": self.first,
            "second": self.second,
            "mark": self.mark,
            "mark_deg": self.mark_deg,
            "transmission_arcsec": self.figures.error_arcsec,
            "rms_arcsec": self.figures.rms_arcsec,
            "lost_motion_arcsec": self.figures.lost_motion,
            "backlash_arcsec": self.figures.backlash,
            "stiffness_nm_arcmin": self.figures.stiffness_nm_arcmin,
            "interference_um": self.figures.interference_um,
            "assembles": self.assembles,
        }
        if self.expected is not None:
            plain["expected"] = {
                name: {"mean": one.mean, "u": one.u, "low": one.low, "high": one.high}
                for name, one in self.expected.items()
            }
        return plain


@dataclass(frozen=True, slots=True)
class MatchOutcome:
    """The discs as they were read, the pairing and each pair's figures."""

    drive: Reducer
    discs: tuple[InspectedFlank, ...]
    matching: Matching
    pairs: tuple[MatchedPair, ...]

    @property
    def lines(self) -> tuple[Message, ...]:
        """What pairing is worth, who is left over, which pairs cannot be built, what is not in the figures."""
        found = self.matching
        figures = {"worth": found.worth_arcsec, "mean": found.mean_arcsec, "come": found.as_they_come_arcsec}
        shown = {name: fixed(value) for name, value in figures.items()}
        left = ", ".join(self.discs[n].part for n in found.left_over)
        return (
            Message.of("S-MATCH-WORTH", name=self.drive.name, datum=self.drive.measured_from(), **shown),
            *((Message.of("S-MATCH-LEFT", names=left),) if left else ()),
            *(
                Message.of(
                    "W-MATCH-TIGHT",
                    first=pair.first,
                    second=pair.second,
                    mark=pair.mark,
                    interference=fixed(pair.figures.interference_um, 1),
                    limit=Quantity(self.drive.interference_um),
                )
                for pair in self.pairs
                if not pair.assembles
            ),
        )

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        found = self.matching
        return {
            "reducer": self.drive.name,
            "datum": self.drive.datum,
            "predicted_not_tested": True,
            "discs": [
                {
                    "name": one.part,
                    "rms_um": one.fitted.rms_um,
                    "rms_u_um": one.rms_u_um,
                    "said": [*map(str, one.said)],
                }
                for one in self.discs
            ],
            "pairs": [one.as_data() for one in self.pairs],
            "mean_arcsec": found.mean_arcsec,
            "as_they_come_arcsec": found.as_they_come_arcsec,
            "worth_arcsec": found.worth_arcsec,
            "left_over": [self.discs[n].part for n in found.left_over],
        }


def read_disc(path: Path, gear_path: Path, how: DiscFile) -> InspectedFlank:
    """One disc from a file of flank points; its name is the file's.

    Raises ConfigError (E-INSPECT-FILE, E-FILE-..., E-IMPORT-COLUMNS), FileFormatError, ModelError (E-INSPECT-...).
    """
    return disc_of_file(path, gear_of(load_gear(gear_path)), how)


def disc_of_file(path: Path, gear: CycloidGear, how: DiscFile) -> InspectedFlank:
    """As `read_disc`, for a gear that is known."""
    read = read_file(path, ReadOptions(columns=how.columns, gear=True))
    if not isinstance(read.content, GearInspection):
        raise ConfigError("E-INSPECT-FILE", str(path))
    about = InspectionSource(
        path.stem,
        path.name,
        clamping_um=how.clamping_um,
        heights=how.heights,
        said=read.notes,
    )
    return inspected_flank(gear, read.content, about)


def match_files(
    gear_path: Path,
    paths: Sequence[Path],
    how: DiscFile,
    *,
    marks: Sequence[int] | None = None,
    sure: bool = False,
) -> MatchOutcome:
    """Pair the discs of a gear file's drive; ``marks`` are the tooth positions of the second disc, all unless given.

    ``sure``: expected figures with u too, by Monte Carlo. Raises ConfigError (E-MATCH-REDUCER, E-MATCH-TWICE, and as
    `read_disc`), ModelError (E-MATCH-MARK, E-REDUCER-...).
    """
    file = load_gear(gear_path)
    if file.reducer is None:
        raise ConfigError("E-MATCH-REDUCER", str(gear_path), gear=file.name)
    gear = gear_of(file)
    drive = reducer_of(file.reducer, gear)
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise ConfigError("E-MATCH-TWICE", str(path))
        seen.add(path.resolve())
    for mark in marks or ():
        if not 0 <= mark < gear.zc:
            raise ModelError("E-MATCH-MARK", drive.name, mark=mark, last=gear.zc - 1)
    if len(paths) < len(drive.discs):  # before a file is read
        raise ModelError("E-REDUCER-MATCH", drive.name, given=len(paths), discs=len(drive.discs))
    discs = tuple(disc_of_file(path, gear, how) for path in paths)
    found = match(drive, [one.fitted for one in discs], marks=marks or None)
    pairs = tuple(_pair(drive, discs, pair, how if sure else None) for pair in found.pairs)
    return MatchOutcome(drive, discs, found, pairs)


def _pair(drive: Reducer, discs: Sequence[InspectedFlank], pair: Pair, how: DiscFile | None) -> MatchedPair:
    built = drive.with_marks((drive.discs[0].mark, pair.mark))
    parts = [discs[pair.first], discs[pair.second]]
    plain = [one.fitted for one in parts]
    expected = None
    if how is not None:
        draws = []
        for number, one in enumerate(parts):
            places, patterns = inspection_patterns(drive.gear, one, how.clamping_um)
            alone = [part if place == number else None for place, part in enumerate(plain)]
            draws.append(drawn_flanks(alone, places, patterns))
        expected = uncertainty(built, drawn_apart(plain, draws), most=TRIALS).figures
    angle = built.discs[1].mark_angle_deg(drive.gear.zc)
    return MatchedPair(
        first=parts[0].part,
        second=parts[1].part,
        mark=pair.mark,
        mark_deg=float(np.mod(angle, 360.0)),
        figures=transmission(without_limit(built), plain),
        assembles=pair.assembles,
        expected=expected,
    )
