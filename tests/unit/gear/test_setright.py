"""Set-up values put right on a part ground far off its zero: against the exact flank, ground anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.gear.cycloid import DressingError
from gateway.gear.envelope import exact
from gateway.gear.flank import FlankGrid, flank_figure
from gateway.gear.grinding import Grinding
from gateway.gear.process_drift import set_right, with_corrected_setup, with_curvature
from gateway.tooth import FlankMap
from tests.sizes import few
from tests.unit.correct.machines import machine


def flank(one: Grinding, grid: FlankGrid) -> FlankMap:
    e = np.broadcast_to(exact(one, grid.k, grid.theta, grid.z), grid.shape)
    return FlankMap(grid.thetas, grid.zs, 1e3 * e)


def fitted(seen: FlankMap, grid: FlankGrid) -> FlankMap:
    """As inspections tell it: shifts and turns at each place, which follow no curvature."""
    design = np.stack([grid.section.nx[:, 0], grid.section.ny[:, 0], grid.section.h[:, 0]], axis=1)
    return replace(seen, deviation_um=np.einsum("ts,ksz->ktz", design @ np.linalg.pinv(design), seen.deviation_um))


@pytest.mark.parametrize("seed", few([3, 0, 4], 1))
def test_curvature_is_in_a_part_as_ground_and_not_in_one_ground_anew(seed: int) -> None:
    grinding, grid = machine(seed)
    far = flank(replace(grinding, dressing=DressingError(offset=0.06, radius=0.10)), grid)
    true_right, true_anew = set_right(far, grinding.gear).rms_um, set_right(flank(grinding, grid), grinding.gear).rms_um
    told = with_curvature(fitted(far, grid), grinding.gear)
    assert true_right > true_anew + 0.15
    assert set_right(fitted(far, grid), grinding.gear).rms_um < true_right - 0.15  # without the curvature
    assert set_right(told, grinding.gear).rms_um == pytest.approx(true_right, abs=0.02)
    assert with_corrected_setup(told, grinding.gear).rms_um == pytest.approx(true_anew, abs=0.01)
    turned = flank_figure(told.deviation_um, grid.section.h).rotation
    still = replace(told, deviation_um=told.deviation_um - turned * grid.section.h)
    arcsec = np.degrees(turned / 1e3) * 3600.0
    assert with_corrected_setup(still, grinding.gear, arcsec).rms_um == pytest.approx(true_anew, abs=0.01)
    assert with_corrected_setup(far, grinding.gear).rms_um == pytest.approx(true_anew, abs=0.01)
