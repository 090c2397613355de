"""The closed loop of the wheel in the cell: form error, dresser table with its sense, diamond; judged by the truth."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.errors import TrueflankError
from gateway.gear.flank import flank_grid, inspect
from gateway.process.separation import separate
from gateway.process.wheel import (
    DresserTable,
    WheelCorrection,
    corrected_points,
    prove_sense,
    step_form,
    wheel_correction,
)
from tests.unit.process.shop import DISC, DISC_DISTANCE, Shop

FORM = {"form": [{"waves": 1.5, "left_um": 1.5, "right_um": 1.1}]}
TABLE = DresserTable(("axial", "correction"), "mm", "um", sign=1)


def give(shop: Shop, found: WheelCorrection, table: DresserTable = TABLE) -> None:
    """What a person types at the dresser."""
    rows = np.array(table.rows(found))
    shop.grinder.dresser.give(rows[:, 0], rows[:, 1])


def true_form(shop: Shop, work) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Mean surplus over spaces and heights of the true part, without what a shift or a turn makes: the wheel's form."""
    t = work.lobes.even(40)
    flank = work.surplus_um(np.arange(11), t, np.array([-3.0, 0.0, 3.0])).mean(axis=(0, 2))
    point, normal = work.lobes.profile(t)
    moves = np.stack([normal.real, normal.imag, (point.conjugate() * normal).imag], axis=1)
    return np.asarray(flank - moves @ np.linalg.lstsq(moves, flank, rcond=None)[0])


def true_figures(shop: Shop) -> dict[str, float]:
    """Largest profile form deviation and the pitch of the last part's true flanks, um."""
    work, grid = shop.grinder.last, flank_grid(DISC)
    chart = inspect(grid, 1e-3 * work.surplus_um(np.arange(11), grid.thetas, grid.zs))
    return {"f_falpha": 1e3 * float(chart.profile.f_f.max()), "F_p": 1e3 * max(one.F_p for one in chart.pitch)}


def test_one_dressing_takes_the_wheels_form_and_leaves_the_pitch() -> None:
    shop = Shop(FORM, {"ECC": [{"kind": "harmonic", "order": 3, "amplitude": 1.5}]})
    first, _ = shop.part()
    seen = true_figures(shop)
    found = separate(DISC, [first])
    before = true_form(shop, shop.grinder.last)
    assert np.ptp(before) > 2.5  # about 3 um
    share = found.share("wheel")
    assert abs(share.rms_um - np.sqrt(np.mean(before**2))) < 0.05
    give(shop, wheel_correction(DISC, DISC_DISTANCE, found, diamond_mm=0.5))
    shop.set_up(found.setup["x_um"].value, found.setup["dressing_um"].value)  # a wave has a shift in it, too
    second, _ = shop.part()
    after = true_figures(shop)
    assert after["f_falpha"] < 0.2 * seen["f_falpha"]
    assert after["F_p"] == pytest.approx(seen["F_p"], abs=0.05)
    assert np.ptp(true_form(shop, shop.grinder.last)) < 0.2 * np.ptp(before)
    assert separate(DISC, [second]).share("wheel").rms_um < 0.2 * share.rms_um


@pytest.mark.parametrize(
    ("truth", "verdict"), [({}, "proved"), ({"table_sign": -1}, "reversed"), ({"table_axial": -1}, "exchanged")]
)
def test_a_known_step_on_the_first_dressing_proves_the_sense(truth: dict[str, object], verdict: str) -> None:
    shop = Shop(FORM | truth)
    before = separate(DISC, [shop.part()[0]]).form
    give(shop, corrected_points(DISC, DISC_DISTANCE, step_form(DISC, before), diamond_mm=0.5))
    after = separate(DISC, [shop.part()[0]]).form
    proof = prove_sense(DISC, before, after)
    assert proof.verdict == verdict, proof


def test_a_worn_diamond_is_named_with_its_size_and_a_form_error_is_none() -> None:
    shop = Shop({"diamond_um": 4.0})
    found = separate(DISC, [shop.part()[0]])
    assert found.diamond_named
    assert found.diamond.value == pytest.approx(-4.0, abs=2.0 * found.diamond.u)
    assert [one.code for one in found.said if one.code.startswith("S-PROCESS-DIAMOND")] == ["S-PROCESS-DIAMOND-WORN"]
    plain = separate(DISC, [Shop(FORM).part()[0]])
    assert not plain.diamond_named


def test_the_dresser_table_is_written_in_the_builders_columns_units_and_sense() -> None:
    form = separate(DISC, [Shop(FORM).part()[0]]).form
    found = corrected_points(DISC, DISC_DISTANCE, form, diamond_mm=0.5)
    table = DresserTable(("correction", "axial", "radius"), "um", "mm", sign=-1, axial_sense=-1)
    rows = np.array(table.rows(found))
    assert np.all(np.diff(rows[:, 1]) > 0.0)
    # the mirror of the gear's axis: the last row is the first profile angle
    assert rows[-1] == pytest.approx(
        [-1e-3 * found.correction_um[0], -1e3 * found.axial_mm[0], 1e3 * found.radius_mm[0]]
    )
    along = np.array(DresserTable(("correction",), "mm", "um", 1, along="radial").rows(found))[:, 0]
    assert along == pytest.approx(found.correction_um / found.normal[:, 0])


def test_a_part_before_a_dressing_is_not_mixed_with_one_after() -> None:
    shop = Shop(FORM)
    first, _ = shop.part()
    give(shop, wheel_correction(DISC, DISC_DISTANCE, separate(DISC, [first]), diamond_mm=0.5))
    second, _ = shop.part()
    with pytest.raises(TrueflankError) as refused:
        separate(DISC, [first, second])
    assert refused.value.code == "E-PROCESS-MIXED"
