"""Circular tests from files to figures: samples by columns, or a maker's own results; diagnosis in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers import registry
from drivers.types.circles import CircleRecord, MakersFigures
from gateway.errors import ModelError
from gateway.evaluate.geometry.ballbar import BallbarFigures, Cause, Circle, evaluate_ballbar, squareness_arcsec
from gateway.evaluate.geometry.straightness import Plane, of_plane
from gateway.workflow.files.kind_records import Drawn, Figure, KindAnswer

KIND = "ballbar"
STANDARD = "ISO 230-4:2005"
PLANES: Mapping[str, Plane] = {"XY": "XY", "YZ": "YZ", "ZX": "XZ"}
SENSES = {1: "ccw", -1: "cw"}
TOLD = 5
"""Causes that the diagnosis names."""
MAKERS = "the maker's own result figures: no evaluation of samples, which no public description tells how to read"
ONE_SENSE = "one sense alone cannot tell squareness from servo mismatch: their sum is stated; run the other sense too"


@dataclass(frozen=True, slots=True)
class CircleAnswer:
    """The answer of the kind, and what a picture needs; no ``figures`` of a maker's results."""

    answer: KindAnswer
    figures: BallbarFigures | None = None


def read_circle(path: Path, columns: Mapping[str, Any]) -> CircleRecord | MakersFigures:
    """A table of samples, or a maker's .b5r. Raises FileFormatError, ConfigError (E-FILE-MAP)."""
    drivers = registry.known("circle-file")
    if path.suffix.lower() == ".b5r":
        results: MakersFigures = drivers["b5r"].load()().read(path)
        return results
    record: CircleRecord = drivers["circle-csv"].load()(columns=columns).read(path)
    return record


def evaluate_circles(files: Sequence[tuple[str, CircleRecord | MakersFigures]]) -> CircleAnswer:
    """One circular test: a file with one sense or both, or two files with a sense each; or one maker's results.

    Raises ModelError (E-CIRCLE-FILES: two files that are not one test, E-CIRCLE-RADIUS and those of
    `evaluate_ballbar`).
    """
    makers = [(label, one) for label, one in files if isinstance(one, MakersFigures)]
    if makers:
        if len(files) > 1:
            raise ModelError("E-CIRCLE-FILES", files[1][0], why="a maker's results stand alone")
        return CircleAnswer(_of_maker(makers[0][1]))
    records = [(label, one) for label, one in files if isinstance(one, CircleRecord)]
    record = _join_senses(records)
    if record.radius_mm is None:
        raise ModelError("E-CIRCLE-RADIUS", records[0][0])
    found = evaluate_ballbar(
        Circle(
            angle_deg=record.angle_deg,
            radial_um=record.radial_um,
            sense=record.sense,
            radius_mm=record.radius_mm,
            feed_mm_min=record.feed_mm_min,
            pitch_mm=record.pitch_mm,
            calibrated=record.calibrated,
        )
    )
    figures = [Figure(name, value, "um", found.figures_U) for name, value in found.figures.items()]
    figures += [Figure(one.name, one.value, one.unit, one.U) for one in found.causes]
    figures += _location_error(found, record.plane)
    answer = KindAnswer(
        kind=KIND,
        standard=STANDARD,
        figures=tuple(figures),
        curves=tuple(Drawn(SENSES[sense], *path) for sense, path in found.paths.items()),
        axes=("angle  deg", "radial deviation  µm"),
        polar=True,
        notes=(*_notes(found, record), *map(str, record.warnings)),
    )
    return CircleAnswer(answer, found)


def _join_senses(files: Sequence[tuple[str, CircleRecord]]) -> CircleRecord:
    """Two files of one test as one. Raises ModelError (E-CIRCLE-FILES)."""
    first = files[0][1]
    if len(files) == 1:
        return first
    senses = [set(one.sense.tolist()) for _, one in files]
    if len(files) > 2 or senses[0] & senses[1]:
        raise ModelError("E-CIRCLE-FILES", files[1][0], why="two files hold one sense each, and opposite ones")
    second = files[1][1]
    for key in ("radius_mm", "feed_mm_min", "plane", "calibrated"):
        if getattr(first, key) != getattr(second, key):
            why = f"{key} is {getattr(first, key)} in one and {getattr(second, key)} in the other"
            raise ModelError("E-CIRCLE-FILES", files[1][0], why=why)
    return replace(
        first,
        angle_deg=np.concatenate([first.angle_deg, second.angle_deg]),
        radial_um=np.concatenate([first.radial_um, second.radial_um]),
        sense=np.concatenate([first.sense, second.sense]),
        warnings=(*first.warnings, *second.warnings),
    )


def _location_error(found: BallbarFigures, plane: str) -> list[Figure]:
    """The squareness by its ISO 230-1 letter, as the error model has it."""
    one = found.cause("squareness")
    if one is None or plane not in PLANES:
        return []
    named = of_plane(PLANES[plane], one.value * 1e-6)
    return [Figure(named.name, named.value_arcsec, "arcsec", squareness_arcsec(one.U))]


def _notes(found: BallbarFigures, record: CircleRecord) -> tuple[str, ...]:
    notes = [] if len(found.senses) > 1 else [ONE_SENSE]
    if not found.whole:
        notes.append(
            "the arc is no whole turn: no circular deviation; centre, mean radius and scale are correlated (U)"
        )
    if not record.calibrated:
        notes.append("the bar's length is not stated as calibrated: no radial deviation F, no mean scale of both axes")
    if record.feed_mm_min is None and len(found.senses) > 1:
        notes.append("no feed is stated: servo mismatch is its radial deviation in um, not a lag in ms")
    if not record.pitch_mm:
        notes.append("no pitch of a screw is stated (pitch_first_mm): cyclic error is part of what is left")
    if not record.plane:
        notes.append("no plane is stated (plane=XY): the squareness has no letter")
    notes.append(f"what no cause explains: {found.residual_um:.2f} µm RMS, part of the causes' U")
    notes.append("U of G and H holds the noise of the samples alone")
    notes += _diagnosis(found)
    return tuple(notes)


def _diagnosis(found: BallbarFigures) -> list[str]:
    """The largest causes in words, by how much each bends the circle, and those that cannot be told."""
    order = sorted(found.causes, key=lambda one: -one.bends_um)
    sure = [one for one in order if abs(one.value) > one.U]
    unsure = [one.name for one in order if one not in sure]
    told = [
        f"cause {place}: {_cause_sentence(one)}, bends the circle by ±{one.bends_um:.2f} µm"
        for place, one in enumerate(sure[:TOLD], 1)
    ]
    return [*told, *([f"not told from zero: {', '.join(unsure)}"] if unsure else [])]


def _cause_sentence(one: Cause) -> str:
    """A cause as a sentence: what it means of the machine."""
    size = f"{one.name} {one.value:+.2f} {one.unit} (U {one.U:.2f})"
    if one.name == "squareness":
        word = "larger" if one.value > 0 else "smaller"
        return f"{size}: the angle between the positive axes is {word} than 90 deg"
    if one.name == "scale mismatch":
        return f"{size}: the {'first' if one.value > 0 else 'second'} axis goes too far against the other"
    if one.name.startswith("backlash"):
        return f"{size}: {'lost motion' if one.value < 0 else 'over-compensated lost motion'} of that axis"
    if one.name == "servo mismatch":
        lag = "first" if one.value > 0 else "second"
        return f"{size}: the {lag} axis lags the other" if one.unit == "ms" else size
    return size


def _of_maker(found: MakersFigures) -> KindAnswer:
    figures = tuple(Figure(one.name, one.value, one.unit) for one in found.figures)
    words = tuple(f"{key}: {value}" for key, value in found.header.items() if value)
    plane = (f"plane {found.plane}",) if found.plane else ()
    unknown = tuple(f"{one.name}: its type {one.kind} has no public unit" for one in found.figures if not one.unit)
    return KindAnswer(
        kind=KIND,
        standard="the maker's program",
        figures=figures,
        curves=(),
        axes=("", ""),
        notes=(MAKERS, "no public description tells the sign rules of these figures", *plane, *words, *unknown),
    )
