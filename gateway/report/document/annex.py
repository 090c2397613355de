"""The annex: targets, environment, uncertainty by contribution, polar plot and harmonics, one axis after the other."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest

import numpy as np

from gateway.domain.figures import Evaluation
from gateway.errors import ModelError
from gateway.evaluate.geometry.rotary_motion import harmonics
from gateway.report.document.content import Block, Heading, Pair, Paragraph, PictureBlock, TableBlock, Whole
from gateway.report.document.words import Tongue
from gateway.report.drawings import environment, plots
from gateway.report.drawings.curves import mean
from gateway.report.material import AxisMaterial, ReportMaterial
from gateway.report.sentences import UNIT, number, signed

ORDERS = 8
CONTRIBUTIONS = ("device", "misalignment", "temperature", "expansion", "turning")


def axis_annex(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """Everything behind the figures of each axis."""
    return tuple(block for axis in report.axes for block in _axis(axis, t))


def _axis(axis: AxisMaterial, t: Tongue) -> Iterator[Block]:
    parts = [*_targets(axis, t), *_environment(axis, t), *_uncertainty(axis, t), *_turn(axis, t)]
    if parts:
        yield Heading(t("annex_axis", axis=axis.axis, component=axis.component) if axis.component else axis.axis)
        yield from parts


def _targets(axis: AxisMaterial, t: Tongue) -> Iterator[Block]:
    sides = [(key, item) for key, item in (("as_found", axis.before), ("as_left", axis.after)) if item is not None]
    if not sides:
        return
    yield Heading(t("targets", unit=UNIT[axis.deviation_unit]), 2)
    told = [(Paragraph(t(key), "strong"), _target_table(axis, item, t)) for key, item in sides]
    yield Pair(told[0], told[1] if len(told) > 1 else ())


def _target_table(axis: AxisMaterial, found: Evaluation, t: Tongue) -> TableBlock:
    columns = (found.mean_up, found.mean_down, found.s_up, found.s_down, found.B_i)
    rows = zip(found.targets.tolist(), *(column.tolist() for column in columns), strict=True)
    told = tuple(
        (number(at, 3), signed(up), signed(down), number(s_up), number(s_down), signed(b))
        for at, up, down, s_up, s_down, b in sorted(rows)
    )
    position = t("target", position=UNIT[axis.unit])
    return TableBlock((position, "x̄ ↑", "x̄ ↓", "s ↑", "s ↓", "B"), told, "rrrrrr", dense=True)


def _environment(axis: AxisMaterial, t: Tongue) -> Iterator[Block]:
    drawn = [
        (t(key), environment.temperatures(course, f"Temperatures {axis.axis} {key}"))
        for key, course in (("as_found", axis.course_before), ("as_left", axis.course_after))
    ]
    known = [(Paragraph(state, "strong"), PictureBlock(svg, environment.SIZE_MM[0])) for state, svg in drawn if svg]
    if known:
        heading = Heading(t("environment"), 2)
        yield Whole(
            (heading, Pair(known[0], known[1] if len(known) > 1 else ()), Paragraph(t("environment_said"), "small"))
        )


def _uncertainty(axis: AxisMaterial, t: Tongue) -> Iterator[Block]:
    """Every contribution to U (k = 2), and what they make of each figure."""
    found = axis.after or axis.before
    if axis.budget is None or found is None:
        return
    unit = UNIT[axis.deviation_unit]
    told = [(name, getattr(axis.budget, name)) for name in CONTRIBUTIONS]
    rows = [(t(f"u_{name}"), number(value), t(f"u_{name}_on")) for name, value in told if value]
    scatter = _scatter(found)
    if scatter is not None:
        rows.append((t("u_scatter"), number(scatter), t("u_scatter_on")))
    made = "   ".join(f"U({name}) {number(U)}" for name, U in found.U.items() if name in ("A", "E", "M", "R", "B"))
    head = (t("contribution"), f"U, k = 2, {unit}", t("acts_on"))
    yield Whole(
        (
            Heading(t("budget"), 2),
            TableBlock(head, tuple(rows), "lrl", dense=True, wide=(0,)),
            Paragraph(f"{made} {unit}", "small"),
        )
    )


def _scatter(found: Evaluation) -> float | None:
    """Twice the pooled standard deviation of the readings."""
    s = np.concatenate([found.s_up, found.s_down])
    s = s[np.isfinite(s)]
    return 2.0 * float(np.sqrt(np.mean(s**2))) if s.size else None


def _turn(axis: AxisMaterial, t: Tongue) -> Iterator[Block]:
    drawn = plots.polar(axis)
    if not drawn:
        return
    table = _harmonics(axis, t)
    right = (table,) if table is not None else ()
    yield Whole((Heading(t("turn"), 2), Pair((PictureBlock(drawn, 76.0, t("polar_said")),), right)))


def _harmonics(axis: AxisMaterial, t: Tongue) -> TableBlock | None:
    """Amplitude and phase by order, as found and as left; None where the targets cannot tell them apart."""
    sides = [(key, _orders(item)) for key, item in (("as_found", axis.before), ("as_left", axis.after)) if item]
    known = [(key, rows) for key, rows in sides if rows]
    if not known:
        return None
    head: tuple[str, ...] = (t("order_n"),)
    for key, _rows in known:
        head = (*head, f"{t(key)}, arcsec", "°")
    lines = []
    for place, cells in enumerate(zip_longest(*(rows for _key, rows in known), fillvalue=("", ""))):
        lines.append((str(place + 1), *(text for cell in cells for text in cell)))
    return TableBlock(head, tuple(lines), "l" + "r" * (len(head) - 1), dense=True)


def _orders(found: Evaluation) -> list[tuple[str, str]]:
    values = mean(found)
    keep = np.isfinite(values)
    most = min(ORDERS, (int(keep.sum()) - 1) // 2)
    if most < 1 or np.ptp(found.targets[keep]) < 300.0:
        return []
    try:
        spectrum = harmonics(found.targets[keep], values[keep], range(1, most + 1))
    except ModelError:
        return []
    return [(number(one.amplitude), number(one.phase_deg, 0)) for one in spectrum.harmonics.values()]
