"""One work piece: clamped somewhere, a blank until the wheel has passed, and then whatever the passes left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile.part import Clamping, Part
from simulators.grinding.entry import Poses, deepest
from simulators.grinding.lobes import Lobes, Rays
from simulators.grinding.wheel import WheelBody
from simulators.truth import generator
from simulators.truth.chain import Pose, still

FloatArray = NDArray[np.float64]
ARCSEC = np.pi / 180.0 / 3600.0
UM = 1e-3
SURELY_MM = 0.004


@dataclass(frozen=True, slots=True)
class Pass:
    """The wheel going once through one space. ``swell`` is the work's expansion beyond 20 degC, m/m."""

    space: int
    body: WheelBody
    poses: Poses
    swell: float


def clamped(clamping: Clamping, seed: int, *names: str) -> Pose:
    """Where a part comes to sit when somebody clamps it: its frame in that of the axis, drawn by the seed."""
    rng = generator(seed, "clamping", *names)
    x, y, a, b, turned = rng.normal(0.0, 0.5, 5)
    off, tilt = clamping.eccentric_um * UM, clamping.tilt_arcsec * ARCSEC
    return still((x * off, y * off, 0.0), (a * tilt, b * tilt, turned * clamping.turned_arcsec * ARCSEC))


class WorkPiece:
    """A disc with its true flanks, which the passes made so far have left. + = surplus material."""

    def __init__(self, spec: Part, number: int, seat: Pose) -> None:
        """``seat`` is the part's frame in the table's; z = 0 is the middle of the face width."""
        self.spec = spec
        self.number = number
        self.seat = seat
        self.lobes = Lobes(spec.gear)
        self._passes: dict[int, list[tuple[Pass, FloatArray]]] = {}

    @property
    def spaces(self) -> tuple[int, ...]:
        """Spaces the wheel has been in."""
        return tuple(sorted(self._passes))

    def place_of(self, space: int) -> int:
        """How many other spaces were ground before this one."""
        known = list(self._passes)
        return known.index(space) if space in self._passes else len(known)

    @property
    def passes(self) -> int:
        """How many times the wheel went through a space so far."""
        return sum(len(found) for found in self._passes.values())

    @property
    def finished(self) -> bool:
        """Whether every space has been ground."""
        return len(self._passes) == self.spec.gear.zc

    def cut(self, made: Pass) -> None:
        """The wheel went through a space once more; passes that later ones have cut away are forgotten."""
        known, depth = self._passes.setdefault(made.space, []), self._depth(made)
        if not np.isfinite(depth).all():
            known.append((made, depth))
        elif not any(np.all(depth > other + SURELY_MM) for _, other in known):
            known[:] = [one for one in known if not np.all(one[1] > depth + SURELY_MM)] + [(made, depth)]

    def _depth(self, made: Pass) -> FloatArray:
        """How deep a pass went at a few places of its space, (9,) mm."""
        z = 0.45 * self.spec.gear.b * np.asarray([-1.0, 0.0, 1.0])
        probes = self.lobes.rays(made.space, 0.9 * self.lobes.half * np.asarray([-1.0, 0.0, 1.0]), z)
        return deepest(made.body, made.poses, probes)

    def surface(self, space: int, rays: Rays) -> FloatArray:
        """How far along rays of the part's frame (at 20 degC) the surface of a space lies, (m,) mm.

        The blank's stock where no wheel went; -1 mm where it went much too deep.
        """
        left = np.full(len(rays.points), self.spec.grinding.stock_um * UM)
        for made, _ in self._passes.get(space, ()):
            grown = Rays(rays.points * (1.0 + made.swell), rays.directions)
            left = np.minimum(left, deepest(made.body, made.poses, grown) / (1.0 + made.swell))
        return left

    def surplus_um(self, spaces: FloatArray, t: FloatArray, z: FloatArray) -> FloatArray:
        """Surplus material along the nominal normals (K, T, Z) in um: the part in its own frame."""
        flanks = [self.surface(int(k), self.lobes.rays(int(k), t, z)).reshape(len(t), len(z)) for k in spaces]
        return np.stack(flanks) / UM
