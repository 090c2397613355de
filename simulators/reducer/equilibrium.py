"""How a reducer comes to rest under torque with its input held: the least potential energy of its springs.

Theory of operation. Bodies are rigid; they touch through springs. With the input held at an angle, a pose x is the
output's angle psi and, for each disc, centre C and angle chi: 1 + 3 D unknowns. Its potential energy is

    V(x) = sum over pins, discs, slices of   c b p^(n+1) / (n+1)         p = (r - d)+   pin pressed into flank
         + sum over cranks, discs of         k s^2 / 2                   s = (|M - H| - clearance)+
         - T psi

d is the distance of the pin's centre from the disc's real outline: the outline is a closed chain of points, the nearest
is sought step by step along it, and a parabola through the squares of the distances of three neighbours gives the least
between them. Nothing is linearised about the nominal flank: pins, errors and motions of any size enter as they are. M
is the eccentric's middle (seat in the output plus eccentric, turned by the crank's angle), H the disc's hole. A held
sun lets the cranks turn when the output does: alpha = (1 + r) psi - r theta - error, r = z1/z2, so that dM/dpsi has a
part of theirs too; where the input is the crank itself, alpha is the input.

Forces are the gradient of V, exactly: for the least distance over a parabola the weights do not move to first order.
The rest position is the least V. It is found by descent with a metric that learns (BFGS). The first metric is that of a
gear with all pins half as stiff; later ones come from the changes of force on the way, and now and then the forces are
probed along each freedom. A step is taken if the energy falls by a part of what the slope promised. No tangent
stiffness of touching pins is formed and no set of them is kept: V is once differentiable where a pin comes to touch,
which is all that the descent needs. All crank angles are solved side by side. The start turns disc and output together
as one body until their moment is T, found by a bracket: the moment grows with the angle. With rigid cranks that is the
answer: a disc then goes where the mean of its eccentrics is.

Not modelled: tilting discs, bending pins, inertia, film of oil.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.errors import ConfigError
from simulators.reducer.parts import UM, ComplexArray, FloatArray, RealCurve, Reducer

ARCSEC = np.pi / 180.0 / 3600.0
FARTHEST_MM = 0.4
SOUGHT = 64
BESIDE = 1.2
HALVINGS = 60
ENOUGH_MM = 2e-8
STEPS = 240
SLIGHT_MM = 1e-4
PROBED, PROBE_MM, SOFTEST = 12, 1e-5, 1e-4
MOST_MM = 0.006
FALL = 1e-4
NOISE = 1e-13
LONGEST = 256.0
BALANCED = 1e-5
SETTLED = 3e-8
AT_ONCE = 240
"""Crank angles solved side by side: what they need at once stays in the processor's cache."""
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Reducers at rest for A inputs: output (A,) rad, its departure from input over ratio (A,) rad.

    ``force_n`` (A, D, J) of each pin on each disc along the flank's normal.
    """

    output_rad: FloatArray
    error_rad: FloatArray
    force_n: FloatArray


class Mechanism:
    """A reducer ready to be asked where it rests."""

    def __init__(self, reducer: Reducer, points: int | None = None) -> None:
        """``points`` of each space of the real outline (None: as many as usual)."""
        self.reducer = reducer
        self.curves = [RealCurve.of(reducer.gear, disc.flanks, *([points] if points else [])) for disc in reducer.discs]
        self.widths = [reducer.gear.b / len(one.points) for one in self.curves]
        cranks = reducer.cranks
        spread = np.exp(2j * np.pi * np.arange(cranks.count) / cranks.count)
        self.seats = (cranks.radius_mm + cranks.seat_um * UM) * spread
        self.holes = (cranks.radius_mm + cranks.hole_um * UM) * spread[:, None]
        phases = np.asarray([disc.phase_rad for disc in reducer.discs]) + cranks.phase_arcsec * ARCSEC
        self.eccentrics = (reducer.gear.a + cranks.eccentricity_um * UM) * np.exp(1j * phases)
        stage = reducer.stage
        self.stage = stage.sun_teeth / stage.planet_teeth if stage else None

    def rest(self, inputs_rad: ArrayLike, torque_nm: ArrayLike) -> Equilibrium:
        """Where the output rests for each input angle (A,) under a torque on it (A,) or one, Nm, + turning it on.

        Raises ConfigError (E-BENCH-TORQUE) for no torque, which leaves it free in its play, or for one under which it
        yields by more than its teeth allow.
        """
        inputs = np.atleast_1d(np.asarray(inputs_rad, dtype=np.float64))
        torque = np.broadcast_to(np.asarray(torque_nm, dtype=np.float64) * 1e3, inputs.shape)
        if not np.isfinite(torque).all() or (torque == 0.0).any():
            raise ConfigError("E-BENCH-TORQUE", "bench", why="a reducer without torque lies anywhere in its play")
        pieces = [slice(at, at + AT_ONCE) for at in range(0, len(inputs), AT_ONCE)]
        found = [_Batch(self, inputs[one], torque[one]).settle() for one in pieces]
        output, error = (np.concatenate([one[k] for one in found]) for k in (0, 1))
        return Equilibrium(output, error, np.concatenate([one[2] for one in found]))


class _Batch:
    """Some crank angles of one mechanism. Lengths of x: psi and chi times the rolling circle's radius, mm."""

    def __init__(self, of: Mechanism, inputs: FloatArray, torque: FloatArray) -> None:
        self.of, self.reducer = of, of.reducer
        self.inputs, self.torque = inputs, torque
        self.lever = self.reducer.lever_mm
        self.nominal = inputs / self.reducer.ratio
        self.discs = len(self.reducer.discs)
        count, pins = len(inputs), self.reducer.gear.zp
        slight = self.reducer.contact.n_mm_per_mm * self.reducer.gear.b * SLIGHT_MM * self.lever
        self.scale = np.maximum(np.abs(torque), slight)
        self._at = [self._first(d, count, pins) for d in range(self.discs)]
        self._hollow = [self._in_hollow(d) for d in range(self.discs)]

    def _first(self, d: int, count: int, pins: int) -> IntArray:
        """The nearest point of the outline to each pin (A, J, Z) by its kinematics; the search goes on from there."""
        disc, curve = self.reducer.discs[d], self.of.curves[d]
        angle = np.angle(self.reducer.ring.centres) - (self.nominal[:, None] + disc.mark_rad)
        at = curve.near(angle)[:, :, None]
        return np.broadcast_to(at, (count, pins, len(curve.points))).copy()

    def _in_hollow(self, d: int) -> tuple[IntArray, IntArray]:
        """Pins and slices (h,), counted through, near the bottom of a space, and where a second search begins.

        Pin and flank are nearly of one radius there: a real flank may come near a pin in two places.
        """
        curve, at = self.of.curves[d], self._at[d].ravel()
        off = at % curve.each - curve.each // 2
        which = np.flatnonzero(np.abs(off) < BESIDE * curve.hollow)
        self._at[d].ravel()[which] -= (off[which] + round(BESIDE * curve.hollow)).astype(np.int64)
        self._at[d] %= curve.points.shape[1]
        return which, (self._at[d].ravel()[which] + 2 * round(BESIDE * curve.hollow)) % curve.points.shape[1]

    # ------------------------------------------------------------------------------------------------ kinematics

    def _crank(self, psi: FloatArray, who: IntArray) -> tuple[FloatArray, float]:
        """Angle of the cranks in the housing, and what it gains with the output's."""
        theta, stage, r = self.inputs[who], self.reducer.stage, self.of.stage
        if stage is None or r is None:
            return theta, 0.0
        sun = theta - self.nominal[who]
        off = stage.once_arcsec * np.cos(sun) + stage.mesh_arcsec * np.cos(stage.sun_teeth * sun)
        return (1.0 + r) * psi - r * theta + off * ARCSEC, 1.0 + r

    def _eccentrics(self, psi: FloatArray, who: IntArray) -> tuple[ComplexArray, ComplexArray]:
        """Middles of the eccentrics (A, I, D) in the housing and how they move with the output's angle."""
        alpha, gain = self._crank(psi, who)
        seat = (self.of.seats * np.exp(1j * psi)[:, None])[:, :, None]
        arm = self.of.eccentrics * np.exp(1j * alpha)[:, None, None]
        return seat + arm, 1j * (seat + gain * arm)

    def _carried(self, psi: FloatArray, who: IntArray) -> tuple[ComplexArray, FloatArray, ComplexArray]:
        """Centres (A, D) and angles (A, D) of discs carried by the mean of rigid cranks, and dC/dpsi."""
        middle, moving = self._eccentrics(psi, who)
        holes = self.of.holes
        off = middle * np.exp(-1j * psi)[:, None, None] - holes
        mean = off.mean(axis=1)
        round_ = holes / np.abs(holes) ** 2
        turned = np.mean(np.imag((off - mean[:, None]) * np.conj(round_)), axis=1)
        centre = mean * np.exp(1j * psi)[:, None]
        return centre, psi[:, None] + turned, moving.mean(axis=1)

    # ------------------------------------------------------------------------------------------------- contacts

    def _pressed(
        self, d: int, centre: ComplexArray, chi: FloatArray, who: IntArray
    ) -> tuple[FloatArray, ComplexArray, FloatArray]:
        """Of every pin and slice (A, J, Z): how deep it is pressed in (mm), normal in the housing, lever."""
        ring, disc = self.reducer.ring, self.reducer.discs[d]
        turn = np.exp(-1j * (chi + disc.mark_rad))
        q = ((ring.centres - centre[:, None]) * turn[:, None])[:, :, None]
        square, foot = self._feet(d, q, who)
        distance = np.sqrt(square)
        normal = (q - foot) / distance
        depth = np.maximum(ring.radii[:, None] - distance, 0.0)
        lever = np.imag(np.conj(q) * normal)
        return depth, normal * np.conj(turn)[:, None, None], lever

    def _feet(self, d: int, q: ComplexArray, who: IntArray) -> tuple[FloatArray, ComplexArray]:
        """Square distance and foot of every pin and slice; in the hollows the nearer of what two searches find."""
        points, (inside, other) = self.of.curves[d].points, self._hollow[d]
        whole = self._at[d].shape
        square, foot, at = _nearest(points, q, self._at[d][who])
        self._at[d][who] = at
        if not inside.size:
            return square, foot
        place = np.full(whole[0], -1)
        place[who] = np.arange(len(who))
        turn, pin, slice_ = np.unravel_index(inside, whole)
        here = place[turn] >= 0
        row, pin, slice_ = place[turn[here]], pin[here], slice_[here]
        goal = q[row, pin, 0][:, None, None]
        second, beside, found = _nearest(points, goal, other[here][:, None, None], slice_[:, None, None])
        other[here] = found[:, 0, 0]
        nearer = second[:, 0, 0] < square[row, pin, slice_]
        better = row[nearer], pin[nearer], slice_[nearer]
        square[better], foot[better] = second[nearer, 0, 0], beside[nearer, 0, 0]
        return square, foot

    def _law(self, d: int, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Force and energy of each slice, N and N mm."""
        law = self.reducer.contact
        force = law.n_mm_per_mm * self.of.widths[d] * depth**law.exponent
        return force, force * depth / (1.0 + law.exponent)

    def _moment(self, psi: FloatArray, who: IntArray) -> FloatArray:
        """Moment that the pins put on an output with rigid cranks (A,), N mm; it grows with psi."""
        centre, chi, moving = self._carried(psi, who)
        total = np.zeros(len(psi))
        for d in range(self.discs):
            depth, normal, lever = self._pressed(d, centre[:, d], chi[:, d], who)
            force, _ = self._law(d, depth)
            pushed = np.real(np.conj(normal) * moving[:, d, None, None])
            total += np.sum(force * (pushed + lever), axis=(1, 2))
        return total

    # -------------------------------------------------------------------------------------------------- equilibrium

    def settle(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Output's angle, its departure, forces of the pins."""
        who = np.arange(len(self.inputs))
        psi = self._turned_on(who)
        centre, chi, _ = self._carried(psi, who)
        if self.reducer.cranks.stiffness_n_mm is not None:
            psi, centre, chi = self._least(psi, centre, chi)
        forces = []
        for d in range(self.discs):
            depth, _, _ = self._pressed(d, centre[:, d], chi[:, d], who)
            forces.append(self._law(d, depth)[0].sum(axis=2))
        return psi, psi - self.nominal, np.stack(forces, axis=1)

    def _turned_on(self, who: IntArray) -> FloatArray:
        """The output's angle at which rigid cranks carry the torque, by a bracket that is made smaller."""
        sign = np.sign(self.torque)
        low, high = np.zeros(len(who)), np.full(len(who), 2e-3)
        reach = FARTHEST_MM / self.lever * 0.5
        least = self._over(low - 2e-3, sign, who)
        low = np.where(self._over(low, sign, who) > 0.0, -2e-3, low)
        while (short := self._over(high, sign, who) < 0.0).any():
            if high[short].max() > reach:
                raise ConfigError("E-BENCH-TORQUE", "bench", why="the teeth yield by more than they are high")
            low, high = np.where(short, high, low), np.where(short, 1.6 * high, high)
        if (least > 0.0).any():
            raise ConfigError("E-BENCH-TORQUE", "bench", why="the parts are so thick that they cannot be put together")
        below, above = self._over(low, sign, who), self._over(high, sign, who)
        for step in range(HALVINGS):
            # The chord finds the last digits soon, halving makes sure of the first ones.
            share = np.where(step % 3 == 2, 0.5, np.clip(below / np.minimum(below - above, -1e-300), 0.02, 0.98))
            middle = low + share * (high - low)
            over = self._over(middle, sign, who)
            up = over > 0.0
            low, below = np.where(up, low, middle), np.where(up, below, over)
            high, above = np.where(up, middle, high), np.where(up, over, above)
            if np.max(high - low) * self.lever < ENOUGH_MM or np.max(np.abs(over) / np.abs(self.torque)) < 1e-7:
                break
        return self.nominal + sign * middle

    def _over(self, u: FloatArray, sign: FloatArray, who: IntArray) -> FloatArray:
        """Moment beyond the torque in the torque's sense for a departure u in that sense; it grows with u."""
        return -sign * self._external(self.nominal + sign * u, who) - np.abs(self.torque)

    def _external(self, psi: FloatArray, who: IntArray) -> FloatArray:
        """Moment of the pins on the output in the housing's sense: what holds the torque."""
        return -self._moment(psi, who)

    def _energy(self, x: FloatArray, who: IntArray) -> tuple[FloatArray, FloatArray]:
        """V (A,) in N mm and its gradient (A, n) in N at poses x (A, n), departures from the nominal pose in mm."""
        psi = self.nominal[who] + x[:, 0] / self.lever
        middle, moving = self._eccentrics(psi, who)
        cranks = self.reducer.cranks
        stiffness, clearance = float(cranks.stiffness_n_mm or 0.0), cranks.clearance_um * UM
        energy = -self.torque[who] * x[:, 0] / self.lever
        slope = np.zeros_like(x)
        slope[:, 0] = -self.torque[who] / self.lever
        for d in range(self.discs):
            centre, chi = self._pose(x, d, who)
            depth, normal, lever = self._pressed(d, centre, chi, who)
            force, stored = self._law(d, depth)
            energy = energy + np.sum(stored, axis=(1, 2))
            push = np.sum(force * normal, axis=(1, 2))
            twist = np.sum(force * lever, axis=(1, 2))
            hole = self.of.holes[:, d] * np.exp(1j * chi)[:, None]
            gap = middle[:, :, d] - centre[:, None] - hole
            length = np.abs(gap)
            squeeze = np.maximum(length - clearance, 0.0)
            pull = stiffness * squeeze * gap / np.maximum(length, 1e-12)
            energy = energy + 0.5 * stiffness * np.sum(squeeze**2, axis=1)
            push = push - pull.sum(axis=1)
            twist = twist - np.sum(np.real(np.conj(pull) * 1j * hole), axis=1)
            slope[:, 0] += np.sum(np.real(np.conj(pull) * moving[:, :, d]), axis=1) / self.lever
            slope[:, 1 + 3 * d], slope[:, 2 + 3 * d] = push.real, push.imag
            slope[:, 3 + 3 * d] = twist / self.lever
        return energy, slope

    def _pose(self, x: FloatArray, d: int, who: IntArray) -> tuple[ComplexArray, FloatArray]:
        """Centre and angle of a disc: x counts from the perfect disc's."""
        alpha = -self.nominal[who] * self.reducer.gear.zc
        centre = self.reducer.gear.a * np.exp(1j * (alpha + self.reducer.discs[d].phase_rad))
        return centre + x[:, 1 + 3 * d] + 1j * x[:, 2 + 3 * d], self.nominal[who] + x[:, 3 + 3 * d] / self.lever

    def _least(
        self, psi: FloatArray, centre: ComplexArray, chi: FloatArray
    ) -> tuple[FloatArray, ComplexArray, FloatArray]:
        """The pose of least energy from a first one. Raises ConfigError (E-BENCH-REST) where none is found."""
        every = np.arange(len(psi))
        x = np.zeros((len(psi), 1 + 3 * self.discs))
        x[:, 0] = (psi - self.nominal) * self.lever
        for d in range(self.discs):
            perfect, _ = self._pose(np.zeros_like(x), d, every)
            off = centre[:, d] - perfect
            x[:, 1 + 3 * d], x[:, 2 + 3 * d] = off.real, off.imag
            x[:, 3 + 3 * d] = (chi[:, d] - self.nominal) * self.lever
        x = self._descended(x, self._metric(x, every))
        centres, angles = zip(*(self._pose(x, d, every) for d in range(self.discs)), strict=True)
        return self.nominal + x[:, 0] / self.lever, np.stack(centres, axis=1), np.stack(angles, axis=1)

    def _metric(self, x: FloatArray, who: IntArray) -> FloatArray:
        """Inverse of a stiffness with all pins half as stiff and all bearings touching, (A, n, n) mm/N."""
        stiffness = float(self.reducer.cranks.stiffness_n_mm or 0.0)
        total = np.zeros((len(x), x.shape[1], x.shape[1]))
        _, moving = self._eccentrics(self.nominal[who], who)
        for d in range(self.discs):
            centre, chi = self._pose(x, d, who)
            _, normal, lever = self._pressed(d, centre, chi, who)
            spring = 0.5 * self.reducer.contact.n_mm_per_mm * self.of.widths[d]
            rows = np.stack((normal.real, normal.imag, lever / self.lever), axis=-1).reshape(len(x), -1, 3)
            part = slice(1 + 3 * d, 4 + 3 * d)
            total[:, part, part] += spring * np.swapaxes(rows, 1, 2) @ rows
            hole = 1j * self.of.holes[:, d] * np.exp(1j * chi)[:, None] / self.lever
            with_psi = moving[:, :, d] / self.lever
            for along in (np.real, np.imag):
                row = np.zeros((*hole.shape, x.shape[1]))
                row[:, :, 0] = along(with_psi)
                row[:, :, 1 + 3 * d], row[:, :, 2 + 3 * d] = -float(along(1.0)), -float(along(1j))
                row[:, :, 3 + 3 * d] = -along(hole)
                total += stiffness * np.swapaxes(row, 1, 2) @ row
        return np.linalg.inv(total).astype(np.float64)

    def _probed(self, x: FloatArray, slope: FloatArray, who: IntArray) -> FloatArray:
        """The metric (A, n, n) where a body is, by moving it a little along each freedom and reading the forces."""
        count = x.shape[1]
        found: FloatArray = np.empty((len(x), count, count))
        for k in range(count):
            moved = x.copy()
            moved[:, k] += PROBE_MM
            found[:, k] = (self._energy(moved, who)[1] - slope) / PROBE_MM
        size, way = np.linalg.eigh(0.5 * (found + np.swapaxes(found, 1, 2)))
        soft = np.maximum(np.abs(size), SOFTEST * np.max(np.abs(size), axis=1, keepdims=True) + 1e-9)
        inverse: FloatArray = (way / soft[:, None, :] @ np.swapaxes(way, 1, 2)).astype(np.float64)
        return inverse

    def _descended(self, x: FloatArray, first: FloatArray) -> FloatArray:
        """Descent with a learning metric, each crank angle by itself, until forces balance to `BALANCED`.

        At rest is also a pose whose energy falls by less than `SETTLED` (rad) times the torque in `PROBED` steps: a
        disc that floats in its play, or a crease of the energy where a pin rests on two places of a flank. Raises
        ConfigError (E-BENCH-REST).
        """
        who = np.arange(len(x))
        inverse, share = first.copy(), np.ones(len(x))
        least, settled = BALANCED * self.scale / self.lever, SETTLED * self.scale
        energy, slope = self._energy(x, who)
        before = np.full(len(x), np.inf)
        for count in range(STEPS):
            step = -np.einsum("aij,aj->ai", inverse[who], slope)
            going = (np.max(np.abs(step), axis=1) > ENOUGH_MM) | (np.max(np.abs(slope), axis=1) > least[who])
            if count % PROBED == PROBED - 1:
                going &= before[who] - energy > settled[who]
                before[who] = energy
            if not going.all():
                who, step, energy, slope = (one[going] for one in (who, step, energy, slope))
                if not len(who):
                    return x
            if count % PROBED == PROBED - 1:
                inverse[who], share[who] = self._probed(x[who], slope, who), 1.0
                step = -np.einsum("aij,aj->ai", inverse[who], slope)
            promised = np.einsum("ai,ai->a", step, slope)
            share[who] = np.minimum(share[who], MOST_MM / np.max(np.abs(step), axis=1))
            tried = x[who] + share[who, None] * step
            high, steep = self._energy(tried, who)
            good = high <= energy + FALL * share[who] * promised + NOISE * self.scale[who]
            inverse[who] = _learned(inverse[who], tried - x[who], steep - slope)
            x[who[good]] = tried[good]
            # Where the slope is hardly less after the step, a body moves in its play: the next step is longer.
            free = good & (np.einsum("ai,ai->a", step, steep) < 0.5 * promised)
            energy, slope = np.where(good, high, energy), np.where(good[:, None], steep, slope)
            share[who] = np.where(good, np.where(free, np.minimum(2.0 * share[who], LONGEST), 1.0), 0.4 * share[who])
        raise ConfigError("E-BENCH-REST", "bench", steps=STEPS, count=len(who))


def _learned(inverse: FloatArray, moved: FloatArray, grown: FloatArray) -> FloatArray:
    """The metric after a step (BFGS); one that met no spring teaches nothing."""
    work = np.einsum("ai,ai->a", moved, grown)
    sure = work > 1e-12 * np.linalg.norm(moved, axis=1) * np.linalg.norm(grown, axis=1) + 1e-300
    rho = np.where(sure, 1.0 / np.where(sure, work, 1.0), 0.0)
    left = np.eye(moved.shape[1]) - rho[:, None, None] * moved[:, :, None] * grown[:, None, :]
    new = left @ inverse @ np.swapaxes(left, 1, 2) + rho[:, None, None] * moved[:, :, None] * moved[:, None, :]
    return np.where(sure[:, None, None], new, inverse)


def _nearest(
    points: ComplexArray, q: ComplexArray, at: IntArray, row: IntArray | None = None
) -> tuple[FloatArray, ComplexArray, IntArray]:
    """Least square distance (A, J, Z) of q (A, J, 1) from chains (Z, m), its foot, and the nearest point's number.

    From ``at`` on along the chain of its slice, or of ``row``: by a stride that grows while it helps and shrinks
    where it does not.
    """
    count = points.shape[1]
    row = np.broadcast_to(np.arange(len(points)) if row is None else row, at.shape)
    here = _square(points, row, at, q)
    q_all = np.broadcast_to(q, at.shape)
    before, after = _square(points, row, at - 1, q), _square(points, row, (at + 1) % count, q)
    open_ = np.flatnonzero(((before < here) | (after < here)).ravel())
    if open_.size:
        place, rows, goal = at.ravel().copy(), row.ravel(), q_all.ravel()
        way = np.where(before.ravel()[open_] < here.ravel()[open_], -1, 1)
        value, stride = here.ravel().copy(), np.ones(open_.size, dtype=np.int64)
        still = open_
        for _ in range(SOUGHT):
            to = (place[still] + way * stride) % count
            found = _square(points, rows[still], to, goal[still])
            better = found < value[still]
            place[still], value[still] = np.where(better, to, place[still]), np.where(better, found, value[still])
            # A stride of one that does not help is tried the other way round before the place is left as it is.
            done = ~better & (stride == 1)
            stride = np.where(better, np.minimum(2 * stride, 16), np.maximum(stride // 4, 1))
            still, way, stride = still[~done], way[~done], stride[~done]
            if not still.size:
                break
        # A long stride may have passed the least: the last steps go back, one at a time.
        at = _stepped_back(points, rows, place, goal, open_).reshape(at.shape)
        here = _square(points, row, at, q)
        before, after = _square(points, row, at - 1, q), _square(points, row, (at + 1) % count, q)
    bend = before - 2.0 * here + after
    v = np.clip(0.5 * (before - after) / np.where(bend > 0.0, bend, np.inf), -1.0, 1.0)
    low, high = 0.5 * v * (v - 1.0), 0.5 * v * (v + 1.0)
    square = low * before + (1.0 - v * v) * here + high * after
    foot = low * points[row, at - 1] + (1.0 - v * v) * points[row, at] + high * points[row, (at + 1) % count]
    return square, foot, at


def _stepped_back(
    points: ComplexArray, rows: IntArray, place: IntArray, goal: ComplexArray, which: IntArray
) -> IntArray:
    count = points.shape[1]
    still = which
    for _ in range(4 * SOUGHT):
        here = _square(points, rows[still], place[still], goal[still])
        down = _square(points, rows[still], place[still] - 1, goal[still])
        up = _square(points, rows[still], (place[still] + 1) % count, goal[still])
        move = np.where((down < here) & (down <= up), -1, np.where(up < here, 1, 0))
        place[still] = (place[still] + move) % count
        still = still[move != 0]
        if not still.size:
            break
    return place


def _square(points: ComplexArray, row: IntArray, at: IntArray, q: ComplexArray) -> FloatArray:
    away = q - points[row, at]
    return np.asarray(away.real**2 + away.imag**2)
