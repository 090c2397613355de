"""Every plausible drive has an equilibrium, at rated torque as where hardly a pin touches and parts squeeze each other.

Drives are drawn by seed from the shipped kinds: flanks with waves, scatter and lead, pins, holes and eccentrics by
twice their usual tolerance, clearance, stiffness, marks and both laws of contact. What is found is held against
mechanics: the output turns the further, the larger the torque; and the pins' forces times the levers of perfect parts,
a zc sin(phi) / sqrt(1 + K^2 - 2 K cos(phi)), make the torque.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.reducer.contact import Assembly
from gateway.reducer.figures import LADDER
from gateway.reducer.records import SHIPPED, Contact, Cranks, Reducer, phase_rad, shipped
from gateway.tooth import FlankMap
from tests.sizes import few
from tests.unit.reducer.drives import flank

SHARES = (-1.0, 3e-4, 0.03, 1.0)
ANGLES = 10
BLOCKS = [[8 * n + s for s in half] for n in range(25) for half in ((0, 5, 2, 7), (4, 1, 6, 3))]
"""Seeds of one drive of each shipped kind, two of them with either law of contact."""


def _disc(drive: Reducer, rng: np.random.Generator) -> FlankMap:
    gear, round_ = drive.gear, 2.0 * np.pi * np.arange(drive.gear.zc)[:, None, None] / drive.gear.zc
    depth, turn = rng.normal(0.0, 0.5, (2, gear.zc, 1, 1))
    for m in (1, 2, 3):
        depth = depth + rng.normal(0.0, 1.5) * np.cos(m * round_ + rng.uniform(0.0, 6.3))
        turn = turn + rng.normal(0.0, 1.5) * np.cos(m * round_ + rng.uniform(0.0, 6.3))
    lead = rng.normal(0.0, 0.3, (gear.zc, 1, 1)) * np.array([-1.0, 0.0, 1.0])
    return flank(gear, A=depth, G=(turn + lead) / drive.lever_mm, width=3)


def drawn(seed: int) -> tuple[Reducer, list[FlankMap]]:
    """A drive and its discs."""
    rng = np.random.default_rng(seed)
    drive = shipped(SHIPPED[seed % len(SHIPPED)], "crank-holes")
    zp, discs, count = drive.gear.zp, len(drive.discs), drive.output.number

    def row(sigma: float) -> tuple[float, ...]:
        return tuple(rng.normal(0.0, sigma, zp).tolist())

    def table(sigma: float) -> tuple[tuple[float, ...], ...]:
        return tuple(tuple(one) for one in rng.normal(0.0, sigma, (discs, count)).tolist())

    thin = drive.pins.radius_mm - rng.uniform(0.0, 0.004)
    pins = replace(drive.pins, radius_mm=thin, radius_um=row(1.0), radial_um=row(2.0), tangential_um=row(2.0))
    holes = rng.normal(0.0, 3.0, (discs, count, 2)).tolist()
    output = replace(
        drive.output,
        stiffness_n_mm=drive.output.stiffness_n_mm * rng.uniform(0.7, 2.0),
        clearance_um=rng.uniform(0.5, 3.0),
        hole_um=tuple(tuple((x, y) for x, y in one) for one in holes),
    )
    if isinstance(output, Cranks):
        output = replace(output, eccentricity_um=table(2.0), phase_arcsec=table(20.0))
    law = Contact(law="linear" if seed % 8 < 4 else "line")
    drive = replace(drive, pins=pins, output=output, contact=law, input_held="crank")
    marks = (0, *rng.integers(0, drive.gear.zc, discs - 1).tolist())
    return drive.with_marks(marks), [_disc(drive, rng) for _ in range(discs)]


@pytest.mark.parametrize("seeds", few(BLOCKS, 1, 12))
def test_plausible_drives_come_to_rest_at_any_torque(seeds: list[int]) -> None:
    for seed in seeds:
        drive, discs = drawn(seed)
        built = Assembly(drive, discs, slices=3)
        alpha = np.linspace(0.0, 2.0 * np.pi * drive.gear.zc, ANGLES, endpoint=False)
        poses = [built.solve(alpha, share * drive.rated_nm) for share in SHARES]
        turned = np.array([pose.psi for pose in poses])
        assert np.all(np.diff(turned, axis=0) >= -1e-9), seed
        pose = poses[-1]
        for share in LADDER:  # and on the way down, each from the pose before
            pose = built.solve(alpha, share * drive.rated_nm, pose)
        assert pose.psi == pytest.approx(turned[1], abs=2e-7), seed
        gear = drive.gear
        crank = alpha[:, None] + np.array([phase_rad(one) for one in drive.discs])
        phi = (2.0 * np.pi * np.arange(gear.zp) / gear.zp) - crank[..., None]
        lever = gear.a * gear.zc * np.sin(phi) / np.sqrt(1.0 + gear.K**2 - 2.0 * gear.K * np.cos(phi))
        moment = np.abs(np.sum(poses[-1].force * lever, axis=(1, 2))) / 1000.0
        assert moment == pytest.approx(np.full(ANGLES, drive.rated_nm), rel=0.08), seed
