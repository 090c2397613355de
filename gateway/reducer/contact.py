"""Quasi-static loaded contact of a reducer: pose, output angle and forces at given crank angles; pure (mm, N, rad).

Theory. Crank angle alpha is given ("input locked"). Freedoms are the output angle psi and, with sprung cranks, the
place (x, y) and rotation chi of each disc about the pose of perfect parts: centre a e^{i (alpha + phase)}, angle
-alpha / zc. All are counted in mm (angles times a zc), so that the equations are well scaled.

Contact. Pin j seen from disc d is q = Rot(-chi - mark) (Q_j - C). Its foot t on the pin-centre curve
P0 = r_p e^{it} - a e^{i zp t} solves (q - P0) . P0' = 0 (Newton with the second derivative: at the bottom of a space
the curve has a radius below 0.1 mm and 5 um sideways turn the normal by degrees). With w = (q - P0) . n the gap of
slice s is w + r' - r_j - e(t, z_s), r' the modified pin radius of the profile, e the table of `surfaces`. This is the
least distance of pin and flank, exact up to e''. Space and side are frozen at the foot of perfect parts; levers where
one space ends are zero. Slices are parallel: discs do not tilt. Approach p = max(0, -gap), force F = f(p) b_s:
linear, f = c p, or Palmgren's line contact, f = (p / (3.84e-5 b^0.1))^(10/9).

Output. Crank i of disc d is a spring between the pin M = Rc e^{i (psi + eta_i)} + (a + da) e^{i (alpha + phase +
dphi)} and the hole H = C + (Rc e^{i eta_i} + hole) e^{i chi}: k (|M - H| - clearance)+ along M - H. Output pins of a
plain cycloid drive are the same spring without eccentric and with the clearance a more, and the bearing in the bore
is one that is not on the output. Rigid cranks leave psi alone.

Equilibrium is where the energy E(u) = sum of all springs - T psi is least. It is convex but for terms of the order
gap / radius and piecewise smooth; its Hessian is sum f'(p) b J J' with J = (N, h), and the springs' own. Newton with
that Hessian, a trust length and a step that is taken only if E falls (so contacts may open and close: the active set
is what touches at the pose), for all crank angles at once; the terms F / radius that the Hessian leaves out are below
1 % of c b and cost a step, never accuracy, for the residual is exact. It starts overwound, where everything that can
carry touches. Positions where Newton has ended leave the set.

Two touching sets may call each other for ever: a slice that opens in one step closes in the next, each step leaves
most of the fall of E behind it, and E creeps. What has not ended after `PLAIN_STEPS` steps therefore goes on with an
exact search along the step: E' along it is nearly piecewise linear, so the secant between its two ends is where E is
least, and Newton with that search ends on convex piecewise quadratic functions. It needs steps of bounded length: where
discs float, the Hessian is singular, and is lifted by |residual| / `LENGTH_MM` (regularised Newton for convex functions
with singular solutions), which vanishes as the residual does.

Held input. What is solved has the crank's angle in the housing held. Behind a first stage whose sun is held the
planets roll on it: alpha gains (1 + r) psi, r = z1 / z2. Then psi = e - (1 + r) psi / zc for the e found with alpha
held, so psi = e zc / (zp + r); and by virtual work the flanks carry T zc / (zp + r), for the sun carries the rest. Both
are `Reducer.followed`: torques are multiplied by it on the way in, output angles on the way out (e is taken at alpha
without its gain of some 1e-4 rad). Discs' places are those of the crank held.

T > 0 is an outside torque on the output, counter-clockwise, held by the flanks with h > 0. No friction, no inertia,
no film, no tilt, no temperature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, um_to_mm
from gateway.errors import ModelError
from gateway.reducer.feet import feet
from gateway.reducer.records import Contact, OutputPins, Reducer, eccentricity_mm, phase_rad
from gateway.reducer.surfaces import CELLS, EDGE, NODES, SLICES, Surfacing, check_map, rotation_table, surfacing
from gateway.tooth import FlankMap

CHUNK = 156  # crank angles solved together: what they need stays in the processor's cache
MOST_STEPS, EASED_STEPS, EASED = 120, 30, 3.0
TRUST_MM, NEAR_MM = 0.01, 1e-6
RESIDUAL = 1e-7  # of the force that the torque makes at the lever a zc
LEAST_N = 1e-4
INTERNAL = 5e-7  # of the sum of contact forces
FORWARD_MM = 1e-12
ENERGY_DIGITS = 1e-11
PLAIN_STEPS = 10  # of Newton, before the steps that cannot cycle
LENGTH_MM = 0.03  # longest of those steps where nothing resists
OVERSHOT = 0.3, 3.0  # of the slope at a step's start: where so much of it is against the step's end, it is cut
DAMPING = 1e-4  # of the same, at the first step that fails
STUCK = 1e3  # of the same: smaller steps change nothing any more; a kink of the contact, of a size that is no matter
SOFT = 1e-9  # of the contact's stiffness, where nothing touches
PALMGREN, PALMGREN_WIDTH, PALMGREN_POWER = 3.84e-5, 0.1, 10.0 / 9.0

Complex = NDArray[np.complex128]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Pose:
    """Equilibrium at N crank angles: ``psi`` (N,) of the output beyond -alpha/zc, rad, and what touches there.

    ``place`` (N, D, 3) are x, y (mm) and chi (rad) of each disc beyond perfect; ``force`` (N, D, J) by pin, N;
    ``pressure`` (N, D, J) the largest of its slices, MPa; ``approach`` (N, D, J) the deepest slice, mm.
    """

    psi: FloatArray
    place: FloatArray
    force: FloatArray
    pressure: FloatArray
    approach: FloatArray

    def at(self, rows: slice) -> Pose:
        """The poses at some of the crank angles."""
        return Pose(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})


@dataclass(frozen=True)
class _State:
    """At freedoms (n, U): energy (n,), gradient (n, U), Hessian (n, U, U), feet (n, D, J), sum of forces (n,)."""

    energy: FloatArray
    gradient: FloatArray
    hessian: FloatArray
    tau: FloatArray
    load: FloatArray

    def at(self, rows: Index) -> _State:
        return _State(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})


@dataclass(frozen=True)
class Touching:
    """Contacts between pins and flanks at poses of n angles: everything that equilibrium and first order need.

    Flat over the candidates (c,): ``row`` into (n, D, J), ``cell`` the nearest node of the table with ``share`` (3, c)
    of the node before, itself and the next,
    ``force`` and ``stiffness`` (c, S) by slice; ``normal`` (c,) in the fixed frame and lever ``h`` (c,).
    """

    shape: tuple[int, ...]
    tau: FloatArray
    row: Index
    cell: Index
    share: FloatArray
    depth: FloatArray
    force: FloatArray
    stiffness: FloatArray
    normal: Complex
    h: FloatArray
    energy: FloatArray


@dataclass(frozen=True, slots=True)
class Linearised:
    """First order at N poses: ``psi`` (N,), and ``slope`` (c, S) = d psi / d e, rad/mm, of the contacts that bear.

    ``step`` and ``disc`` of each, ``node`` the middle one of three in the stacked tables, ``share`` (3, c) of them.
    """

    psi: FloatArray
    step: Index
    disc: Index
    node: Index
    share: FloatArray
    slope: FloatArray


class Assembly:
    """A reducer with given discs, ready to be solved at any crank angles.

    ``flanks`` are one map per disc (None: nominal). Flanks alike over the width are one slice unless ``every_slice``.
    Raises ModelError E-REDUCER-... for what cannot be built.
    """

    def __init__(
        self, drive: Reducer, flanks: Sequence[FlankMap | None], *, slices: int = SLICES, every_slice: bool = False
    ) -> None:
        if len(flanks) != len(drive.discs):
            raise ModelError("E-REDUCER-COUNT", drive.name, key="discs", given=len(flanks), wanted=len(drive.discs))
        if any(flank is not None for flank in flanks):
            drive.measured_from()
        self.drive = drive
        gear = drive.gear
        self.lever = drive.lever_mm
        self._plain = replace(gear, drot=0.0)
        even = all(f is None or np.ptp(f.deviation_um, axis=2).max(initial=0.0) == 0.0 for f in flanks)
        self.slices = 1 if even and not every_slice else slices
        self.widths = np.full(self.slices, gear.b / self.slices)
        self._tables(flanks)
        self._ring()
        self._joints()
        self.mark = np.array([np.deg2rad(d.mark_angle_deg(gear.zc)) for d in drive.discs])
        self.phase = np.array([phase_rad(d) for d in drive.discs])

    # what stays as built ------------------------------------------------------------------------------------------

    def _tables(self, flanks: Sequence[FlankMap | None]) -> None:
        gear = self._plain
        turned = rotation_table(self.drive.gear)
        tables = np.empty((len(flanks), gear.zc, NODES, self.slices))
        for d, flank in enumerate(flanks):
            tables[d] = turned[:, None]
            if flank is not None:
                check_map(gear, flank)
                found = surfacing(gear, self.drive.pins.radius_mm, flank, slices=self.slices)
                self.surfacing: Surfacing = found  # of the last disc that is not nominal
                tables[d] += found.table(flank.deviation_um)
        self._highest = float(tables.max())
        self._e = np.ascontiguousarray(tables.reshape(-1, self.slices))

    def _ring(self) -> None:
        pins = self.drive.pins
        along = np.exp(2j * np.pi * np.arange(pins.number) / pins.number)
        radial, tangential, thick = (
            um_to_mm(np.asarray(v, dtype=np.float64)) if v else np.zeros(pins.number)
            for v in (pins.radial_um, pins.tangential_um, pins.radius_um)
        )
        self._pins = along * (pins.circle_mm + radial + 1j * tangential)
        self._radii = pins.radius_mm + thick

    def _joints(self) -> None:
        """Springs (D, I): arm with its error, base on the output, hole in the disc, stiffness, clearance."""
        drive, out = self.drive, self.drive.output
        D, count = len(drive.discs), out.number
        spokes = out.circle_mm * np.exp(2j * np.pi * np.arange(count) / count)
        hole = (
            np.asarray(out.hole_um, dtype=np.float64).reshape(D, count, 2) if out.hole_um else np.zeros((D, count, 2))
        )
        holes = spokes + um_to_mm(hole[..., 0] + 1j * hole[..., 1])
        base = np.broadcast_to(spokes, (D, count)).astype(np.complex128)
        if isinstance(out, OutputPins):
            bore = np.zeros((D, 1), dtype=np.complex128)
            self._base, self._hole = np.hstack([base, bore]), np.hstack([holes, bore])
            self._arm = np.hstack([np.zeros((D, count), dtype=np.complex128), bore + drive.gear.a])
            self._k = np.array([out.stiffness_n_mm] * count + [out.bearing_n_mm])
            free = drive.gear.a + um_to_mm(out.clearance_um)
            self._play = np.array([free] * count + [um_to_mm(out.bearing_um)])
            return
        a = np.array([[eccentricity_mm(drive, d, i) for i in range(count)] for d in range(D)])
        turned = np.asarray(out.phase_arcsec, dtype=np.float64) if out.phase_arcsec else np.zeros((D, count))
        self._arm = a * np.exp(1j * arcsec_to_rad(turned))
        self._base, self._hole = base, holes
        self._k = np.full(count, out.stiffness_n_mm)
        self._play = np.full(count, um_to_mm(out.clearance_um))

    # the contacts ---------------------------------------------------------------------------------------------------

    def perfect(self, alpha: FloatArray) -> tuple[Complex, Complex, Complex, FloatArray, Index]:
        """Perfect parts at crank angles (n,): centres, turns (n, D); turn back to space 0, foot, space (n, D, J)."""
        gear = self._plain
        crank = np.exp(1j * (alpha[:, None] + self.phase))
        turn = np.exp(-1j * (self.mark - alpha[:, None] / gear.zc))
        pitch = 2.0 * gear.half_pitch
        angles = 2.0 * np.pi * np.arange(gear.zp) / gear.zp
        t = angles + (alpha[:, None] / gear.zc - self.mark)[:, :, None]
        k = np.round(t / pitch)
        back = np.exp(-1j * pitch * k)
        return gear.a * crank, turn, back, t - pitch * k, np.mod(k, gear.zc).astype(np.intp)

    def touching(self, seat: _Seat, place: FloatArray, tau: FloatArray) -> Touching:
        """Contacts with the discs at ``place`` (n, D, 3): x, y, chi beyond perfect; ``tau`` are feet to start from."""
        gear = self._plain
        turn = seat.turn * np.exp(-1j * place[..., 2])
        local = turn[..., None] * seat.back
        q = (self._pins - (seat.centre + place[..., 0] + 1j * place[..., 1])[..., None]) * local
        tau, slope, curve = feet(gear, q, tau)
        speed = np.abs(slope)
        n = -1j * slope / speed
        off = q - curve.point
        gap = off.real * n.real + off.imag * n.imag + (gear.pin - self._radii)
        row = np.flatnonzero(gap < self._highest)
        where = np.clip((tau.ravel()[row] / gear.half_pitch + 1.0) * (0.5 * CELLS), 0.0, CELLS)
        near = np.rint(where)
        t = where - near
        cell = seat.first.ravel()[row] + near.astype(np.intp) + EDGE
        low, middle, high = self._e[cell - 1], self._e[cell], self._e[cell + 1]
        share = np.stack([0.5 * (0.5 - t) ** 2, 0.75 - t**2, 0.5 * (0.5 + t) ** 2])
        depth = share[0, :, None] * low + share[1, :, None] * middle + share[2, :, None] * high - gap.ravel()[row, None]
        np.maximum(depth, 0.0, out=depth)
        force, stiff, energy = self._law(depth)
        rise = [np.einsum("cs,cs->c", force, e) for e in (low, middle, high)]
        risen = (t - 0.5) * rise[0] - 2.0 * t * rise[1] + (t + 0.5) * rise[2]
        F, n_c, q_c = force.sum(axis=1), n.ravel()[row], q.ravel()[row]
        # The table's slope turns the normal: de = e_tau dt, dt = -(dq . P0') / f'
        tilt = risen / np.where(F > 0.0, F, 1.0) * (0.5 * CELLS / gear.half_pitch)
        n_c = n_c + tilt * slope.ravel()[row] / curve.second.ravel()[row]
        h = (1j * q_c * n_c.conj()).real
        normal = n_c * local.conj().ravel()[row]
        return Touching(
            shape=seat.first.shape,
            tau=tau,
            row=row,
            cell=cell,
            share=share,
            depth=depth,
            force=force,
            stiffness=stiff,
            normal=normal,
            h=h,
            energy=energy,
        )

    def _law(self, depth: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Force and stiffness by slice (c, S) and energy by contact (c,)."""
        contact: Contact = self.drive.contact
        if contact.law == "linear":
            k = contact.stiffness_n_mm2 * self.widths
            force = k * depth
            return force, k * (depth > 0.0), 0.5 * np.einsum("cs,cs->c", force, depth)
        unit, m = PALMGREN * self.drive.gear.b**PALMGREN_WIDTH, PALMGREN_POWER
        force = self.widths * (depth / unit) ** m
        stiff = m * force / np.maximum(depth, FORWARD_MM)
        return force, stiff, np.einsum("cs,cs->c", force, depth) / (m + 1.0)

    # equilibrium ----------------------------------------------------------------------------------------------------

    def solve(self, alpha: FloatArray, torque_nm: float, start: Pose | None = None) -> Pose:
        """Equilibrium at crank angles (N,) rad under the torque on the output. Raises ModelError E-REDUCER-...

        ``start`` is a pose at the same angles under a larger torque of the same sense.
        """
        alpha = np.asarray(alpha, dtype=np.float64)
        parts = []
        borne = torque_nm * self.drive.followed
        self._refuse_pressure(torque_nm, self._least_pressure(torque_nm))
        for first in range(0, alpha.size, CHUNK):
            rows = slice(first, first + CHUNK)
            seat = self._seat(alpha[rows])
            u = self._overwound(seat, torque_nm) if start is None else self._from(start, rows)
            parts.append(self._outcome(seat, self._equilibrium(seat, borne * 1000.0, u), borne * 1000.0))
        psi, place, force, depth, pressure = (np.concatenate(values) for values in zip(*parts, strict=True))
        self._refuse_pressure(torque_nm, float(pressure.max(initial=0.0)))
        return Pose(psi=psi * self.drive.followed, place=place, force=force, pressure=pressure, approach=depth)

    def _least_pressure(self, torque_nm: float) -> float:
        """MPa that no distribution of the torque avoids: every pin of every disc bears at this pressure.

        A contact at pressure p adds pi p^2 b h / (E c) to the torque (arm h, curvatures c together), and none more than
        where h / c is largest. Far beyond the limit no equilibrium is found, and the torque is named as the reason.
        """
        gear = self._plain
        section = gear.section(np.linspace(-np.pi, np.pi, 721))
        bend = 1.0 / self._radii.max() + section.curvature
        most = float((np.abs(section.h) / bend)[bend > 0.0].max())
        each = abs(torque_nm) * 1000.0 / (len(self.drive.discs) * gear.zp)
        return float(np.sqrt(each * self.drive.contact.reduced_mpa / (np.pi * gear.b * most)))

    def _refuse_pressure(self, torque_nm: float, pressure_mpa: float) -> None:
        if pressure_mpa > self.drive.contact.limit_mpa:
            limit, pressure = f"{self.drive.contact.limit_mpa:g}", round(pressure_mpa)
            raise ModelError("E-REDUCER-TORQUE", self.drive.name, torque=torque_nm, pressure=pressure, limit=limit)

    def linearised(self, alpha: FloatArray, torque_nm: float) -> Linearised:
        """How psi answers a surplus de (mm) on each slice of each contact that bears: -H^-1 sum f'(p) b J de."""
        parts = []
        borne = torque_nm * self.drive.followed
        for first in range(0, alpha.size, CHUNK):
            seat = self._seat(alpha[first : first + CHUNK])
            u = self._equilibrium(seat, borne * 1000.0, self._overwound(seat, torque_nm))
            state, touch = self._evaluate(seat, u, seat.tau, borne * 1000.0)
            parts.append(self._answer(u, state, touch, first))
        return Linearised(
            psi=np.concatenate([part.psi for part in parts]),
            step=np.concatenate([part.step for part in parts]),
            disc=np.concatenate([part.disc for part in parts]),
            node=np.concatenate([part.node for part in parts]),
            share=np.concatenate([part.share for part in parts], axis=1),
            slope=np.concatenate([part.slope for part in parts]),
        )

    def _answer(self, u: FloatArray, state: _State, touch: Touching, first: int) -> Linearised:
        D, L = len(self.drive.discs), self.lever
        unit = np.zeros((u.shape[0], self.freedoms, 1))
        unit[:, 0] = 1.0
        row = np.linalg.solve(state.hessian, unit)[..., 0]
        bears = np.flatnonzero(touch.force.sum(axis=1) > 0.0)
        where = touch.row[bears] // self._plain.zp
        step, disc = np.divmod(where, D)
        J = np.stack([touch.normal.real, touch.normal.imag, touch.h / L], axis=1)[bears]
        if self.freedoms == 1:
            along = row[step, 0] * J[:, 2]
        else:
            along = np.einsum("ci,ci->c", row[:, 1:].reshape(-1, D, 3)[step, disc], J)
        return Linearised(
            psi=u[:, 0] / L * self.drive.followed,
            step=step + first,
            disc=disc,
            node=touch.cell[bears],
            share=touch.share[:, bears],
            slope=-(along / L * self.drive.followed)[:, None] * touch.stiffness[bears],
        )

    def _seat(self, alpha: FloatArray) -> _Seat:
        centre, turn, back, tau, k = self.perfect(alpha)
        D = len(self.drive.discs)
        first = (np.arange(D)[:, None] * self._plain.zc + k) * NODES
        output = np.exp(-1j * alpha / self._plain.zc)
        return _Seat(alpha=alpha, output=output, centre=centre, turn=turn, back=back, tau=tau, first=first)

    @property
    def freedoms(self) -> int:
        """psi alone with rigid cranks, else also x, y and chi of each disc."""
        return 1 if self.drive.rigid else 1 + 3 * len(self.drive.discs)

    def places(self, u: FloatArray) -> FloatArray:
        """Disc places (n, D, 3) in mm, mm, rad of freedoms (n, U) in mm."""
        D, n = len(self.drive.discs), u.shape[0]
        if self.freedoms == 1:
            place = np.zeros((n, D, 3))
            place[..., 2] = u / self.lever
            return place
        place = u[:, 1:].reshape(n, D, 3).copy()
        place[..., 2] /= self.lever
        return place

    def _overwound(self, seat: _Seat, torque_nm: float) -> FloatArray:
        """Freedoms (n, U) turned so far that flanks and cranks of the torque's side touch."""
        sense = 1.0 if torque_nm >= 0.0 else -1.0
        mesh = um_to_mm(max(self.drive.mean_clearance_um, 0.0)) / float(np.sqrt(1.0 - self._plain.K**2))
        u = np.zeros((seat.alpha.size, self.freedoms))
        free = self._play[0] - (self._plain.a if isinstance(self.drive.output, OutputPins) else 0.0)
        crank = 0.0 if self.drive.rigid else free * self.lever / self.drive.output.circle_mm
        u[:, 0] = sense * (mesh + crank + 2.0 * FIRST_MM)
        u[:, 3::3] = sense * (mesh + FIRST_MM)
        return u

    def _from(self, start: Pose, rows: slice) -> FloatArray:
        psi, place = start.psi[rows] / self.drive.followed, start.place[rows]
        u = np.zeros((psi.size, self.freedoms))
        u[:, 0] = psi * self.lever
        if self.freedoms > 1:
            u[:, 1:] = (place * np.array([1.0, 1.0, self.lever])).reshape(psi.size, -1)
        return u

    def _evaluate(self, seat: _Seat, u: FloatArray, tau: FloatArray, torque: float) -> tuple[_State, Touching]:
        n, D, L = u.shape[0], len(self.drive.discs), self.lever
        place = self.places(u)
        touch = self.touching(seat, place, tau)
        disc = touch.row // self._plain.zp
        J = np.stack([touch.normal.real, touch.normal.imag, touch.h / L], axis=1)
        F, k = touch.force.sum(axis=1), touch.stiffness.sum(axis=1)
        g = np.stack([np.bincount(disc, F * J[:, i], n * D) for i in range(3)], axis=1).reshape(n, D, 3)
        H = np.empty((n * D, 3, 3))
        for i in range(3):
            for j in range(i, 3):
                H[:, i, j] = H[:, j, i] = np.bincount(disc, k * J[:, i] * J[:, j], n * D)
        H = H.reshape(n, D, 3, 3)
        energy = np.bincount(touch.row // (self._plain.zp * D), touch.energy, n) - torque / L * u[:, 0]
        load = np.asarray(np.bincount(touch.row // (self._plain.zp * D), F, n), dtype=np.float64)
        if self.freedoms == 1:
            gradient = g[:, :, 2].sum(axis=1)[:, None] - torque / L
            whole = H[:, :, 2, 2].sum(axis=1)[:, None, None]
            return _State(energy=energy, gradient=gradient, hessian=whole, tau=touch.tau, load=load), touch
        gradient, hessian = np.zeros((n, self.freedoms)), np.zeros((n, self.freedoms, self.freedoms))
        gradient[:, 0] = -torque / L
        energy = energy + self._springs(seat, u, place, gradient, hessian)
        for d in range(D):
            at = slice(1 + 3 * d, 4 + 3 * d)
            gradient[:, at] += g[:, d]
            hessian[:, at, at] += H[:, d]
        return _State(energy=energy, gradient=gradient, hessian=hessian, tau=touch.tau, load=load), touch

    def _springs(
        self, seat: _Seat, u: FloatArray, place: FloatArray, gradient: FloatArray, hessian: FloatArray
    ) -> FloatArray:
        """Adds the cranks' springs to gradient and Hessian; their energy (n,)."""
        L = self.lever
        out = (seat.output * np.exp(1j * u[:, 0] / L))[:, None, None]
        turned = (seat.output[:, None] * np.exp(1j * place[..., 2]))[:, :, None]
        base, hole = self._base * out, self._hole * turned
        centre = place[..., 0] + 1j * place[..., 1]
        # M - H without what perfect parts share (an output pin has no eccentric: its arm is -a against the disc's)
        arms = (seat.centre / self._plain.a)[:, :, None] * (self._arm - self._plain.a)
        delta = base + arms - hole - centre[:, :, None]
        far = np.abs(delta)
        safe = np.where(far > 0.0, far, 1.0)
        ratio = np.clip(1.0 - self._play / safe, 0.0, 1.0)
        ratio = np.where((self._play == 0.0) | ((far > 0.0) & (far > self._play)), ratio, 0.0)
        force = self._k * ratio * delta
        unit = np.where(far > 0.0, delta / safe, 0.0)
        along = self._k * np.where(ratio > 0.0, 1.0 - ratio, 0.0)
        across = self._k * ratio
        # columns of d(delta)/du for (psi, x, y, chi), complex
        columns = np.stack(
            np.broadcast_arrays(1j * base / L, -np.ones_like(delta), -1j * np.ones_like(delta), -1j * hole / L), axis=-1
        )
        slope = (columns.conj() * force[..., None]).real
        onto = (columns.conj() * unit[..., None]).real
        block = np.einsum("ndi,ndip,ndiq->ndpq", along, onto, onto)
        block += np.einsum("ndi,ndip,ndiq->ndpq", across, columns.real, columns.real)
        block += np.einsum("ndi,ndip,ndiq->ndpq", across, columns.imag, columns.imag)
        g = slope.sum(axis=2)
        for d in range(len(self.drive.discs)):
            at = np.array([0, 1 + 3 * d, 2 + 3 * d, 3 + 3 * d])
            gradient[:, at] += g[:, d]
            hessian[:, at[:, None], at] += block[:, d]
        squeezed = np.maximum(far - self._play, 0.0)
        return np.asarray(0.5 * np.einsum("i,ndi->n", self._k, squeezed**2))

    def _equilibrium(self, seat: _Seat, torque: float, u: FloatArray) -> FloatArray:
        least = max(RESIDUAL * abs(torque) / self.lever, LEAST_N)
        whole = self.drive.contact.stiffness_n_mm2 * self._plain.b
        damping = np.zeros(u.shape[0])
        left = np.arange(u.shape[0])
        part, (state, _) = seat, self._evaluate(seat, u, seat.tau, torque)
        for step in range(MOST_STEPS):
            miss = np.max(np.abs(state.gradient), axis=1)
            # Parts that squeeze each other keep fewer digits, and a contact at the kink of a tip fewer still
            limit = np.maximum(least, INTERNAL * state.load) * EASED ** (step // EASED_STEPS)
            going = (miss > limit) & ((damping[left] < STUCK * whole) | (miss > 1e3 * limit))
            if not np.all(going):
                left, state, part = left[going], state.at(np.flatnonzero(going)), part.at(np.flatnonzero(going))
            if not left.size:
                break
            late = step >= PLAIN_STEPS
            change = _newton(state, SOFT * whole + (miss[going] / LENGTH_MM if late else 0.0) + damping[left])
            trial, _ = self._evaluate(part, u[left] + change, state.tau, torque)
            if late:
                trial, change = self._least_along(part, u[left], torque, state, trial, change)
            fall = trial.energy - state.energy
            noise = ENERGY_DIGITS * np.abs(state.energy) + 1e-13
            now_miss = np.max(np.abs(trial.gradient), axis=1)
            # Very near, energies differ by fewer digits than forces: there the smaller residual is believed
            near = (np.max(np.abs(change), axis=1) < NEAR_MM) & (now_miss < 0.5 * miss[going])
            good = (fall <= -noise) | ((now_miss < miss[going]) & (fall <= noise)) | near
            u[left[good]] += change[good]
            now = damping[left]
            damping[left] = np.where(
                good, np.where(now > DAMPING * whole, 0.1 * now, 0.0), np.maximum(4.0 * now, DAMPING * whole)
            )
            state = _choose(good, trial, state)
        else:
            raise ModelError("E-REDUCER-EQUILIBRIUM", self.drive.name, count=left.size, steps=MOST_STEPS)
        return u

    def _least_along(
        self, seat: _Seat, u: FloatArray, torque: float, state: _State, trial: _State, change: FloatArray
    ) -> tuple[_State, FloatArray]:
        """Steps that overshoot cut to where the energy is least along them, by the secant of its slope."""
        before, after = (np.einsum("nu,nu->n", one.gradient, change) for one in (state, trial))
        over = np.flatnonzero((after > -OVERSHOT[0] * before) & (after < -OVERSHOT[1] * before))
        if not over.size:
            return trial, change
        share = before[over] / (before[over] - after[over])
        cut = change[over] * share[:, None]
        found, _ = self._evaluate(seat.at(over), u[over] + cut, state.tau[over], torque)
        lower = found.energy < trial.energy[over]
        at, change = over[lower], change.copy()
        change[at] = cut[lower]
        for one in fields(_State):
            getattr(trial, one.name)[at] = getattr(found, one.name)[lower]
        return trial, change

    def _outcome(
        self, seat: _Seat, u: FloatArray, torque: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        _, touch = self._evaluate(seat, u, seat.tau, torque)
        force, depth, pressure = (np.zeros(touch.shape) for _ in range(3))
        force.ravel()[touch.row] = touch.force.sum(axis=1)
        depth.ravel()[touch.row] = touch.depth.max(axis=1, initial=0.0)
        pressure.ravel()[touch.row] = self._pressure(touch)
        return u[:, 0] / self.lever, self.places(u), force, depth, pressure

    def _pressure(self, touch: Touching) -> FloatArray:
        """Largest Hertz pressure (c,) of the slices: sqrt(q E / (pi R)), q force per width, 1/R = 1/r + kappa."""
        tau = touch.tau.ravel()[touch.row]
        pin = self._radii[touch.row % self._plain.zp]
        bend = np.maximum(1.0 / pin + self._plain.section(tau).curvature, 0.0)
        load = (touch.force / self.widths).max(axis=1, initial=0.0)
        return np.sqrt(load * self.drive.contact.reduced_mpa * bend / np.pi)


FIRST_MM = 0.003  # overwound at the start


@dataclass(frozen=True)
class _Seat:
    """Perfect pose at crank angles (n,) and where each pin's table begins (n, D, J)."""

    alpha: FloatArray
    output: Complex
    centre: Complex
    turn: Complex
    back: Complex
    tau: FloatArray
    first: Index

    def at(self, rows: Index) -> _Seat:
        return _Seat(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})


def _newton(state: _State, damping: FloatArray) -> FloatArray:
    """Newton steps (n, U) with a damping (n,) N/mm on each freedom, none of whose parts is longer than the trust."""
    eye = np.eye(state.gradient.shape[1])
    change = -np.linalg.solve(state.hessian + damping[:, None, None] * eye, state.gradient[..., None])[..., 0]
    longest = np.max(np.abs(change), axis=1)
    return np.asarray(change * np.minimum(1.0, TRUST_MM / np.maximum(longest, 1e-300))[:, None])


def _choose(good: NDArray[np.bool_], new: _State, old: _State) -> _State:
    def pick(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.where(good.reshape(-1, *([1] * (a.ndim - 1))), a, b)

    return _State(**{one.name: pick(getattr(new, one.name), getattr(old, one.name)) for one in fields(new)})
