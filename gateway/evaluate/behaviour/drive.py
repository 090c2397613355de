"""A reducer's figures from a record of its test bench: transmission error with its orders, and the loop of torque.

Definitions, as makers' catalogues have them (no standard's conformity is claimed):

* Transmission error: output less input over the ratio, one sense of rotation, one whole turn of the output, + where
  the output is ahead. Its figure is the largest less the smallest value; RMS about the mean. A record of several turns
  is averaged turn by turn. The error is put on equal steps of the output by a cubic spline, and left alone where it is
  so already; orders are then exact: order n is c_n = 2/N sum e exp(-i n theta), amplitude |c_n|, phase -arg c_n, so
  that e contains amplitude x cos(n theta - phase), theta being the output's angle.
* Hysteresis loop: the input locked, the torque on the output up and down. What the input yields is taken off. Its
  middle is the mean of the rising and the falling branch at a torque. Lost motion: middle at +3 % of the rated torque
  less middle at -3 %. Backlash: width of the loop at no torque. Stiffness: slope of the branches on which the torque
  grows between 50 % and 100 % of the rated one, both senses, mean.

Uncertainty (k = 2): p-p, lost motion and backlash are differences of two readings of the encoders, each of which may be
off by its own U; RMS and stiffness follow. Repeats of turns or loops add Student's interval of their mean. Without a
stated encoder there is no U: its once-per-turn error looks like the reducer's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import hypot, inf, sqrt

import numpy as np
import scipy

from drivers.message import digits, fixed
from drivers.types.drives import DriveRecord
from drivers.units import deg_to_arcsec, deg_to_rad, rad_to_deg
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.behaviour.order_causes import CauseKind, OrderCause

TURN_DEG = 360.0
FEWEST_STEPS, FEW_PINS, FEW_PINS_STEPS = 24, 24, 96
SMALL_SHARE, RATED_SHARE, HALF_SHARE, FULL_SHARE = 0.03, 1.0, 0.5, 0.99
LOCKED_DEG = 0.1
STANDS, LEAPS, LEAPT = 0.02, 5.0, 9
RATIO_OFF = 2e-4
JUMP_ARCSEC = 3600.0
CLOSES_ARCSEC = 10.0
MOST_ORDERS = 12
MOST_WAVES = 6
PROBABILITY = 0.9545
WARMS_K = 5.0
ARCSEC_PER_ARCMIN = 60.0


@dataclass(frozen=True, slots=True)
class TestedDrive:
    """What must be known of a reducer: ``pins``, ``ratio`` (input turns per output turn, signed), rated torque in Nm.

    ``cranks`` and ``sun_teeth`` name orders; the encoders' ``U`` (k = 2) in arcsec decide limits; None: not known.
    """

    pins: int
    ratio: float
    rated_torque_nm: float | None = None
    cranks: int | None = None
    sun_teeth: int | None = None
    output_encoder_U_arcsec: float | None = None
    input_encoder_U_arcsec: float | None = None

    @property
    def U_reading(self) -> float | None:
        """U of one reading of output less input over ratio, arcsec."""
        if self.output_encoder_U_arcsec is None:
            return None
        return hypot(self.output_encoder_U_arcsec, (self.input_encoder_U_arcsec or 0.0) / self.ratio)


@dataclass(frozen=True, slots=True)
class DriveOrder:
    """One order per turn of the output: amplitude in arcsec, phase in deg, what may cause it by its number."""

    order: int
    amplitude_arcsec: float
    phase_deg: float
    causes: tuple[OrderCause, ...] = ()


@dataclass(frozen=True, slots=True)
class RunningError:
    """Transmission error (N,) arcsec over equal steps of the output (N,) deg, mean removed; ``sense`` +1 or -1.

    ``each`` are the p-p of single turns; ``closing_arcsec`` is how far a turn's end is from its start. ``torque_nm`` is
    the mean torque, None where none was read.
    """

    sense: int
    angle_deg: FloatArray
    error_arcsec: FloatArray
    each: tuple[float, ...]
    closing_arcsec: float
    orders: tuple[DriveOrder, ...]
    torque_nm: float | None

    @property
    def peak_to_peak(self) -> float:
        """Largest less smallest, arcsec."""
        return float(np.ptp(self.error_arcsec))

    @property
    def rms(self) -> float:
        """About the mean, arcsec."""
        return float(np.sqrt(np.mean(self.error_arcsec**2)))

    def amplitude(self, order: int) -> float:
        """Of an order per turn of the output, arcsec; 0 beyond what the readings can show."""
        count = len(self.error_arcsec)
        wave = np.exp(-2j * np.pi * order * np.arange(count) / count)
        return float(abs(2.0 / count * np.sum(self.error_arcsec * wave))) if 2 * order < count else 0.0


@dataclass(frozen=True, slots=True)
class TorqueLoop:
    """A loop: torque (n,) Nm and twist (n,) arcsec as read; figures in arcsec and Nm per arcmin, None: not reached.

    ``each`` are the lost motions of single loops.
    """

    torque_nm: FloatArray
    twist_arcsec: FloatArray
    lost_motion: float
    backlash: float
    stiffness: float | None
    stiffness_span_arcsec: float
    each: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class DriveFigures:
    """Everything that a record tells of a reducer; ``notes`` are codes of the catalogue with their fields."""

    drive: TestedDrive
    running: tuple[RunningError, ...]
    loop: TorqueLoop | None
    notes: tuple[tuple[str, dict[str, object]], ...] = ()


def evaluate_drive(record: DriveRecord, drive: TestedDrive, where: str) -> DriveFigures:
    """The figures of one record, pure.

    Raises ModelError: E-DRIVE-VALUE for a drive that cannot be; E-DRIVE-TURN for less than a turn; E-DRIVE-ALIAS for
    too few readings in a turn of the crank; E-DRIVE-RATIO where angles and ratio differ; E-DRIVE-JUMP for a reading
    out of the line; E-DRIVE-TORQUE, E-DRIVE-RATED, E-DRIVE-RAMP, E-DRIVE-COARSE for a loop that shows nothing;
    E-DRIVE-EMPTY for a record with neither.
    """
    _check(drive, where)
    locked, passes = _stretches(record, drive)
    found = [_run(record, drive, one, where) for one in passes]
    running = tuple(
        _join_passes([one for one in found if one.sense == sense])
        for sense in (1, -1)
        if any(one.sense == sense for one in found)
    )
    loop = _loop(record, drive, locked, where) if locked is not None else None
    if not running and loop is None:
        raise ModelError("E-DRIVE-EMPTY", where)
    return DriveFigures(drive, running, loop, tuple(_notes(record, drive, running)))


def _check(drive: TestedDrive, where: str) -> None:
    rated = drive.rated_torque_nm
    wrong = {
        "pins": not 4 <= drive.pins <= 1000,
        "ratio": not 1.0 <= abs(drive.ratio) <= 1e5,
        "rated torque": rated is not None and not 0.0 < rated < inf,
    }
    for key, bad in wrong.items():
        if bad:
            raise ModelError("E-DRIVE-VALUE", where, key=key)


# --------------------------------------------------------------------------------------------------- parts of a record


def _stretches(record: DriveRecord, drive: TestedDrive) -> tuple[slice | None, tuple[slice, ...]]:
    """Where the input was locked, the longest such stretch, and every pass in one sense.

    A step much longer than usual is no part of a pass: the input was moved while nobody recorded.
    """
    count = len(record.input_deg)
    if np.ptp(record.input_deg) / abs(drive.ratio) < LOCKED_DEG:
        return slice(0, count), ()
    step = np.diff(record.input_deg)
    usual = float(np.percentile(np.abs(step), 75))
    usual = usual or float(np.max(np.abs(step)))
    way = np.where(np.abs(step) < STANDS * usual, 0, np.sign(step)).astype(int)
    way[np.abs(step) > LEAPS * usual] = LEAPT
    edges = [0, *(np.flatnonzero(np.diff(way)) + 1).tolist(), len(way)]
    parts = [(int(way[a]), slice(a, b + 1)) for a, b in pairwise(edges)]
    passes = tuple(one for sense, one in parts if sense in (1, -1) and one.stop - one.start > 2)
    # A row between two stretches may be the last of a pass: it is left to it.
    inner = [(sense, slice(one.start + (one.start > 0), one.stop - (one.stop < count))) for sense, one in parts]
    stands = [one for sense, one in inner if not sense and one.stop - one.start > 2 * MOST_ORDERS]
    longest = max(stands, key=lambda one: one.stop - one.start, default=None)
    moved = longest is not None and record.torque_nm is not None and np.ptp(record.torque_nm[longest]) > 0.0
    return (longest if moved else None), passes


def _run(record: DriveRecord, drive: TestedDrive, part: slice, where: str) -> RunningError:
    """One pass: its whole turns, on equal steps."""
    nominal = record.input_deg[part] / drive.ratio
    output = record.output_deg[part]
    error = deg_to_arcsec(output - nominal)
    step = np.diff(nominal)
    sense = 1 if step.mean() > 0.0 else -1
    turned = abs(float(nominal[-1] - nominal[0])) + float(np.median(np.abs(step)))
    line = int(record.lines[part][0])
    slope = _slope(nominal, output)
    if abs(slope - 1.0) > RATIO_OFF:
        seen = f"{drive.ratio / slope:.6g}" if slope else "none"
        raise ModelError("E-DRIVE-RATIO", where, line=line, stated=digits(drive.ratio, 6), found=seen)
    turns = int((turned + 1e-6) // TURN_DEG)
    if turns < 1:
        raise ModelError("E-DRIVE-TURN", where, line=line, turned=fixed(turned, 2))
    _refuse_jump(error, record.lines[part], where)
    _refuse_alias(float(np.max(np.abs(step))), drive, where)
    angle = _grid(nominal, sense, turns)
    curve = scipy.interpolate.CubicSpline(sense * nominal, error)
    each = np.stack([curve(sense * (angle + sense * TURN_DEG * k)) for k in range(turns)])
    over = abs(float(nominal[-1] - nominal[0])) >= TURN_DEG
    closing = float(curve(sense * nominal[-1]) - curve(sense * nominal[-1] - TURN_DEG)) if over else 0.0
    torque = None if record.torque_nm is None else float(np.mean(record.torque_nm[part]))
    single = tuple(float(np.ptp(one)) for one in each)
    return _with_orders(
        RunningError(
            sense=sense,
            angle_deg=angle,
            error_arcsec=each.mean(axis=0),
            each=single,
            closing_arcsec=closing,
            orders=(),
            torque_nm=torque,
        ),
        drive,
    )


def _slope(x: FloatArray, y: FloatArray) -> float:
    """Of y over x by readings half a pass apart, their median: single readings out of line do not turn it."""
    half = len(x) // 2
    return float(np.median((y[half:] - y[: len(y) - half]) / (x[half:] - x[: len(x) - half])))


def _grid(nominal: FloatArray, sense: int, turns: int) -> FloatArray:
    """Angles (N,) of the first of the middle whole turns in equal steps from a reading on.

    Where readings are in whole equal steps already, the angles are theirs.
    """
    step = float(np.median(np.abs(np.diff(nominal))))
    count = max(round(TURN_DEG / step), 1)
    over = len(nominal) - turns * count
    start = max(over // 2, 0)
    span = abs(float(nominal[-1] - nominal[start])) + step
    if span + 1e-6 < turns * TURN_DEG:
        start = 0
    return np.asarray(nominal[start] + sense * TURN_DEG * np.arange(count) / count)


def _refuse_jump(error: FloatArray, lines: FloatArray, where: str) -> None:
    off = np.abs(error - np.median(error))
    if off.max() > JUMP_ARCSEC:
        at = int(off.argmax())
        raise ModelError("E-DRIVE-JUMP", where, line=int(lines[at]), off=digits(off[at] / 3600.0, 3))


def _refuse_alias(step_deg: float, drive: TestedDrive, where: str) -> None:
    """The largest step decides: orders up to half a reading a step are seen, others fold onto them."""
    lobes = drive.pins - 1
    steps = TURN_DEG / (step_deg * lobes)
    if steps < FEWEST_STEPS * (1.0 - 1e-3):
        needed = FEWEST_STEPS * lobes
        raise ModelError("E-DRIVE-ALIAS", where, steps=digits(steps, 3), fewest=FEWEST_STEPS, needed=needed)


def _join_passes(runs: Sequence[RunningError]) -> RunningError:
    """Passes in one sense as one: the mean curve where they share their steps, the first one's otherwise."""
    first = runs[0]
    alike = [one for one in runs if one.angle_deg.shape == first.angle_deg.shape]
    if len(alike) < 2:
        return first
    curves = [
        scipy.interpolate.CubicSpline(*_round(one), bc_type="periodic")(np.mod(first.angle_deg, TURN_DEG))
        for one in alike
    ]
    each = tuple(value for one in runs for value in one.each)
    return replace(first, error_arcsec=np.mean(curves, axis=0), each=each)


def _round(run: RunningError) -> tuple[FloatArray, FloatArray]:
    """A turn from 0 to 360 deg, ascending and closed."""
    at = np.mod(run.angle_deg, TURN_DEG)
    order = np.argsort(at)
    x, y = at[order], run.error_arcsec[order]
    return np.append(x, x[0] + TURN_DEG), np.append(y, y[0])


# --------------------------------------------------------------------------------------------------------------- orders


def _with_orders(run: RunningError, drive: TestedDrive) -> RunningError:
    """The run with its mean taken off and its largest orders, with those that a reducer always has."""
    error = run.error_arcsec - run.error_arcsec.mean()
    count = len(error)
    theta = deg_to_rad(run.angle_deg)
    spectrum = np.fft.fft(error)[: count // 2] * 2.0 / count
    numbers = np.arange(count // 2)
    way = np.where(run.sense > 0, spectrum, np.conj(spectrum))
    turned = way * np.exp(-1j * numbers * theta[0])
    usual = {1, 2, drive.pins, drive.pins - 1, 2 * drive.pins, 2 * (drive.pins - 1)}
    largest = set((1 + np.argsort(np.abs(turned[1:]))[::-1][:MOST_ORDERS]).tolist())
    chosen = sorted((n for n in usual | largest if n < count // 2), key=lambda n: -abs(turned[n]))
    orders = tuple(
        DriveOrder(
            order=int(n),
            amplitude_arcsec=float(abs(turned[n])),
            phase_deg=float(rad_to_deg(np.asarray(-np.angle(turned[n])))),
            causes=causes(int(n), drive, count),
        )
        for n in chosen
    )
    return replace(run, error_arcsec=error, orders=orders)


def causes(order: int, drive: TestedDrive, readings: int) -> tuple[OrderCause, ...]:
    """What an order per turn of the output comes from, by number; nothing where no part of the drive has it.

    ``readings`` a turn: what repeats more often than half of them is folded and cannot be told from a low order.
    """
    zp, zc = drive.pins, drive.pins - 1
    waves = range(1, MOST_WAVES + 1)
    known = [(1.0, OrderCause(CauseKind.OUTPUT)), (2.0, OrderCause(CauseKind.OUTPUT_TWICE))]
    known += [
        (float(m * zp), OrderCause(CauseKind.DISC_OR_CRANKS if m == 1 else CauseKind.DISC, (m, 0))) for m in waves
    ]
    known += [(float(m * zc), OrderCause(CauseKind.RING, (0, m))) for m in waves]
    known += [(float(zp * zc), OrderCause(CauseKind.PROFILE))]
    if drive.cranks:
        known.append((float(drive.cranks), OrderCause(CauseKind.CRANKS)))
    if abs(drive.ratio) != zc:
        against = abs(drive.ratio - 1.0)
        known += [(against, OrderCause(CauseKind.AGAINST_PLANETS)), (abs(drive.ratio), OrderCause(CauseKind.INPUT))]
        known += [(against * drive.sun_teeth, OrderCause(CauseKind.SUN_TEETH))] if drive.sun_teeth else []
    found = [one for number, one in known if abs(order - number) < 0.5]
    found = found or _mixed_orders(order, drive)
    folded = [one for number, one in known if number > readings / 2.0 and _folds(number, readings) == order]
    return (*found, *(replace(one, folded=True) for one in folded))


def _mixed_orders(order: int, drive: TestedDrive) -> list[OrderCause]:
    """Sums and differences of disc and ring orders, which lost contact makes; the lowest one."""
    span = range(-MOST_WAVES, MOST_WAVES + 1)
    sums = [(abs(i) + abs(j), i, j) for i in span for j in span if i * drive.pins + j * (drive.pins - 1) == order]
    return [OrderCause(CauseKind.TOGETHER, (i, j)) for _, i, j in sorted(sums)[:1]]


def _folds(order: float, readings: int) -> int:
    return int(abs(round(order) - readings * round(order / readings)))


# ----------------------------------------------------------------------------------------------------------------- loop


def _loop(record: DriveRecord, drive: TestedDrive, part: slice, where: str) -> TorqueLoop:
    if record.torque_nm is None:
        raise ModelError("E-DRIVE-TORQUE", where)
    if drive.rated_torque_nm is None:
        raise ModelError("E-DRIVE-RATED", where)
    torque, rated = record.torque_nm[part], drive.rated_torque_nm
    twist = deg_to_arcsec(record.output_deg[part] - record.input_deg[part] / drive.ratio)
    _refuse_jump(twist, record.lines[part], where)
    small = SMALL_SHARE * rated
    branches = _branches(torque)
    rising = [one for one in branches if torque[one][0] <= -small and torque[one][-1] >= small]
    falling = [one for one in branches if torque[one][0] >= small and torque[one][-1] <= -small]
    if not rising or not falling:
        lowest, highest = (f"{100.0 * value / rated:.3g}" for value in (torque.min(), torque.max()))
        raise ModelError("E-DRIVE-RAMP", where, lowest=lowest, highest=highest)
    for one in (*rising, *falling):
        inside = np.abs(torque[one]) <= 2.0 * small
        widest = float(np.max(np.abs(np.diff(torque[one][inside])), initial=0.0)) if inside.sum() > 1 else inf
        if widest > small or inside.sum() < 4:
            share = "over 6" if not np.isfinite(widest) else f"{100.0 * widest / rated:.3g}"
            raise ModelError("E-DRIVE-COARSE", where, step=share, limit=digits(100.0 * SMALL_SHARE, 6))
    at = np.asarray([-small, 0.0, small])
    up = np.stack([_at(torque[one], twist[one], at) for one in rising])
    down = np.stack([_at(torque[one], twist[one], at) for one in falling])
    loops = min(len(up), len(down))
    middles = 0.5 * (up[:loops] + down[:loops])
    middle = 0.5 * (up.mean(axis=0) + down.mean(axis=0))
    stiffness, span = _stiffness(torque, twist, (*rising, *falling), rated)
    return TorqueLoop(
        torque_nm=torque,
        twist_arcsec=twist - middle[1],
        lost_motion=float(middle[2] - middle[0]),
        backlash=float(abs(down[:, 1].mean() - up[:, 1].mean())),
        stiffness=stiffness,
        stiffness_span_arcsec=span,
        each=tuple(float(one[2] - one[0]) for one in middles),
    )


def _branches(torque: FloatArray) -> list[slice]:
    """Stretches of one sense of the torque, from turning point to turning point; steps that stand belong to it."""
    found, start, way = [], 0, 0.0
    for k, step in enumerate(np.diff(torque).tolist()):
        sense = float(np.sign(step))
        if sense and way and sense != way:
            found.append(slice(start, k + 1))
            start = k
        way = sense or way
    return [*found, slice(start, len(torque))]


def _at(torque: FloatArray, twist: FloatArray, where: FloatArray) -> FloatArray:
    """Twist at torques; readings at one torque count as their mean."""
    levels, back = np.unique(torque, return_inverse=True)
    mean = np.bincount(back, weights=twist) / np.bincount(back)
    return np.asarray(np.interp(where, levels, mean))


def _stiffness(
    torque: FloatArray, twist: FloatArray, branches: Sequence[slice], rated: float
) -> tuple[float | None, float]:
    """Nm per arcmin on loading branches, mean of both senses, and the mean twist in arcsec that it was read from."""
    found, spans = [], []
    for sense in (1.0, -1.0):
        slopes = []
        for one in branches:
            load, turned = sense * torque[one], sense * twist[one]
            inside = (load >= HALF_SHARE * rated) & (load <= RATED_SHARE * rated * 1.001)
            grows = load[-1] > load[0]
            if grows and inside.sum() >= 3 and load[inside].max() >= FULL_SHARE * rated:
                slopes.append(1.0 / float(np.polyfit(load[inside], turned[inside], 1)[0]))
                spans.append(float(np.ptp(turned[inside])))
        if slopes:
            found.append(float(np.mean(slopes)))
    if len(found) < 2 or not np.isfinite(found).all():
        return None, 0.0
    return float(np.mean(found)) * ARCSEC_PER_ARCMIN, float(np.mean(spans))


# ---------------------------------------------------------------------------------------------------------- uncertainty


def expanded_uncertainty(readings: float, U_reading: float | None, each: Sequence[float]) -> float | None:
    """U (k = 2) of a figure from ``readings`` independent readings' weight (sqrt 2 for a difference) and its repeats.

    None without the encoders' U.
    """
    if U_reading is None:
        return None
    count = len(each)
    if count < 2:
        return readings * U_reading
    student = float(scipy.special.stdtrit(count - 1, 0.5 * (1.0 + PROBABILITY)))
    return hypot(readings * U_reading, student * float(np.std(each, ddof=1)) / sqrt(count))


def _notes(
    record: DriveRecord, drive: TestedDrive, running: Sequence[RunningError]
) -> list[tuple[str, dict[str, object]]]:
    found: list[tuple[str, dict[str, object]]] = []
    for run in running:
        if abs(run.closing_arcsec) > CLOSES_ARCSEC:
            found.append(("W-DRIVE-CLOSES", {"closing": f"{run.closing_arcsec:.1f}"}))
        steps = len(run.angle_deg) / (drive.pins - 1)
        if drive.pins < FEW_PINS and steps < FEW_PINS_STEPS * (1.0 - 1e-3):
            found.append(("W-DRIVE-FEW-STEPS", {"steps": f"{steps:.3g}", "wanted": FEW_PINS_STEPS}))
    if record.temperature_degc is not None and np.ptp(record.temperature_degc) > WARMS_K:
        found.append(("W-DRIVE-WARMS", {"kelvin": f"{np.ptp(record.temperature_degc):.1f}"}))
    if drive.output_encoder_U_arcsec is None:
        found.append(("W-DRIVE-ENCODER", {}))
    if record.time_s is None:
        found.append(("W-DRIVE-NO-TIME", {}))
    return [one for k, one in enumerate(found) if one not in found[:k]]
