"""What a curve leaves between its targets: held against drawn waves, long ones and ones too short for it."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.correct.outlook.flank_uncertainty import slope_and_bow
from gateway.domain.figures import Component
from gateway.model.components import value
from gateway.model.fit import fit_through

FACE_MM, APART_MM, U_UM = 10.0, 30.0, 0.05


def drawn(rng: np.random.Generator, wave_mm: float) -> tuple[Component, float]:
    """A curve through a wave of 1 um, and how far the wave varies from it over a face (RMS), its mean taken off."""
    at = np.linspace(0.0, 300.0, 11)
    at[1:-1] += rng.uniform(-0.2, 0.2, 9) * APART_MM
    phase = rng.uniform(0.0, 2.0 * np.pi)

    def wave(q: np.ndarray) -> np.ndarray:
        return np.cos(2.0 * np.pi * q / wave_mm + phase)

    means = wave(at) + rng.normal(0.0, U_UM, at.size)
    found = fit_through(at, means, U_UM, name="EXZ", axis="Z", axis_unit="mm")
    z = rng.uniform(40.0, 260.0) + np.linspace(-FACE_MM / 2.0, FACE_MM / 2.0, 9)
    missed = wave(z) - value(found, z)
    return found, float(np.std(missed))


@pytest.mark.parametrize("wave_mm", [90.0, 130.0, 200.0])
def test_long_waves_vary_little_over_a_face(wave_mm: float) -> None:
    """A curve follows waves of three target distances; what is told of them stays far below their size."""
    rng, rows = np.random.default_rng(4), []
    noise = U_UM * 2.0**0.5 * FACE_MM / APART_MM / 12.0**0.5
    for _ in range(300):
        found, missed = drawn(rng, wave_mm)
        rows.append((missed, np.hypot(np.hypot(*slope_and_bow(found, FACE_MM)), noise)))
    missed, told = np.sqrt(np.mean(np.square(rows), axis=0))
    print(f"{wave_mm} mm: true {missed:.3f} um, told {told:.2f} um")
    assert missed < min(0.05, told)
    assert told < 0.8
    assert np.sqrt(np.mean(np.square(np.divide(*np.transpose(rows))))) < 1.25


def test_structure_shorter_than_the_targets_show_counts_in_full() -> None:
    """Waves of 11 mm look like scatter from target to target: half of them and more is what a face then sees."""
    rng = np.random.default_rng(7)
    rows = [(drawn(rng, 11.0)[1], np.hypot(*slope_and_bow(drawn(rng, 11.0)[0], FACE_MM))) for _ in range(300)]
    missed, told = np.sqrt(np.mean(np.square(rows), axis=0))
    print(f"true {missed:.2f} um, told {told:.2f} um")
    assert 0.5 < missed / told < 1.6


def worn(between: tuple[float, float], wave_um: float = 0.0) -> tuple[float, float, float]:
    """Guides worn ``between`` two places: RMS of what varies over a face at 150 mm, of what is told, of the ratio."""
    rng, rows = np.random.default_rng(5), []
    for _ in range(300):
        length, depth, at = rng.uniform(35.0, 60.0), rng.uniform(4.0, 8.0), rng.uniform(*between)

        def hollow(q: np.ndarray, length: float = length, depth: float = depth, at: float = at) -> np.ndarray:
            within = np.abs(q - at) < length / 2.0
            wave = wave_um * np.cos(2.0 * np.pi * q / 130.0 + at)
            return wave + np.where(within, -depth * (1.0 + np.cos(2.0 * np.pi * (q - at) / length)) / 2.0, 0.0)

        targets = np.linspace(0.0, 300.0, 21)
        targets[1:-1] += rng.uniform(-3.0, 3.0, 19)
        means = hollow(targets) + rng.normal(0.0, U_UM, targets.size)
        found = fit_through(targets, means, U_UM, name="EXZ", axis="Z", axis_unit="mm")
        z = 150.0 + np.linspace(-FACE_MM, FACE_MM, 17)
        told = np.hypot(np.hypot(*slope_and_bow(found, 2.0 * FACE_MM, 150.0)), U_UM / 2.0)
        rows.append((float(np.std(hollow(z) - value(found, z))), told))
    missed, told = np.sqrt(np.mean(np.square(rows), axis=0))
    normalised = np.sqrt(np.mean(np.square(np.divide(*np.transpose(rows)))))
    print(f"true {missed:.2f} um, told {told:.2f} um, normalised {normalised:.2f}")
    return float(missed), float(told), float(normalised)


def test_a_hollow_of_a_worn_guide_counts_where_it_lies() -> None:
    """Three or four targets lie in a hollow where the wheel works; twenty others know nothing of it."""
    missed, told, normalised = worn((140.0, 160.0))
    assert 0.5 < missed / told < 1.25
    assert normalised < 1.6


def test_a_hollow_far_away_is_no_doubt_of_a_face_where_all_targets_are_in_line() -> None:
    """Targets closer together than a hollow is long would have shown another one here."""
    missed, told, normalised = worn((215.0, 275.0), wave_um=1.0)
    assert told < 0.2
    assert missed < 1.25 * told
    assert normalised < 1.6


def test_a_smooth_fit_counts_what_its_targets_scatter_about_it() -> None:
    smooth = Component("EXZ", "Z", "mm", "polynomial", (0.0, 300.0), np.zeros(3), np.zeros((3, 3)), residual_rms=0.4)
    assert np.hypot(*slope_and_bow(smooth, FACE_MM)) == pytest.approx(0.4)
