"""What a run measured itself, for the paper's figures 7, 8, 11 and 12: readings of its axes, its inspected parts.

A study calculates from fitted errors. Where the run that they come from holds the readings before and after the
correction, and parts ground and inspected, these are drawn instead, the calculation only where nothing was measured.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, um_to_mm
from gateway.correct.part.inspected import LINE_POINTS, PROFILE, WIDTH
from gateway.domain.captures import Capture
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid, flank_grid, inspect
from gateway.store import RunFolder
from gateway.study.inputs import run_folder
from gateway.study.plots.charts import Measurement
from gateway.study.plots.laboratory import Chart, Traces
from gateway.tooth import InspectedFlank

CAPTURE = re.compile(r"capture-(?P<axis>.+)-before")
SETUP = re.compile(r"setup-(?P<key>.+?)(?P<other>-raw|-proof)?")
PARTS = ("before", "after")
FEWEST_HEIGHTS = 3
PLACES = 2  # decimals of a mm of arc: points nearer than that are one place
NEAR = 0.1  # of half a lobe's arc: how far from its middle a point of a lead trace may lie


@dataclass(frozen=True)
class Readings:
    """An error motion's readings: before anything was written, and after the axis' own table where it was measured."""

    title: str
    before: Capture
    after: Capture | None = None

    def drawn(self) -> Measurement:
        """What a picture needs of it."""
        one, after = self.before, self.after
        return Measurement(
            title=self.title, axis=one.axis, axis_unit=one.axis_unit, unit=one.unit,
            before=(one.targets, one.deviations),
            after=None if after is None else (after.targets, after.deviations),
        )  # fmt: skip


@dataclass(frozen=True)
class Evidence:
    """Readings of a run, the axes' own first, and its inspected parts by their names "before" and "after"."""

    run: str
    readings: tuple[Readings, ...]
    parts: Mapping[str, InspectedFlank]

    @property
    def proved(self) -> tuple[Readings, ...]:
        """The axes that were measured again."""
        return tuple(one for one in self.readings if one.after is not None)

    def is_of(self, gear: CycloidGear) -> bool:
        """Whether the parts are this gear's: a part is judged at places that its gear alone has."""
        grid = flank_grid(gear, profile=PROFILE, width=WIDTH)
        return all(_same(one.fitted.theta_rad, grid.thetas) and _same(one.fitted.z_mm, grid.zs)
                   and one.fitted.deviation_um.shape == grid.shape for one in self.parts.values())  # fmt: skip


def _same(one: FloatArray, other: FloatArray) -> bool:
    return one.shape == other.shape and bool(np.allclose(one, other, rtol=0.0, atol=1e-9))


def evidence_of(path: Path) -> Evidence | None:
    """What the run of a folder, or of the errors.json in it, measured; None where no run lies there.

    Raises CorruptRecord where a record is not what the run stored.
    """
    folder = run_folder(path)
    return None if folder is None else _find_records(folder)


def _find_records(folder: RunFolder) -> Evidence:
    own, others = [], []
    for stage in folder.stages:
        if match := CAPTURE.fullmatch(stage):
            name = match["axis"]
            after = f"capture-{name}-after"
            before = folder.get(stage, Capture)
            later = folder.get(after, Capture) if folder.has(after) else None
            own.append(Readings(f"{before.component} of {name}", before, later))
        elif (match := SETUP.fullmatch(stage)) and not match["other"]:
            one = folder.get(stage, Capture)
            rest = match["key"].removeprefix(f"{one.component}-{one.axis}").lstrip("-")
            others.append(Readings(f"{one.component} of {one.axis}{', ' if rest else ''}{rest}", one))
    seen = {(one.before.axis, one.before.component) for one in own}
    others = [one for one in others if (one.before.axis, one.before.component) not in seen]
    by_name = sorted(own, key=lambda one: one.title), sorted(others, key=lambda one: one.title)
    stages = {part: f"inspected-{part}" for part in PARTS}
    parts = {part: folder.get(name, InspectedFlank) for part, name in stages.items() if folder.has(name)}
    return Evidence(folder.path.name, (*by_name[0], *by_name[1]), parts)


def inspected_chart(gear: CycloidGear, part: InspectedFlank, spaces: tuple[int, ...], title: str) -> Chart:
    """A laboratory's chart of an inspected part: traces of the points as probed, pitch and runout of the fitted flank.

    A profile trace has the points of the place nearest to mid face, a lead trace those nearest to the middle of the
    profile, one of each height. Where too few lie there, the traces of all spaces are those of the fitted flank.
    """
    there = np.unique(part.k)
    near = tuple(int(there[np.argmin(np.abs(there - k))]) for k in spaces)
    spaces = tuple(dict.fromkeys(near))
    grid = FlankGrid(gear, np.arange(gear.zc, dtype=np.float64), part.fitted.theta_rad, part.fitted.z_mm)
    fitted = um_to_mm(part.fitted.deviation_um)
    h = gear.section(part.theta_rad).h
    e = um_to_mm(part.deviation_um) - arcsec_to_rad(part.turned_arcsec) * h
    arc, half = np.abs(gear.arc(part.theta_rad)), 0.5 * gear.limits().half_lobe_arc
    place = _places(part)
    profile, lead, as_probed = [], [], True
    for sign in (1.0, -1.0):
        flanks = [(part.k == k) & (np.sign(part.theta_rad) == sign) for k in spaces]
        lines = [_line(arc, e, here & (place == _middle(place[here]))) for here in flanks]
        heights = [_lead(place, arc - half, e, here, NEAR * 2.0 * half) for here in flanks]
        side = np.flatnonzero(np.sign(part.fitted.theta_rad) == sign)
        along = np.abs(gear.arc(part.fitted.theta_rad[side]))
        outward, level = np.argsort(along), int(np.argmin(np.abs(part.fitted.z_mm)))
        halfway = int(side[np.argmin(np.abs(along - half))])
        smooth = fitted[list(spaces)]
        told = _together(lines, LINE_POINTS), _together(heights, FEWEST_HEIGHTS)
        as_probed = as_probed and None not in told
        first = told[0] or (along[outward], smooth[:, side[outward], level])
        second = told[1] or (part.fitted.z_mm, smooth[:, halfway])
        profile.append(Traces.of(spaces, *first))
        lead.append(Traces.of(spaces, *second))
    who = " ".join(one for one in (part.source, part.serial, part.measured_utc[:10]) if one)
    what = "profile and lead: points as probed" if as_probed else "where points are too few, traces of the fitted flank"
    note = (
        f"part {part.part!r}, inspected: {who}; u of a point {part.u_um:.2f} µm; values in µm, one rotation removed\n"
        f"{what}; pitch and runout: fitted flank; each trace about its own mean, surplus to the right; "
        "dashed: least-squares line"
    )
    left, right = zip(profile, lead, strict=True)
    chart = inspect(grid, fitted)
    return Chart(title=title, note=note, profile=(left[0], right[0]), lead=(left[1], right[1]), chart=chart)


def _places(part: InspectedFlank) -> FloatArray:
    """The height of the place that each point belongs to (N,), mm."""
    heights = np.unique(part.place_z_mm)
    return np.asarray(heights[np.argmin(np.abs(part.z_mm[:, None] - heights), axis=1)])


def _middle(heights: FloatArray) -> float:
    return float(heights[np.argmin(np.abs(heights))]) if heights.size else 0.0


def _line(along: FloatArray, e: FloatArray, here: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The points of a line in order; those at one place, as the crossing of a lead line is, as their mean."""
    places, of = np.unique(np.round(along[here], PLACES), return_inverse=True)
    count = np.bincount(of, minlength=places.size)
    return places, np.bincount(of, weights=e[here], minlength=places.size) / count


def _lead(
    place: FloatArray, beside: FloatArray, e: FloatArray, here: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """The point of each height nearest to the middle of the profile, of those within ``reach``."""
    chosen = []
    for height in np.unique(place[here]):
        at = np.flatnonzero(here & (place == height))
        best = at[np.argmin(np.abs(beside[at]))]
        if abs(beside[best]) <= reach:
            chosen.append(best)
    at = np.asarray(chosen, dtype=np.intp)
    return place[at], e[at]


def _together(curves: list[tuple[FloatArray, FloatArray]], fewest: int) -> tuple[FloatArray, FloatArray] | None:
    """Curves at the places that the shortest of them has and all reach; None where one has too few points."""
    if min(at.size for at, _ in curves) < fewest:
        return None
    low, high = max(at[0] for at, _ in curves), min(at[-1] for at, _ in curves)
    at = min((at for at, _ in curves), key=lambda one: one.size)
    at = at[(at >= low) & (at <= high)]
    return None if at.size < fewest else (at, np.stack([np.interp(at, *curve) for curve in curves]))


def part_rows(evidence: Evidence) -> list[tuple[str, str, str, str]]:
    """Table 2 as inspected: figures of both parts in um, the RMS of the fitted flank with U (k = 2); "" if missing."""
    told = {part: _figures(one) for part, one in evidence.parts.items()}
    names = list(dict.fromkeys(name for one in told.values() for name in one))
    before, after = (told.get(part, {}) for part in PARTS)
    return [(name, before.get(name, ""), after.get(name, ""), "um") for name in names]


def _figures(part: InspectedFlank) -> dict[str, str]:
    rms = {"RMS normal deviation": part.fitted.rms_um, "U (k = 2) of the flank": 2.0 * part.rms_u_um}
    return {name: f"{value:.3f}" for name, value in {**rms, **part.figures}.items()}
