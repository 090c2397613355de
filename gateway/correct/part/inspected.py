"""What an inspection tells of a part: A, B, G at every place, the flank these make on the judged grid, how sure it is.

Between the heights measured A, B and G run straight, as a table over the stroke does, and on beyond the outermost; what
bends between two heights is not seen. One rotation of the whole gear is removed. An eccentric clamping of the
inspection cannot be told from the part's own eccentricity: it counts as uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.errors import words
from drivers.limits import SOLVED_STEP
from drivers.message import Message, digits, fixed
from drivers.types.gears import GearInspection
from drivers.types.values import FloatArray
from drivers.units import UM_PER_MM, mm_to_um, rad_to_arcsec, um_to_mm
from gateway.correct.flank.flank_model import Places, command_effects, places_of_grid, places_of_points
from gateway.correct.part.fitted_places import FittedPlaces, check_points, fit_points, fit_record
from gateway.domain.values import COVERAGE
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid, TraceValues, flank_figure, flank_grid, inspect, trace_values
from gateway.gear.grinding import Grinding
from gateway.gear.measured_points import Heights, touched_points
from gateway.gear.process_drift import with_curvature
from gateway.model.error_model import yk7350b
from gateway.tooth import FlankMap, InspectedFlank, SetupValues

PROFILE, WIDTH = 11, 5
USUAL_CLAMPING_UM = 0.5
LINE_POINTS, LINE_SHARE = 5, 0.5  # of a profile line: fewer points, or over less of a flank, make none
TO_UM = np.array([UM_PER_MM, UM_PER_MM, rad_to_arcsec(1.0)])


@dataclass(frozen=True, slots=True)
class InspectionSource:
    """What was inspected by whom: part's name in the run, source, serial number, when, how well it clamps (k = 2).

    ``heights`` says what the heights count from; ``said`` goes before what the points themselves say.
    """

    part: str
    source: str = ""
    serial: str = ""
    measured_utc: str = ""
    clamping_um: float = USUAL_CLAMPING_UM
    heights: Heights = "lower-face"
    said: tuple[Message, ...] = ()


def inspected_flank(gear: CycloidGear, found: GearInspection, about: InspectionSource) -> InspectedFlank:
    """The record of measured points: fitted flank, uncertainties, figures, what must be minded.

    Raises what `gateway.gear.measured_points.touched_points` and `gateway.correct.part.fitted_places.fit_points` raise.
    """
    seen = touched_points(gear, found, about.heights)
    probe = um_to_mm(found.probe_u_um or 0.0)
    told = fit_points(gear, seen.points, probe)
    grid = flank_grid(gear, profile=PROFILE, width=WIDTH)
    flank = _FittedFlank.of(told, grid)
    point_um = float(mm_to_um(told.fit.u))
    form = float(np.sqrt(max(told.fit.u**2 - probe**2, 0.0))) if probe else 0.0
    clamping = um_to_mm(about.clamping_um / COVERAGE) * _clamping_share(grid)
    rms_u = float(np.sqrt(np.mean(flank.variance) + form**2 + clamping**2))
    return InspectedFlank(
        part=about.part,
        source=about.source,
        serial=about.serial,
        k=told.points.k,
        theta_rad=told.points.theta,
        z_mm=told.points.z,
        deviation_um=told.points.deviation * UM_PER_MM,
        u_um=point_um,
        place_k=told.places.k,
        place_z_mm=told.places.z,
        abg=told.fit.abg * TO_UM,
        abg_u=told.fit.abg_u * TO_UM,
        fitted=FlankMap(grid.thetas, grid.zs, flank.deviation * UM_PER_MM),
        rms_u_um=float(mm_to_um(rms_u)),
        figures=_figures(grid, flank, told),
        said=(*about.said, *_inspection_remarks(told, seen.shift, about, probe), *found.warnings),
        measured_utc=about.measured_utc,
        turned_arcsec=rad_to_arcsec(flank.rotation),
    )


def inspection_patterns(
    gear: CycloidGear, found: InspectedFlank, clamping_um: float = USUAL_CLAMPING_UM
) -> tuple[Places, FloatArray]:
    """How the fitted flank of an inspection may be wrong: independent patterns (G, 3, S) of one u each, mm and rad.

    A, B, G of every measured place by the scatter of its points, straight between heights as the flank is fitted; and
    the clamping's eccentricity, as likely along x as along y. No pattern is one rotation: the datum of angles is free.
    """
    told, grid = fit_record(gear, found), flank_grid(gear, profile=PROFILE, width=WIDTH)
    places = places_of_grid(grid)
    roots = np.linalg.cholesky(told.places.inverses) * told.fit.u
    columns = []
    for k in grid.ks:
        here, rows = np.flatnonzero(told.places.k == k), np.flatnonzero(places.k == k)
        weights = along_face(told.places.z[here], grid.zs)
        for number, place in enumerate(here):
            one = np.zeros((places.k.size, 3, 3))
            one[rows] = weights[:, number, None, None] * roots[place]
            columns.append(one)
    turn = gear.space_angle(places.k)
    cos, sin, none = np.cos(turn), np.sin(turn), np.zeros_like(turn)
    moved = np.stack([np.stack([cos, -sin, none], axis=-1), np.stack([sin, cos, none], axis=-1)], axis=-1)
    return places, np.concatenate([*columns, um_to_mm(clamping_um / COVERAGE) * moved], axis=-1)


def check_gear(gear: CycloidGear, found: GearInspection, heights: Heights = "lower-face") -> None:
    """Refuse the points of another gear, or of spaces that are not ground, before all of them are there.

    Raises what `touched` raises, ModelError E-INSPECT-GEAR.
    """
    check_points(gear, touched_points(gear, found, heights).points)


@dataclass(frozen=True)
class _FittedFlank:
    """The flank (K, T, Z) in mm without its rotation (rad), and the variance of each point by the probe's noise."""

    deviation: FloatArray
    variance: FloatArray
    rotation: float

    @staticmethod
    def of(told: FittedPlaces, grid: FlankGrid) -> _FittedFlank:
        section = grid.gear.section(grid.thetas)
        form = np.stack([section.nx, section.ny, section.h], axis=-1)
        spread = told.places.inverses * told.fit.u**2
        deviation, variance = np.empty(grid.shape), np.empty(grid.shape)
        for index, k in enumerate(grid.ks):
            here = np.flatnonzero(told.places.k == k)
            weights = along_face(told.places.z[here], grid.zs)
            deviation[index] = form @ (weights @ told.fit.abg[here]).T
            shared = np.einsum("zh,hij->zij", weights**2, spread[here])
            variance[index] = np.einsum("ti,zij,tj->tz", form, shared, form)
        straight = FlankMap(grid.thetas, grid.zs, deviation * UM_PER_MM)
        deviation = with_curvature(straight, grid.gear).deviation_um / UM_PER_MM
        turned = flank_figure(deviation, grid.section.h).rotation
        return _FittedFlank(deviation - turned * grid.section.h, variance, turned)


def along_face(measured: FloatArray, wanted: FloatArray) -> FloatArray:
    """Weights (Z, H) of values at heights (H,) measured for those at heights (Z,): straight between, and on beyond."""
    order = np.argsort(measured)
    at = measured[order]
    left = np.clip(np.searchsorted(at, wanted) - 1, 0, at.size - 2)
    share = (wanted - at[left]) / (at[left + 1] - at[left])
    weights = np.zeros((wanted.size, at.size))
    rows = np.arange(wanted.size)
    weights[rows, order[left]], weights[rows, order[left + 1]] = 1.0 - share, share
    return weights


def _clamping_share(grid: FlankGrid) -> float:
    """RMS on the flank (one rotation removed) of an eccentricity, as likely along x as along y, per mm of each."""
    section, angle = grid.section, grid.gear.space_angle(grid.k)
    cos, sin = np.cos(angle), np.sin(angle)
    along = cos * section.nx - sin * section.ny, sin * section.nx + cos * section.ny
    x, y = (flank_figure(np.broadcast_to(one, grid.shape), section.h).rms for one in along)
    return float(np.hypot(x, y))


def _figures(grid: FlankGrid, flank: _FittedFlank, told: FittedPlaces) -> dict[str, float]:
    """Largest over all flanks, um: profile on the measured lines where there are any, the rest on the fitted flank."""
    chart = inspect(grid, flank.deviation)
    lines = _profile_lines(grid.gear, told, flank.rotation)
    profile = np.max(lines, axis=0) if lines.size else np.array([np.max(np.abs(v)) for v in _values(chart.profile)])
    lead = [np.max(np.abs(one)) for one in _values(chart.lead)]
    pitch = chart.pitch
    found = {
        **dict(zip(("F_alpha", "f_Halpha", "f_falpha"), profile, strict=True)),
        **dict(zip(("F_beta", "f_Hbeta", "f_fbeta"), lead, strict=True)),
        "F_p": max(one.F_p for one in pitch),
        "f_p": max(one.f_p for one in pitch),
        "F_r": chart.runout.F_r,
        "eccentricity": chart.runout.eccentricity,
    }
    return {name: float(mm_to_um(float(value))) for name, value in found.items()}


def _values(trace: TraceValues) -> tuple[FloatArray, FloatArray, FloatArray]:
    return trace.F, trace.f_H, trace.f_f


def _profile_lines(gear: CycloidGear, told: FittedPlaces, rotation: float) -> FloatArray:
    """|F|, |f_H|, f_f (L, 3) in mm of every measured profile line, the gear's rotation taken off."""
    points, h = told.points, told.places.form[:, 2]
    deviation, arc = points.deviation - rotation * h, gear.arc(points.theta)
    line = 2 * told.places.of + (points.theta > 0.0)
    order = np.argsort(line, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(line[order])) + 1)
    least = LINE_SHARE * gear.limits().half_lobe_arc
    long = [one for one in parts if one.size >= LINE_POINTS and float(np.ptp(arc[one])) >= least]
    traces = [trace_values(deviation[one], arc[one]) for one in long]
    return np.array([[abs(float(value)) for value in _values(one)] for one in traces]).reshape(-1, 3)


def _inspection_remarks(told: FittedPlaces, shift: int, about: InspectionSource, probe: float) -> tuple[Message, ...]:
    said = [Message.of("S-INSPECT-CLAMPING", U=digits(about.clamping_um, 6))]
    if told.glitches:
        said.append(Message.of("S-INSPECT-GLITCHES", count=told.glitches))
    if told.beside:
        said.append(Message.of("S-INSPECT-BESIDE", count=told.beside))
    if shift:
        said.append(Message.of("S-INSPECT-SHIFT", shift=shift))
    if not probe:
        said.append(Message.of("S-INSPECT-PROBE", u=fixed(mm_to_um(told.fit.u))))
    return (*said, Message.of("S-INSPECT-FIGURES"))


# ---- Set-up values from an inspected trial part: what of its flanks is constant, and which values take it.

RESOLUTION_UM = float(mm_to_um(SOLVED_STEP))


@dataclass(frozen=True, slots=True)
class SetupChange:
    """Changes of the set-up values in whole steps, their standard uncertainties, and in words what was left alone."""

    setup: SetupValues
    u: SetupValues
    said: tuple[str, ...]


def setup_from_part(
    inspected: InspectedFlank, gear: CycloidGear, *, resolution_um: float = RESOLUTION_UM
) -> SetupChange:
    """What to add to the set-up values so that the next part shows no constant A and no constant B.

    The constants are those of the fitted flank by least squares over the judged grid, one rotation with them: C zero
    stays, a rotation is no figure. Corrections are added to commands: a part with surplus in the bottom of its spaces
    (A > 0) asks for more infeed. A value within its uncertainty (k = 2) or half a step stays as it is. ``u`` is that of
    the constants by the scatter of the points and the step. An eccentric clamping of the inspection makes no constant;
    a probe whose size is wrong makes one, is in ``Shop.size_um`` and nowhere here.
    """
    flank = inspected.fitted
    shape = flank.deviation_um.shape
    section = gear.section(flank.theta_rad)
    ways = (np.broadcast_to(one[None, :, None], shape).ravel() for one in (section.nx, section.ny, section.h))
    found = np.linalg.lstsq(np.stack(list(ways), axis=1), flank.deviation_um.ravel(), rcond=None)[0]
    effects = setup_effects(gear)
    u = _scatter(inspected, gear)[:2] / np.abs(effects)
    wanted = -found[:2] / effects
    steps = np.rint(wanted / resolution_um)
    kept = (np.abs(wanted) > COVERAGE * u) & (steps != 0.0)
    said = [
        words("S-SETUP-WITHIN-U", name=name, value=fixed(value, 2, signed=True), U=fixed(COVERAGE * one, 2))
        for name, value, one, keep in zip(("x zero", "dressing offset"), wanted, u, kept, strict=True)
        if not keep
    ]
    x, dressing = (float(round(one * resolution_um, 6)) for one in np.where(kept, steps, 0.0))
    whole = np.hypot(u, resolution_um / 12.0**0.5)
    return SetupChange(
        SetupValues(x_um=x, dressing_um=dressing),
        SetupValues(x_um=float(whole[0]), dressing_um=float(whole[1])),
        tuple(said),
    )


def setup_effects(gear: CycloidGear) -> FloatArray:
    """A per um of x zero, B per um of dressing offset: the same in every space and at every height."""
    grinding = Grinding(yk7350b(), gear, 2.0 * float(gear.limits().r_tip))
    one = places_of_points(gear, 0.0, 0.0, 0.0)
    return np.array([command_effects(grinding, one)[grinding.infeed][0, 0], 1.0])


def _scatter(inspected: InspectedFlank, gear: CycloidGear) -> FloatArray:
    """Standard uncertainties (3,) of constant A, B, G by the scatter of the points measured (um, um, um per mm)."""
    section = gear.section(inspected.theta_rad)
    form = np.stack([section.nx, section.ny, section.h], axis=1)
    inverse = np.linalg.pinv(form.T @ form, hermitian=True)
    return np.asarray(inspected.u_um * np.sqrt(np.maximum(np.diag(inverse), 0.0)))
