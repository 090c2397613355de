"""Separation of the deviations of inspected parts into wheel, dresser, set-up, axes, clamping, wear and rest (um).

Theory. A form wheel that passes a spur flank leaves, to first order, in space k at height z

    e(k, t, z) = A n_x(t) + B n_y(t) + G h(t) + w(t) + r(k) w'(t) + noise

with the unit normal (n_x, n_y) and the lever h of the profile at t. A, B, G are functions of (k, z): everything that
*moves* wheel or gear shows as them, whatever it is. What they cannot make, and what is alike in all spaces and at all
heights, is the wheel's own axial form w. r runs from -1/2 to 1/2 in the order of grinding: w' is form wear. A large
shift also bends: -kappa d_t^2/2 + kappa' d_t^3/6 with the shift d_t along the profile; it is taken off first.

Step 1: w and w' are cubic splines over each flank's arc, left and right by themselves, made orthogonal to n_x, n_y and
h over the measured points. A, B, G of every place are eliminated (each row is replaced by what the place's own fit
leaves), so w is the least-squares estimate beside free A, B, G, with covariance s^2 (Q'Q)^-1.

Step 2: the field A, B, G of all places is fitted by columns that stand for causes, each place weighted by its own
normal matrix (that is least squares on the points):

    set-up    constant A (x zero) and constant B (dressing offset); a constant G is the datum of the inspection
    clamping  (A, B) = (u cos p + v sin p, -u sin p + v cos p) in the space at angle p (eccentricity), and z times it
              (wobble): what is fixed in the gear. A once-per-turn index error of C is told from it by A alone, for
              B and G of one space can hardly be told apart; a radial error of C that turns along counts as clamping
    axes      polynomials over z of each of A, B, G; harmonics over the turn, up to one for four spaces
    wear      A, B, G times r(k): depth, side, index

What the columns leave of the field is the machine's too, for it depends on the space; several parts tell what of it
repeats, the rest does not. Its scatter from space to space is a random effect: the covariance of the coefficients is
H^-1 (sum S_k T S_k' + s^2 H) H^-1, T being that scatter as a 3 x 3 matrix and S_k the normal rows of one space.

A diamond that is too small by d leaves e = -d everywhere. Most of that is a shift (n_x is nearly constant), so only its
part outside n_x, n_y, h is form, and a wheel may have that form by itself: the diamond is named where that one shape
explains `NAMED` of the form, else its size is an uncertainty of the dresser's share.

Shares are RMS over the judged flank, v'Gv of the cause's coefficients v, less what noise alone would make of it
(trace of G times the covariance); u by propagation to second order, so that a share of 0 has a u.

Sources: ISO 1328-1 (deviations of profile, helix, pitch, runout); JCGM 102 (multivariate propagation); the linear
mixed model of any text book of statistics; first-order flank: `gateway.gear.first_order`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.message import Message, digits, fixed, words
from drivers.types.values import FloatArray
from drivers.units import rad_to_arcsec, um_to_mm
from gateway.correct.part.inspected import setup_effects
from gateway.domain.grinding_process import EstimatedValue, ProcessShare, Separation, WheelForm
from gateway.domain.values import COVERAGE
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_grid
from gateway.process.causes import ORDERS, PER_ORDER, CausePlaces, FittedCauses, cause_columns, fit_causes
from gateway.process.wheel_form import (
    HEIGHT_MM,
    FittedForm,
    PlacedPoints,
    ProcessPart,
    demand_one_wheel,
    fit_form,
    grinding_ramp,
    place_points,
)

SHARES = ("wheel", "dresser", "set-up", "axes", "clamping", "wear", "rest")
SAMPLES = 61  # of the form, on each flank
NAMED = 0.8  # of the form's mean square that one shape explains
SURE = 3.0  # standard uncertainties
CORRELATED = 0.7
LEAST_UM = 0.03  # RMS of deviations: no flank and no probe is as good
SIZE_UM = 0.3  # standard uncertainty of a probe's radius after calibration


def separate(gear: CycloidGear, parts: Sequence[ProcessPart], *, size_um: float = SIZE_UM) -> Separation:
    """The causes of the deviations of parts that were ground after one dressing of the wheel.

    ``size_um`` is the standard uncertainty of the probe's radius: it cannot be told from an equal error of the profile.
    Raises ModelError: E-PROCESS-EMPTY, E-PROCESS-UNIT (deviations in mm), E-PROCESS-ORDER, E-PROCESS-DRESSINGS (parts
    of several dressings by their names), E-PROCESS-MIXED (by their forms).
    """
    _check_parts(gear, parts)
    points = place_points(gear, parts)
    form = fit_form(points)
    demand_one_wheel(points, form, parts)
    causes = fit_causes(gear, points, form, parts)
    return _separation(gear, points, form, causes, parts, size_um)


def _check_parts(gear: CycloidGear, parts: Sequence[ProcessPart]) -> None:
    if not parts:
        raise ModelError("E-PROCESS-EMPTY", "separation")
    named = sorted({part.dressing for part in parts if part.dressing})
    if len(named) > 1:
        raise ModelError("E-PROCESS-DRESSINGS", "separation", names=", ".join(named))
    for part in parts:
        rms = float(np.sqrt(np.mean(np.square(part.deviation_um)))) if part.deviation_um.size else 0.0
        if rms < LEAST_UM:
            raise ModelError("E-PROCESS-UNIT", part.name, rms=fixed(rms, 4), limit=digits(LEAST_UM, 6))
        if part.order is not None and sorted(part.order) != list(range(gear.zc)):
            raise ModelError("E-PROCESS-ORDER", part.name, spaces=gear.zc, given=len(part.order))


# ---- Shares, and what is said.


def _share(name: str, v: FloatArray, covariance: FloatArray, gram: FloatArray, more: float = 0.0) -> ProcessShare:
    """RMS of the coefficients' flank without what noise alone makes of it; ``more`` is another mean square."""
    spread = gram @ covariance
    noise = float(np.trace(spread))
    plain = max(float(v @ gram @ v) - noise, 0.0) + more
    variance = 4.0 * float(v @ gram @ covariance @ gram @ v) + 2.0 * float(np.sum(spread * spread.T))
    return _rms_of(name, plain, variance)


def _rms_of(name: str, square: float, variance: float) -> ProcessShare:
    root = float(np.sqrt(max(variance, 0.0)))
    base = max(square, 0.5 * root)
    return ProcessShare(name, float(np.sqrt(max(square, 0.0))), root / (2.0 * float(np.sqrt(base))) if base else 0.0)


def _together(name: str, shares: Sequence[ProcessShare]) -> ProcessShare:
    """Orthogonal shares as one."""
    square = sum(one.rms_um**2 for one in shares)
    variance = sum(4.0 * max(one.rms_um, one.u_um) ** 2 * one.u_um**2 for one in shares)
    return _rms_of(name, square, variance)


@dataclass(frozen=True)
class _Diamond:
    """An equal error along the profile: its size (um), variance, share of the form that it explains, its form (m,).

    ``shift`` (3,) is the A, B, G that it also makes per um.
    """

    value: float
    variance: float
    explains: float
    form: FloatArray
    shift: FloatArray

    def named(self, size_um: float) -> bool:
        """Whether the profile shows that the form is this."""
        return self.explains >= NAMED and abs(self.value) > SURE * float(np.hypot(np.sqrt(self.variance), size_um))


def _diamond(points: PlacedPoints, form: FittedForm) -> _Diamond:
    one = np.ones(points.e.size)
    shift: FloatArray = np.asarray(np.linalg.lstsq(points.shape, one, rcond=None)[0])
    outside = one - points.shape @ shift
    rows = form.basis.rows(points.theta, points.arc)
    functional = outside @ rows / float(outside @ outside)
    value, variance = float(functional @ form.value), float(functional @ form.covariance @ functional)
    own = rows @ form.value
    noise = float(np.trace(rows.T @ rows @ form.covariance))
    whole = max(float(own @ own) - noise, 1e-12)
    explains = min(value**2 * float(outside @ outside) / whole, 1.0)
    own_form: FloatArray = np.asarray(np.linalg.lstsq(rows, outside, rcond=None)[0])
    return _Diamond(value, variance, explains, own_form, shift)


def _separation(
    gear: CycloidGear,
    points: PlacedPoints,
    form: FittedForm,
    causes: FittedCauses,
    parts: Sequence[ProcessPart],
    size_um: float,
) -> Separation:
    grid = flank_grid(gear)
    rows = form.basis.rows(grid.thetas, np.abs(gear.arc(grid.thetas)))
    gram = rows.T @ rows / grid.thetas.size
    diamond = _diamond(points, form)
    named = diamond.named(size_um)
    own = form.value - diamond.value * diamond.form if named else form.value
    width = float(np.sqrt(max(float(diamond.form @ gram @ diamond.form), 0.0)))
    d_u = float(np.hypot(np.sqrt(diamond.variance), size_um))
    dresser = ProcessShare(
        "dresser", width * abs(diamond.value) * named, width * (d_u if named else float(np.hypot(diamond.value, d_u)))
    )
    wheel = _share("wheel", own, form.covariance, gram)
    sides = [
        _share(f"wheel, {side} flank", own, form.covariance, rows[here].T @ rows[here] / np.count_nonzero(here))
        for side, here in (("right", grid.thetas < 0.0), ("left", grid.thetas > 0.0))
    ]
    covariance = _with_instrument(causes, parts, diamond.shift, size_um)
    field_gram = _field_gram(gear, points, causes, parts)
    moved = _as_ground(gear, causes, parts)

    def share(name: str, cause: str, more: float = 0.0) -> ProcessShare:
        at = causes.of(cause)
        return _share(name, moved[at], covariance[np.ix_(at, at)], field_gram[np.ix_(at, at)], more)

    setup = share("set-up", "set-up", _setup_scatter(gear, parts, field_gram, causes))
    clamping = share("clamping", "clamping")
    along, turning = share("axes, over Z", "axes Z"), share("axes, over C", "axes C")
    between, unrepeated = _left_field(points, form, causes, len(parts))
    axes = _together("axes", (along, turning, between))
    worn = [share(words("S-PROC-WEAR-POSITION"), "wear"), _form_wear(points, form, gram)]
    wear = _together("wear", worn)
    rest = _together("rest", (_rms_of("", form.s**2, 2.0 * form.s**4 / form.freedom), unrepeated))
    effects = setup_effects(gear)
    arcsec = rad_to_arcsec(um_to_mm(1.0) / (0.5 * gear.b))  # of a slope that makes 1 um at the ends of the face
    places = {"x_um": ("x zero", effects[0]), "dressing_um": ("dressing offset", effects[1])}
    whole = replace(causes, covariance=covariance)
    return Separation(
        parts=tuple(part.name for part in parts),
        total_um=_total(points),
        point_u_um=form.s,
        shares=(wheel, dresser, setup, axes, clamping, wear, rest),
        details=(*sides[::-1], along, turning, between, *worn, unrepeated),
        form=_sampled(gear, form),
        diamond=EstimatedValue(diamond.value, d_u),
        diamond_named=named,
        setup={
            **{key: whole.estimate(name, -1.0 / float(effect)) for key, (name, effect) in places.items()},
            "swivel_arcsec": whole.estimate("B z1", -arcsec / float(effects[1]), "arcsec"),
        },
        clamping=_clampings(gear, whole, parts),
        wear={
            "depth_um": whole.estimate("depth"),
            "side_um": whole.estimate("side"),
            "index_arcsec": whole.estimate("index", rad_to_arcsec(um_to_mm(1.0) / gear.rp), "arcsec"),
        },
        correlations=(*_with_diamond(points), *_correlations(whole)),
        said=tuple(_remarks(causes, diamond, parts, named=named)),
    )


def _sampled(gear: CycloidGear, form: FittedForm) -> WheelForm:
    """The form over the measured arcs, right flank first: profile angles ascend."""
    right, left = form.basis.knots
    arc = np.concatenate([-np.linspace(right[0], right[-1], SAMPLES)[::-1], np.linspace(left[0], left[-1], SAMPLES)])
    theta = gear.theta_at(arc)
    rows = form.basis.rows(theta, np.abs(arc))
    return WheelForm(theta, rows @ form.value, rows @ form.covariance @ rows.T)


def _field_gram(
    gear: CycloidGear, points: PlacedPoints, causes: FittedCauses, parts: Sequence[ProcessPart]
) -> FloatArray:
    """Mean square of the columns' flanks over the judged grid of every part, (q, q)."""
    grid = flank_grid(gear)
    section = gear.section(grid.thetas)
    shape = np.stack([section.nx, section.ny, section.h / gear.rp], axis=1)
    K, _, Z = grid.shape
    number = np.repeat(np.arange(len(parts)), K * Z)
    k, z = (np.tile(one, len(parts)) for one in (np.repeat(grid.ks, Z), np.tile(grid.zs, K)))
    ramps = np.stack([grinding_ramp(gear, one.order) for one in parts])
    at = CausePlaces(number, np.asarray(gear.space_angle(k)), z / (0.5 * gear.b), ramps[number, k.astype(np.intp)])
    orders = min(ORDERS, (gear.zc - 1) // PER_ORDER)
    heights = int(np.unique(np.round(points.z / HEIGHT_MM)).size)
    design = np.stack(
        [one.value for one in cause_columns(at, len(parts), orders=orders, heights=heights, drift=causes.drift_known)],
        axis=2,
    )
    square = shape.T @ shape / shape.shape[0]
    return np.asarray(np.einsum("piq,ij,pjr->qr", design, square, design) / number.size)


def _with_instrument(
    causes: FittedCauses, parts: Sequence[ProcessPart], shift: FloatArray, size_um: float
) -> FloatArray:
    """The covariance with what clamping and probe of the inspection may be wrong by."""
    found = causes.covariance.copy()
    for number, part in enumerate(parts):
        for name in ("x", "y"):
            at = causes.of(f"eccentricity {name} {number}")
            found[at, at] += (part.clamping_um / COVERAGE) ** 2
    at = causes.of("set-up")
    found[np.ix_(at, at)] += size_um**2 * np.outer(shift[:2], shift[:2])
    return found


def _as_ground(gear: CycloidGear, causes: FittedCauses, parts: Sequence[ProcessPart]) -> FloatArray:
    """The coefficients with the set-up as the parts had it on the mean."""
    found, effects = causes.value.copy(), setup_effects(gear)
    found[causes.of("x zero")] += effects[0] * np.mean([one.setup.x_um for one in parts])
    found[causes.of("dressing offset")] += effects[1] * np.mean([one.setup.dressing_um for one in parts])
    return found


def _setup_scatter(gear: CycloidGear, parts: Sequence[ProcessPart], gram: FloatArray, causes: FittedCauses) -> float:
    """Mean square of what the set-up values differed by from part to part, um^2."""
    at, effects = causes.of("set-up"), setup_effects(gear)
    moves = effects * np.array([[one.setup.x_um, one.setup.dressing_um] for one in parts])
    moves = moves - moves.mean(axis=0)
    return float(np.mean(np.einsum("ji,ik,jk->j", moves, gram[np.ix_(at, at)], moves)))


def _left_field(
    points: PlacedPoints, form: FittedForm, causes: FittedCauses, parts: int
) -> tuple[ProcessShare, ProcessShare]:
    """What no column makes of A, B, G: what repeats from part to part (the machine's), and what does not.

    Of one part all counts as the machine's: nobody has seen whether it repeats.
    """
    names = (words("S-PROC-AXES-SPACES"), words("S-PROC-REST"))
    total = points.e.size
    square = float(np.einsum("pi,pij,pj->", causes.left, points.normal, causes.left))
    freedom = max(3 * points.k.size - causes.value.size, 1)
    noise = form.s**2 * freedom / total
    own = points.k.size // parts
    if parts == 1 or not _alike(points, parts):
        return _rms_of(names[0], max(square / total - noise, 0.0), 2.0 * (square / total) ** 2 / freedom), ProcessShare(
            names[1], 0.0, 0.0
        )
    left = causes.left.reshape(parts, own, 3)
    normal = points.normal.reshape(parts, own, 3, 3)
    mean, off = left.mean(axis=0), left - left.mean(axis=0)
    each = float(np.einsum("jpi,jpik,jpk->", off, normal, off)) / total * parts / (parts - 1)
    common = float(np.einsum("pi,pij,pj->", mean, normal.mean(axis=0), mean)) * parts / total - each / parts
    degrees = 3.0 * own
    return (
        _rms_of(names[0], max(common, 0.0), 2.0 * (max(common, 0.0) + each / parts) ** 2 / degrees),
        _rms_of(names[1], max(each - noise, 0.0), 2.0 * each**2 / (degrees * (parts - 1))),
    )


def _alike(points: PlacedPoints, parts: int) -> bool:
    """Whether all parts were inspected at the same places."""
    counts = np.bincount(points.part, minlength=parts)
    if np.any(counts != counts[0]):
        return False
    k, z = points.k.reshape(parts, -1), points.z.reshape(parts, -1)
    return bool(np.all(k == k[0]) and np.all(np.abs(z - z[0]) <= HEIGHT_MM))


def _form_wear(points: PlacedPoints, form: FittedForm, gram: FloatArray) -> ProcessShare:
    name = words("S-PROC-WEAR-FORM")
    if form.growth is None:
        return ProcessShare(name, 0.0, 0.0)
    return _share(name, form.growth, form.growth_covariance, gram * float(np.mean(points.ramp**2)))


def _total(points: PlacedPoints) -> float:
    """RMS of all deviations, one rotation removed from all of them (each part's is a datum of its own)."""
    lever = points.shape[:, 2]
    rest = points.e.copy()
    for number in np.unique(points.part):
        here = points.part[points.of] == number
        rest[here] -= lever[here] * float(lever[here] @ rest[here]) / float(lever[here] @ lever[here])
    return float(np.sqrt(np.mean(rest**2)))


def _clampings(gear: CycloidGear, causes: FittedCauses, parts: Sequence[ProcessPart]) -> dict[str, EstimatedValue]:
    """Eccentricity in um and tilt in arcsec of each part; its name in front where there are several."""
    found = {}
    arcsec = rad_to_arcsec(um_to_mm(1.0) / (0.5 * gear.b))
    for number, part in enumerate(parts):
        front = f"{part.name}: " if len(parts) > 1 else ""
        for axis in "xy":
            found[f"{front}eccentricity_{axis}_um"] = causes.estimate(f"eccentricity {axis} {number}")
            tilt = causes.estimate(f"wobble {axis} {number}", arcsec, "arcsec")
            found[f"{front}wobble_{axis}_arcsec"] = tilt
    return found


def _with_diamond(points: PlacedPoints) -> tuple[tuple[str, str, float], ...]:
    """How an equal error of the profile goes with x zero and dressing offset."""
    design = np.concatenate([np.ones((points.e.size, 1)), points.shape], axis=1)
    inverse = np.linalg.inv(design.T @ design)
    scale = np.sqrt(np.diag(inverse))
    found = inverse[0, 1:3] / (scale[0] * scale[1:3])
    names = ("x zero", "dressing offset")
    return tuple(("diamond", n, float(r)) for n, r in zip(names, found, strict=True) if abs(r) >= CORRELATED)


def _correlations(causes: FittedCauses) -> tuple[tuple[str, str, float], ...]:
    """Pairs of set-up, clamping, rotation and wear that go together."""
    at = [n for n, one in enumerate(causes.columns) if one.cause in ("set-up", "clamping", "datum", "wear")]
    scale = np.sqrt(np.maximum(np.diag(causes.covariance), 1e-300))
    found = []
    for place, i in enumerate(at):
        for j in at[place + 1 :]:
            r = float(causes.covariance[i, j] / (scale[i] * scale[j]))
            if abs(r) >= CORRELATED:
                found.append((causes.columns[i].name, causes.columns[j].name, r))
    return tuple(found)


def _remarks(
    causes: FittedCauses, diamond: _Diamond, parts: Sequence[ProcessPart], *, named: bool
) -> Iterator[Message]:
    if named:
        code = "S-PROCESS-DIAMOND-WORN" if diamond.value < 0.0 else "S-PROCESS-DIAMOND-LARGE"
        yield Message.of(code, size=fixed(abs(diamond.value)), share=fixed(100.0 * diamond.explains, 0))
    if any(part.order is None for part in parts):
        yield Message.of("S-PROCESS-NO-ORDER", parts=", ".join(part.name for part in parts if part.order is None))
    elif not causes.drift_known:
        yield Message.of("S-PROCESS-FEW-SPACES")
    if len(parts) == 1:
        yield Message.of("S-PROCESS-ONE-PART")
