"""Circular tests from files to figures: samples by columns, or a maker's own results; diagnosis in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers import registry
from drivers.message import Message, words
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
MAKERS = Message.of("S-CIRCLE-MAKER")
ONE_SENSE = Message.of("S-CIRCLE-ONE-SENSE")


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
        notes=(*_notes(found, record), *record.warnings),
    )
    return CircleAnswer(answer, found)


def _join_senses(files: Sequence[tuple[str, CircleRecord]]) -> CircleRecord:
    """Two files of one test as one. Raises ModelError (E-CIRCLE-FILES)."""
    first = files[0][1]
    if len(files) == 1:
        return first
    senses = [set(one.sense.tolist()) for _, one in files]
    if len(files) > 2 or senses[0] & senses[1]:
        raise ModelError("E-CIRCLE-FILES", files[1][0], why=Message.of("W-CIRCLE-SENSES"))
    second = files[1][1]
    for key in ("radius_mm", "feed_mm_min", "plane", "calibrated"):
        if getattr(first, key) != getattr(second, key):
            why = Message.of("S-CIRCLE-APART", key=key, first=getattr(first, key), second=getattr(second, key))
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


def _notes(found: BallbarFigures, record: CircleRecord) -> tuple[Message, ...]:
    notes: list[Message] = [] if len(found.senses) > 1 else [ONE_SENSE]
    if not found.whole:
        notes.append(Message.of("S-CIRCLE-ARC"))
    if not record.calibrated:
        notes.append(Message.of("S-CIRCLE-LENGTH"))
    if record.feed_mm_min is None and len(found.senses) > 1:
        notes.append(Message.of("S-CIRCLE-FEED"))
    if not record.pitch_mm:
        notes.append(Message.of("S-CIRCLE-PITCH"))
    if not record.plane:
        notes.append(Message.of("S-CIRCLE-PLANE"))
    notes.append(Message.of("S-CIRCLE-UNEXPLAINED", residual_um=found.residual_um))
    notes.append(Message.of("S-CIRCLE-U-NOISE"))
    notes += _diagnosis(found)
    return tuple(notes)


def _diagnosis(found: BallbarFigures) -> list[Message]:
    """The largest causes in words, by how much each bends the circle, and those that cannot be told."""
    order = sorted(found.causes, key=lambda one: -one.bends_um)
    sure = [one for one in order if abs(one.value) > one.U]
    unsure = [one.name for one in order if one not in sure]
    told = [
        Message.of("S-CIRCLE-CAUSE", place=place, cause=_cause_sentence(one), bends_um=one.bends_um)
        for place, one in enumerate(sure[:TOLD], 1)
    ]
    return [*told, *([Message.of("S-CIRCLE-NOT-ZERO", unsure=", ".join(unsure))] if unsure else [])]


def _cause_sentence(one: Cause) -> Message | str:
    """A cause as a sentence: what it means of the machine."""
    size = f"{one.name} {one.value:+.2f} {one.unit} (U {one.U:.2f})"
    if one.name == "squareness":
        word = Message.of("S-CIRCLE-LARGER" if one.value > 0 else "S-CIRCLE-SMALLER")
        return Message.of("S-CIRCLE-ANGLE", size=size, word=word)
    if one.name == "scale mismatch":
        return Message.of("S-CIRCLE-TOO-FAR", size=size, which=_which(one.value > 0))
    if one.name.startswith("backlash"):
        return Message.of(
            "S-CIRCLE-OF-AXIS", size=size, effect=Message.of("S-CIRCLE-LOST" if one.value < 0 else "S-CIRCLE-OVER")
        )
    if one.name == "servo mismatch":
        lag = _which(one.value > 0)
        return Message.of("S-CIRCLE-LAG", size=size, lag=lag) if one.unit == "ms" else size
    return size


def _which(first: bool) -> Message:
    return Message.of("S-CIRCLE-FIRST" if first else "S-CIRCLE-SECOND")


def _of_maker(found: MakersFigures) -> KindAnswer:
    figures = tuple(Figure(one.name, one.value, one.unit) for one in found.figures)
    header = tuple(Message.stored(f"{key}: {value}") for key, value in found.header.items() if value)
    plane = (Message.of("S-CIRCLE-IN-PLANE", plane=found.plane),) if found.plane else ()
    unknown = tuple(
        Message.of("S-CIRCLE-NO-UNIT", name=one.name, kind=one.kind) for one in found.figures if not one.unit
    )
    return KindAnswer(
        kind=KIND,
        standard=words("S-MAKERS-PROGRAM"),
        figures=figures,
        curves=(),
        axes=("", ""),
        notes=(MAKERS, Message.of("S-CIRCLE-SIGNS"), *plane, *header, *unknown),
    )
