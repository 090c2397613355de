"""The separation against deviations built here from closed forms of the cycloid, not by the gateway's gear code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.errors import TrueflankError
from gateway.gear.cycloid import CycloidGear
from gateway.process.separation import SHARES, separate
from gateway.process.wheel_form import ProcessPart
from gateway.tooth import SetupValues

GEAR = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0)
ORDER = tuple(range(39))
HEIGHTS = 10.0 * ((np.arange(5) + 0.5) / 5 - 0.5)  # as flanks are judged


class Flanks:
    """Places of a part's points and the three shapes, by complex numbers: pin centre minus pin radius times normal."""

    def __init__(self) -> None:
        half = np.pi / 39
        fine = np.linspace(0.0, half, 4001)
        along = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(self._curve(fine)[0])))))
        t = np.interp((np.arange(11) + 0.5) / 11 * 0.95 * along[-1], along, fine)  # as flanks are judged
        t = np.concatenate((-t[::-1], t))
        self.k, self.t, self.z = (one.ravel() for one in np.meshgrid(np.arange(39.0), t, HEIGHTS, indexing="ij"))
        point, normal = self._curve(self.t)
        self.nx, self.ny, self.lever = normal.real, normal.imag, (point.conjugate() * normal).imag
        self.share = np.sign(self.t) * np.interp(np.abs(self.t), fine, along) / along[-1]
        self.angle = 2.0 * np.pi * self.k / 39

    @staticmethod
    def _curve(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first, second = 64.0 * np.exp(1j * t), 1.3 * np.exp(40j * t)
        normal = first - 40 * second
        normal = normal / np.abs(normal)
        return first - second - 3.0 * normal, normal

    def part(self, name: str, e: np.ndarray, seed: int, **options: object) -> ProcessPart:
        """With noise of 0.2 um."""
        noisy = e + np.random.default_rng(seed).normal(0.0, 0.2, e.shape)
        return ProcessPart(name, self.k, self.t, self.z, noisy, **({"order": ORDER} | options))  # type: ignore[arg-type]


F = Flanks()
WAVE = np.cos(3.0 * np.pi * F.share) * np.where(F.t > 0, 2.0, 1.0)
ECCENTRIC = 3.0 * (np.cos(F.angle) * F.nx - np.sin(F.angle) * F.ny)
WOBBLE = 1.5 * F.z / 5.0 * (np.sin(F.angle) * F.nx + np.cos(F.angle) * F.ny)
INDEX = 1.2 * np.cos(4.0 * F.angle) * F.lever / 64.0
LEAN = 0.8 * F.z / 5.0 * F.nx
WEAR = 1.6 * (F.k / 38.0 - 0.5) * F.nx
SETUP = 4.0 * F.nx - 2.0 * F.ny
CLEAN = np.stack((F.nx, F.ny, F.lever), axis=1)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def outside(values: np.ndarray) -> np.ndarray:
    """Without what a shift and a turn of the gear make: those belong to set-up and datum."""
    return np.asarray(values - CLEAN @ np.linalg.lstsq(CLEAN, values, rcond=None)[0])


def test_each_cause_is_found_with_its_size_within_its_uncertainty() -> None:
    whole = WAVE + ECCENTRIC + WOBBLE + INDEX + LEAN + WEAR + SETUP
    found = separate(GEAR, [F.part("a", whole, 1)])
    wanted = {
        "wheel": rms(outside(WAVE)),
        "axes": rms(INDEX + LEAN),
        "clamping": rms(ECCENTRIC + WOBBLE),
        "wear": rms(WEAR),
    }
    for name, value in wanted.items():
        share = found.share(name)
        assert share.rms_um == pytest.approx(value, abs=3.0 * share.u_um + 0.01), name
    assert tuple(one.name for one in found.shares) == SHARES
    assert found.share("rest").rms_um == pytest.approx(0.2, abs=0.01)
    assert found.share("wheel, left flank").rms_um > 1.5 * found.share("wheel, right flank").rms_um
    assert found.wear["depth_um"].value == pytest.approx(1.6, abs=3.0 * found.wear["depth_um"].u)
    assert found.clamping["eccentricity_x_um"].value == pytest.approx(3.0, abs=0.1)
    assert found.clamping["wobble_y_arcsec"].value == pytest.approx(np.rad2deg(1.5e-3 / 5.0) * 3600.0, rel=0.02)
    pure = np.linalg.lstsq(CLEAN, WAVE + SETUP, rcond=None)[0]  # a wave has a shift in it as well
    assert found.setup["x_um"].value == pytest.approx(pure[0], abs=0.05)  # surplus asks for more infeed
    assert found.setup["dressing_um"].value == pytest.approx(-pure[1], abs=0.3)


def test_shares_of_a_perfect_process_are_zero_within_their_uncertainty() -> None:
    found = separate(GEAR, [F.part("a", np.zeros_like(F.k), 2)])
    for share in found.shares[:-1]:
        assert share.rms_um <= 2.0 * share.u_um + 0.005, share
        assert share.u_um < 0.35, share


def test_uncertainties_hold_over_many_draws() -> None:
    """Chi-square of coefficients over 24 noises: neither far too small nor far too large."""
    depth, wheel = [], []
    for seed in range(8):
        found = separate(GEAR, [F.part("a", WAVE + WEAR + SETUP, 100 + seed)])
        depth.append((found.wear["depth_um"].value - 1.6) / found.wear["depth_um"].u)
        wheel.append((found.share("wheel").rms_um - rms(outside(WAVE))) / 0.01)
    assert 0.3 < float(np.std(depth)) < 1.6
    assert abs(float(np.mean(wheel))) < 1.5


def test_a_large_shift_of_the_set_up_makes_no_form() -> None:
    """The flank of a space that is 80 um too deep, exact: nearest points of the moved curve, by search."""
    t = np.linspace(-1.3, 1.3, 200001) * np.pi / 39
    moved = Flanks._curve(t)[0] - 0.08
    here = (F.k == 0) & (np.abs(F.z) < 0.1)
    point, normal = Flanks._curve(F.t[here])
    one = np.empty(point.size)
    for number, (p, n) in enumerate(zip(point, normal, strict=True)):
        across = ((moved - p) * n.conjugate()).imag
        near = np.abs(moved - p) < 0.5
        at = np.flatnonzero(near[:-1] & (np.sign(across[:-1]) != np.sign(across[1:])))[0]
        share = across[at] / (across[at] - across[at + 1])
        one[number] = (((1.0 - share) * moved[at] + share * moved[at + 1] - p) * n.conjugate()).real
    e = 1e3 * np.tile(np.repeat(one, HEIGHTS.size), 39)
    found = separate(GEAR, [F.part("a", e, 3)])
    assert found.share("wheel").rms_um < 0.05
    assert found.setup["x_um"].value == pytest.approx(-80.0, abs=1.0)


def test_several_parts_tell_what_repeats() -> None:
    """An index error of its own in each space: with one part it counts as the machine's, with two the rest is named."""
    rng = np.random.default_rng(8)
    same, other, third = (rng.normal(0.0, 1.0, 39)[F.k.astype(int)] * F.lever / 64.0 for _ in range(3))
    parts = [F.part("a", WAVE + same + 0.5 * other, 4), F.part("b", WAVE + same + 0.5 * third + ECCENTRIC, 5)]
    found = separate(GEAR, parts)
    assert found.share("axes").rms_um == pytest.approx(rms(same), rel=0.2)
    assert found.share("rest, not repeated").rms_um == pytest.approx(0.5 * rms(other), rel=0.35)
    assert found.clamping["b: eccentricity_x_um"].value == pytest.approx(
        3.0, abs=3.0 * found.clamping["b: eccentricity_x_um"].u
    )


def test_known_set_up_values_are_counted_from() -> None:
    """The second part was ground 5 um deeper: both ask for the same x zero."""
    parts = [F.part("a", SETUP, 6), F.part("b", SETUP - 5.0 * F.nx, 7, setup=SetupValues(x_um=5.0))]
    assert separate(GEAR, parts).setup["x_um"].value == pytest.approx(4.0, abs=0.1)


def test_a_diamond_too_small_is_told_from_a_shift() -> None:
    found = separate(GEAR, [F.part("a", -3.0 + SETUP, 9)], size_um=0.1)
    assert found.diamond_named
    assert found.diamond.value == pytest.approx(-3.0, abs=0.3)
    assert ("diamond", "x zero") in {pair[:2] for pair in found.correlations}
    assert found.share("dresser").rms_um == pytest.approx(rms(outside(np.full_like(F.k, 3.0))), abs=0.05)


def test_order_of_grinding_decides_what_wear_is() -> None:
    order = tuple((7 * n) % 39 for n in range(39))
    place = np.argsort(order)[F.k.astype(int)]
    worn = 1.6 * (place / 38.0 - 0.5) * F.nx
    found = separate(GEAR, [F.part("a", WAVE + worn, 10, order=order)])
    assert found.wear["depth_um"].value == pytest.approx(1.6, abs=0.1)
    unknown = separate(GEAR, [F.part("a", WAVE + worn, 10, order=None)])
    assert unknown.share("wear").rms_um == 0.0
    assert "S-PROCESS-NO-ORDER" in {one.code for one in unknown.said}


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"deviation_um": 1e-3 * (WAVE + 0.2)}, "E-PROCESS-UNIT"),
        ({"order": (0, 1, 2)}, "E-PROCESS-ORDER"),
        ({"order": (0, *range(38))}, "E-PROCESS-ORDER"),
        ({"theta_rad": np.abs(F.t)}, "E-PROCESS-EMPTY"),
    ],
)
def test_wrong_input_is_refused(change: dict[str, object], code: str) -> None:
    with pytest.raises(TrueflankError) as refused:
        separate(GEAR, [replace(F.part("a", WAVE, 1), **change)])  # type: ignore[arg-type]
    assert refused.value.code == code


def test_parts_of_two_dressings_are_not_mixed() -> None:
    with pytest.raises(TrueflankError) as refused:
        separate(GEAR, [F.part("a", WAVE, 1, dressing="1"), F.part("b", WAVE, 2, dressing="2")])
    assert refused.value.code == "E-PROCESS-DRESSINGS"
    with pytest.raises(TrueflankError) as refused:
        separate(GEAR, [F.part("a", WAVE, 1), F.part("b", 0.5 * WAVE, 2)])
    assert refused.value.code == "E-PROCESS-MIXED"
    assert separate(GEAR, [F.part("a", WAVE, 1), F.part("b", WAVE, 2)]).parts == ("a", "b")
