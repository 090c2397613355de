"""Material to the report page: one HTML document, everything inside it, every name escaped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import zip_longest

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from drivers.message import Message, prose, term
from drivers.terms import spoken
from drivers.types.sensing import Ambient
from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.domain.proposals import TableChange
from gateway.report import sentences
from gateway.report.drawings import plots
from gateway.report.material import AxisMaterial, ReportMaterial
from gateway.report.parameters import ParameterRow, parameter_rows
from gateway.report.tooth import sentences as tooth_words
from gateway.report.tooth.page import tooth_page

MOST_TABLE_VALUES = 400


@dataclass(frozen=True, slots=True)
class Point:
    """One line of the points table; up, down, s_up, s_down, B before and after."""

    target: float
    before: tuple[float | None, ...]
    after: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class AxisPage:
    """One axis as the template wants it: records, rows and finished drawings."""

    material: AxisMaterial
    state: tuple[str, str, str]
    rows: tuple[ParameterRow, ...]
    curve: Markup
    table: Markup
    prediction: Markup
    acting: Markup
    polar: Markup
    points: tuple[Point, ...]
    values: tuple[tuple[float, float, float], ...]
    notes: tuple[str, ...]


def render(material: ReportMaterial) -> str:
    """The whole document. Same material, same text."""
    axes = [_axis_page(axis) for axis in material.axes]
    editions = sorted({_edition(item) for axis in material.axes for item in _evaluations(axis)})
    headline = (*sentences.OUTCOME[material.outcome][:2], tooth_words.sentence(material))
    tooth = tooth_page(material)
    loud = (*sentences.still_on(material), *sentences.open_road(material))
    return _template().render(
        report=material, axes=axes, editions=editions, outcome=headline, tooth=tooth, still_on=loud
    )


@cache
def _template() -> Template:
    loader = PackageLoader("gateway.report", "")
    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    for name in ("number", "signed", "percent", "when", "shortest", "plain", "micro", "step_line"):
        environment.filters[name] = getattr(sentences, name)
    environment.filters["prose"] = prose
    environment.globals.update(
        sentences=sentences,
        say=tooth_words,
        terms=spoken,
        term=term,
        captures=_captures,
        environment_rows=environment_rows,
        columns=columns,
    )
    return environment.get_template("report.html.j2")


def _shown(value: object) -> object:
    if isinstance(value, Markup) or not isinstance(value, (str, Message)):
        return value
    return sentences.visible(str(value))


def _axis_page(axis: AxisMaterial) -> AxisPage:
    return AxisPage(
        material=axis,
        state=sentences.axis_state(axis),
        rows=parameter_rows(axis.axis, axis.before, axis.after),
        curve=_drawn(plots.before_after(axis)),
        table=_drawn(plots.table_change(axis)),
        prediction=_drawn(plots.prediction(axis)),
        acting=_drawn(plots.acting(axis)),
        polar=_drawn(plots.polar(axis)),
        points=_points(axis),
        values=_values(axis.change),
        notes=_notes(axis),
    )


def _drawn(svg: str) -> Markup:
    # Our own drawing, whose texts matplotlib has escaped as XML.
    return Markup(svg)  # noqa: S704


def _evaluations(axis: AxisMaterial) -> tuple[Evaluation, ...]:
    return tuple(item for item in (axis.before, axis.after) if item is not None)


def _edition(item: Evaluation) -> str:
    """The standard, and how sure we are of its formulas where that was said."""
    return f"{item.standard} (formulas {item.certainty})" if item.certainty else item.standard


def _captures(axis: AxisMaterial) -> tuple[tuple[str, Capture], ...]:
    pairs = (("before", axis.capture_before), ("after", axis.capture_after))
    return tuple((name, capture) for name, capture in pairs if capture is not None)


def _points(axis: AxisMaterial) -> tuple[Point, ...]:
    """Targets of both evaluations in order; those measured once only have an empty side."""
    before, after = _by_target(axis.before), _by_target(axis.after)
    empty: tuple[float | None, ...] = (None,) * 5
    targets = sorted({**before, **after})
    return tuple(Point(target, before.get(target, empty), after.get(target, empty)) for target in targets)


def _by_target(evaluation: Evaluation | None) -> dict[float, tuple[float | None, ...]]:
    if evaluation is None:
        return {}
    columns_ = (evaluation.mean_up, evaluation.mean_down, evaluation.s_up, evaluation.s_down, evaluation.B_i)
    rows = zip(*(column.tolist() for column in columns_), strict=True)
    return {round(float(target), 6): row for target, row in zip(evaluation.targets.tolist(), rows, strict=True)}


def _values(change: TableChange | None) -> tuple[tuple[float, float, float], ...]:
    """Position, old and new of every interpolation point; none when the table is too long for paper."""
    if change is None or len(change.new.deviations) > MOST_TABLE_VALUES:
        return ()
    points = change.new.positions
    old = change.old.at(points).tolist()
    return tuple(zip(points.tolist(), old, change.new.deviations, strict=True))


def _notes(axis: AxisMaterial) -> tuple[str, ...]:
    """Everything a reader must know about this axis, once each, in the order of the run."""
    found: list[str] = []
    for side, item in (("Before", axis.before), ("After", axis.after)):
        found += [f"{side}: {flag}" for flag in item.flags] if item is not None else []
    for name, capture in _captures(axis):
        found += (*sentences.suspects(name, capture), *map(str, capture.notes))
    found += [str(axis.acting.words)] if axis.acting is not None else []
    if axis.change is not None:
        found += (
            *([str(axis.change.skipped)] if axis.change.skipped else []),
            *(str(one.message) for one in axis.change.findings),
        )
    return tuple(dict.fromkeys((*found, *map(str, axis.findings))))


def environment_rows(axis: AxisMaterial) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Name of each quantity and its readings: start and end of each capture."""
    readings = [
        ambient for _name, capture in _captures(axis) for ambient in (capture.ambient_start, capture.ambient_end)
    ]
    columns_ = [_ambient(reading) for reading in readings]
    names = list(dict.fromkeys(name for column in columns_ for name in column))
    return tuple((name, tuple(column.get(name, sentences.ABSENT) for column in columns_)) for name in names)


def _ambient(reading: Ambient) -> Mapping[str, str]:
    fixed = {
        "air °C": sentences.number(reading.air_degc, 2),
        "pressure hPa": sentences.number(reading.pressure_hpa, 2),
        "humidity %": sentences.number(reading.humidity_pct, 1),
    }
    sensors = {f"material {i} °C": sentences.number(value, 2) for i, value in enumerate(reading.material_degc, 1)}
    return {**fixed, **sensors}


def columns(rows: tuple[object, ...], count: int) -> list[tuple[object, ...]]:
    """Deal a long list into `count` columns, down first; each line of the answer is one row across."""
    height = -(-len(rows) // count) if rows else 0
    parts = [rows[start : start + height] for start in range(0, len(rows), height)] if height else []
    return list(zip_longest(*parts))
