"""Each axis as found and as left: the charts as the standard draws them, and every figure with its U."""

from __future__ import annotations

from drivers.units import DeviationUnit
from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.report.document.content import Block, Heading, Pair, Paragraph, PictureBlock, TableBlock, Whole
from gateway.report.document.words import Tongue
from gateway.report.drawings import plots, positioning
from gateway.report.material import AxisMaterial, Judged, ReportMaterial
from gateway.report.parameters import PARAMETERS
from gateway.report.sentences import UNIT, number
from gateway.tooth import AxisOutlook

ACTING_MM = 182.0


def axes(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """A block for each axis; how to read the chart is said once, above the first."""
    shown = [axis for axis in report.axes if axis.before is not None or axis.after is not None]
    if not shown:
        return ()
    blocks = [_axis(axis, report.judged, t) for axis in shown]
    first = Whole((Heading(t("axes")), Paragraph(t("chart_said"), "small"), *blocks[0].blocks))
    return (first, *blocks[1:])


def _axis(axis: AxisMaterial, judged: tuple[Judged, ...], t: Tongue) -> Whole:
    kind = t("angular" if axis.rotary else "linear", component=axis.component)
    pair = Pair(
        _chart(axis, axis.capture_before, axis.before, t("as_found")),
        _chart(axis, axis.capture_after, axis.after, t("as_left")),
    )
    return Whole((Heading(f"{axis.axis}: {kind}", 2), pair, _figures(axis, judged, t), *_acting(axis, t)))


def _acting(axis: AxisMaterial, t: Tongue) -> tuple[Block, ...]:
    """The axis with every table acting, cross tables too, which spoil it on purpose for the tooth."""
    found, said = axis.acting, axis.outlook
    drawn = plots.acting(axis, words=False)
    picture: tuple[Block, ...] = (PictureBlock(drawn, ACTING_MM, t("acting_picture")),) if drawn else ()
    if found is None:
        return (Paragraph(_predicted(said, t), "small"), *picture) if said is not None else ()
    held = {True: "acting_held", False: "acting_missed", None: "acting_other"}[found.held]
    told = {"M": number(found.M), "U": number(found.M_U), "predicted": number(found.M_predicted)}
    return (Paragraph(t(held, **told, unit=UNIT[found.unit]), "small"), *picture)


def _predicted(said: AxisOutlook, t: Tongue) -> str:
    """Where no short check was made: the curve was not changed, nothing was pushed, or there is no instrument."""
    told = {"M": number(said.M), "U": number(said.M_U), "unit": UNIT[said.unit]}
    return t("acting_spoilt", alone=number(said.M_alone), **told) if said.spoilt else t("acting_alone", **told)


def _chart(axis: AxisMaterial, capture: Capture | None, found: Evaluation | None, state: str) -> tuple[Block, ...]:
    if found is None:
        return ()
    name = f"Chart {axis.axis} {'before' if found is axis.before else 'after'}"
    drawing = positioning.chart(capture, found, axis.letter, name)
    return (Paragraph(f"{state}  ({found.standard})", "strong"), PictureBlock(drawing, positioning.SIZE_MM[0]))


def _figures(axis: AxisMaterial, judged: tuple[Judged, ...], t: Tongue) -> TableBlock:
    """One row a state, one column a figure: value and U (k = 2) beside it; the limits beneath where there are any."""
    unit: DeviationUnit = axis.deviation_unit
    head = ("", *(t.known(f"figure_{name}", name) for name in PARAMETERS), t("unit"))
    states = ((t("as_found"), axis.before), (t("as_left"), axis.after))
    rows = [_row(state, found, unit) for state, found in states if found is not None]
    limits = {one.decision.parameter: one.decision for one in judged if one.of == axis.axis}
    if limits:
        cells = [f"{limits[name].limit:g}" if name in limits else "" for name in PARAMETERS]
        rows.append((t("limit"), *cells, UNIT[unit]))
    return TableBlock(head, tuple(rows), "l" + "r" * len(PARAMETERS) + "l", wide=(0,))


def _row(state: str, found: Evaluation, unit: DeviationUnit) -> tuple[str, ...]:
    cells = [_with_u(getattr(found, name), found.U.get(name)) for name in PARAMETERS]
    return state, *cells, UNIT[unit]


def _with_u(value: float | None, U: float | None) -> str:
    text = number(value)
    return text if value is None or U is None else f"{text} ± {number(U)}"
