"""Uncertainty of a drive's figures by Monte Carlo, and the pairing of discs, held against every pairing there is."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.reducer import uncertainty as trials
from gateway.reducer.contact import Assembly
from gateway.reducer.figures import crank_angles
from gateway.reducer.pairing import match
from gateway.reducer.records import DiscPlace, Pins, Tolerances, for_gear
from gateway.reducer.uncertainty import drawn_drive, uncertainty
from gateway.tooth import FlankMap
from tests.unit.reducer.drives import ARCSEC, COARSE, coarse, flank, wave

TINY = CycloidGear(rp=36.0, rrp=2.5, a=1.5, zp=12, zc=11, b=10.0, drrp=0.006)


@pytest.fixture(autouse=True)
def _coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse(monkeypatch)


def test_scatter_of_pins_and_cranks_widens_and_raises_the_error_that_is_expected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(trials, "BLOCK", 2)
    drive = replace(for_gear(TINY, "crank-holes"), discs=(DiscPlace(),))
    part = wave(TINY, 2)
    usual = uncertainty(drive, [part], steps=COARSE, most=6)
    error = usual.figures["error_arcsec"]
    given = Assembly(drive, [part]).solve(crank_angles(drive, COARSE), drive.rated_nm).psi
    assert error.u > 0.0
    assert error.low < error.mean < error.high
    assert error.mean > np.ptp(given) * ARCSEC
    assert error.share_within(error.mean) == pytest.approx(0.5)
    assert usual.trials == 6


def test_no_tolerance_draws_the_drive_itself() -> None:
    drive = for_gear(TINY, "crank-holes")
    sure = Tolerances(pin_radius_um=0.0, pin_place_um=0.0, eccentricity_um=0.0, hole_um=0.0)
    drawn = drawn_drive(replace(drive, tolerances=sure), np.random.default_rng(1))
    assert not np.any([drawn.pins.radius_um, drawn.pins.radial_um, drawn.pins.tangential_um])
    assert not np.any(drawn.output.hole_um)


def test_what_was_measured_is_not_drawn_and_a_bore_as_datum_moves_all_holes_together() -> None:
    rng = np.random.default_rng(3)
    drive = for_gear(TINY, "bore")
    measured = replace(drive, pins=Pins(12, 36.0, 2.5, radius_um=(0.3,) * 12), tolerances=Tolerances(hole_um=0.0))
    drawn = drawn_drive(measured, rng)
    assert drawn.pins.radius_um == (0.3,) * 12
    assert len(drawn.pins.radial_um) == 12
    holes = np.asarray(drawn.output.hole_um)
    assert np.ptp(holes, axis=1) == pytest.approx(0.0)
    assert np.all(holes != 0.0)
    assert not np.any(drawn_drive(replace(measured, datum="crank-holes"), rng).output.hole_um)
    with pytest.raises(ModelError, match="E-REDUCER-TRIALS"):
        uncertainty(drive, [None, None], most=5)


def _discs(count: int) -> list[FlankMap]:
    rng = np.random.default_rng(4)
    k = 2.0 * np.pi * np.arange(11)[:, None, None] / 11
    return [
        flank(TINY, A=rng.normal() * np.cos(k + rng.uniform(0, 7)), B=rng.normal() * np.cos(2 * k))
        for _ in range(count)
    ]


def test_four_discs_are_paired_as_the_best_of_all_pairings_by_the_full_model() -> None:
    drive, discs = for_gear(TINY, "crank-holes"), _discs(4)
    drive = replace(drive, output=replace(drive.output, stiffness_n_mm=inf, clearance_um=0.0))  # rigid: solved at once
    marks = [6]
    found = match(drive, discs, marks=marks, steps=COARSE)
    alpha = crank_angles(drive, COARSE)

    def error(i: int, j: int) -> float:
        drives = [(drive.with_marks((0, m)), pair) for m in marks for pair in ((i, j), (j, i))]
        return min(
            max(np.ptp(Assembly(d, [discs[p], discs[q]]).solve(alpha, s * d.rated_nm).psi) * ARCSEC for s in (1, -1))
            for d, (p, q) in drives
        )

    pairings = [((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2))]
    totals = [error(*one) + error(*two) for one, two in pairings]
    assert sum(pair.error_arcsec for pair in found.pairs) <= 1.1 * min(totals)
    assert found.worth_arcsec >= 0.0
    assert sorted(n for pair in found.pairs for n in (pair.first, pair.second)) == [0, 1, 2, 3]
    assert found.left_over == ()


def test_of_three_discs_one_is_left_over_and_bad_requests_are_refused() -> None:
    drive, discs = for_gear(TINY, "crank-holes"), _discs(3)
    found = match(drive, discs, steps=COARSE)
    assert len(found.pairs) == 1
    assert len(found.left_over) == 1
    with pytest.raises(ModelError, match="E-REDUCER-MATCH"):
        match(drive, discs[:1])
    other = FlankMap(discs[0].theta_rad * 0.9, discs[0].z_mm, discs[0].deviation_um)
    with pytest.raises(ModelError, match="E-REDUCER-FLANK"):
        match(drive, [discs[0], other])
