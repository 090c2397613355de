"""The registry of standards: names, editions, certainty; gaps flagged for all of them; verdicts."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import ArrayLike

from drivers.units import AxisUnit
from gateway.errors import ModelError
from gateway.evaluate.behaviour.doubts import doubts_of
from gateway.evaluate.standards import registry
from gateway.evaluate.standards.conformity import RULE, decide
from gateway.evaluate.standards.registry import evaluate_by, standard, standards
from gateway.evaluate.uncertainty.budget import Budget, file_budget
from tests.steps import said
from tests.unit.evaluate.test_other_standards import X

AT = np.array([0.0, 90.0, 210.0, 290.0, 400.0])
SHAPES = st.tuples(st.integers(2, 7), st.integers(2, 5), st.just(2))
READINGS = SHAPES.flatmap(lambda shape: arrays(np.float64, shape, elements=st.floats(-50, 50, width=32)))


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ("2014", "ISO 230-2:2014"),
        ("1988", "ISO 230-2:1988"),
        ("ISO230-2:1997", "ISO 230-2:1997"),
        ("iso 230-2", "ISO 230-2:2014"),
        ("GB/T 17421.2-2016", "GB/T 17421.2-2016"),
        ("gbt17421.2", "GB/T 17421.2-2023"),
        ("17421.2-2000", "GB/T 17421.2-2000"),
        ("VDI 3441", "VDI/DGQ 3441:1977"),
        ("VDI/DGQ 3441", "VDI/DGQ 3441:1977"),
        ("3441", "VDI/DGQ 3441:1977"),
        ("ASME B5.54", "ASME B5.54-2005"),
        ("b5.54-1992", "ASME B5.54-1992"),
        ("jis b 6330", "JIS B 6330:1980"),
        ("JIS B 6190-2", "JIS B 6190-2:2016"),
        ("NMTBA", "NMTBA:1972"),
        ("NMTBA:1972 without offset", "NMTBA:1972 without offset"),
    ],
)
def test_names_are_found_as_people_write_them(asked: str, found: str) -> None:
    assert standard(asked).name == found


@pytest.mark.parametrize("wrong", ["1977", "2013", "", "iso", "ISO 230-3", "3441-1980", "GB/T 17421.2-2001"])
def test_unknown_names_are_refused_with_the_known_ones(wrong: str) -> None:
    with pytest.raises(ModelError, match="NMTBA") as caught:
        standard(wrong)
    assert caught.value.code == "E-EVAL-STANDARD"


def test_every_standard_has_a_name_of_its_own_an_edition_and_a_certainty_never_claimed_from_the_text() -> None:
    names = [item.name for item in standards()]
    assert len(set(names)) == len(names)
    assert {standard(name).name for name in names} == set(names)
    for item in standards():
        assert item.edition.isdigit()
        assert item.certainty != "from the text of the standard"


def test_national_equivalents_give_the_figures_of_their_edition_under_their_own_name() -> None:
    iso, own = (evaluate_by(name, AT, X, "um", monte_carlo=False) for name in ("2006", "GB/T 17421.2-2016"))
    assert own.values == iso.values
    assert own.U == iso.U
    assert (own.standard.name, own.standard.iso, own.standard.edition) == ("GB/T 17421.2-2016", "2006", "2016")
    three = evaluate_by("BS 4656-16", AT, X, "um", monte_carlo=False)
    assert (three.values["R"], three.values["A"]) == pytest.approx((12.0, 13.0))


def test_worked_example_of_every_family() -> None:
    by = {name: evaluate_by(name, AT, X, "um", monte_carlo=False).values for name in ("2014", "VDI 3441", "NMTBA")}
    assert (by["2014"]["E"], by["2014"]["R"], by["2014"]["A"]) == pytest.approx((6.0, 8.0, 10.0))
    assert by["VDI 3441"]["P"] == pytest.approx(12.0)
    assert by["NMTBA"]["A_bi"] == pytest.approx((10.0 - (-3.0)) / 2.0)
    raw = evaluate_by("ASME B5.54-1992", AT, X, "um", monte_carlo=False).values
    assert (raw["acc_bi"], raw["lost_motion"]) == pytest.approx((X.max() - X.min(), 3.0))
    jis = evaluate_by("JIS B 6330", AT, X, "um", monte_carlo=False)
    assert jis.values["repeatability"] == pytest.approx(2.0)
    assert "n = 5, the standard asks for 7" in said(jis)
    assert "repeated at 5 places, the standard asks for 3" in said(jis)


def test_the_range_estimator_of_3441() -> None:
    found = registry.vdi3441(X, estimator="range").values
    assert found["Ps_max"] == pytest.approx(6.0 * (2.0 + 4.0) / 2.0 / 2.326)
    with pytest.raises(ModelError, match="E-EVAL-RANGE-RUNS"):
        registry.vdi3441(np.zeros((2, 11, 2)), estimator="range")


def test_a_missing_reading_is_flagged_and_evaluated_with_its_own_n() -> None:
    gappy = X.copy()
    gappy[0, 0, 0] = np.nan
    for item in standards():
        found = evaluate_by(item.name, AT, gappy, "um", monte_carlo=False)
        assert "n = 4 of 5 at i = 1" in said(found)
        assert None not in found.values.values()


def test_one_direction_has_no_figure_of_two_in_any_standard() -> None:
    one = X.copy()
    one[:, :, 1] = np.nan
    absent = {
        "VDI 3441": {"U_max", "U_mean", "Ps_max", "Ps_mean", "Pa", "P"},
        "NMTBA": {"A_down", "A_bi", "R_down", "R_bi"},
        "ASME B5.54-1992": {"rep_down", "rep_bi", "acc_down", "acc_bi", "lost_motion"},
        "JIS B 6330": {"lost_motion"},
        "2014": {"B", "B_mean", "M", "E", "E_down", "R", "R_down", "A", "A_down"},
    }
    for name, names in absent.items():
        found = evaluate_by(name, AT, one, "um")
        assert {key for key, value in found.values.items() if value is None} == names
        assert not names & set(found.U)
        assert "unidirectional" in said(found)


def test_one_run_has_no_spread_in_any_standard() -> None:
    absent = {"VDI 3441": "P", "NMTBA": "A_bi", "ASME B5.54-1992": "rep_bi", "JIS B 6330": "repeatability", "2014": "R"}
    for name, parameter in absent.items():
        found = evaluate_by(name, AT, X[:, :1], "um", monte_carlo=False)
        assert found.values[parameter] is None
        assert any(flag.startswith("n = 1: no") for flag in said(found))


@settings(max_examples=60, deadline=None)
@given(READINGS, st.data())
def test_gaps_never_leak_and_are_always_said(x: np.ndarray, data: st.DataObject) -> None:
    mask = data.draw(arrays(np.bool_, x.shape, elements=st.booleans()))
    gappy = np.where(mask, np.nan, x)
    gappy[:, 0, 0] = x[:, 0, 0]
    for name in ("2014", "1988", "VDI 3441", "NMTBA", "ASME B5.54-1992", "JIS B 6330"):
        found = evaluate_by(name, np.arange(float(len(x))), gappy, "um", monte_carlo=False)
        assert all(value is None or np.isfinite(value) for value in found.values.values())
        assert bool(found.flags) or not np.isnan(gappy).any()
        shifted = evaluate_by(name, np.arange(float(len(x))), gappy + 7.0, "um", monte_carlo=False)
        for key, value in found.values.items():
            assert (shifted.values[key] is None) == (value is None)


@settings(max_examples=40, deadline=None)
@given(READINGS)
def test_relations_within_the_other_standards(x: np.ndarray) -> None:
    asme = registry.asme_b554_1992(x).values
    for small, large in [*pairwise(("rep_up", "rep_bi", "acc_bi")), ("acc_up", "acc_bi"), ("lost_motion", "rep_bi")]:
        assert asme[small] <= asme[large] + 1e-9
    vdi = registry.vdi3441(x).values
    assert vdi["Pa"] <= vdi["P"] + 1e-9
    assert vdi["Ps_max"] <= vdi["P"] + 1e-9
    assert vdi["U_mean"] <= vdi["U_max"] + 1e-9
    wide, off = registry.nmtba(x).values, registry.nmtba(x, offset=False).values
    assert max(wide["A_up"], wide["A_down"]) <= wide["A_bi"] + 1e-9
    assert wide["A_bi"] <= off["A_bi"] + 1e-9


def _plan(places: ArrayLike, repetitions: int, axis_unit: AxisUnit) -> list[str]:
    at = np.asarray(places, dtype=np.float64)
    return [one.text for one in doubts_of(at, np.zeros((at.size, repetitions, 2)), axis_unit)]


def test_plans_that_do_not_fit_the_standard_are_said() -> None:
    assert _plan(np.arange(0.0, 1001.0, 250.0), 5, "mm") == [
        "equal steps: errors that repeat with the step are not seen",
    ]
    assert _plan([0.0, 900.0, 1750.0], 5, "mm") == ["3 targets; this travel asks for 9"]
    assert _plan([0.0, 70.0, 190.0, 355.0], 5, "deg") == ["4 targets; this travel asks for 8"]
    long = np.linspace(0.0, 4000.0, 17) + np.sin(np.arange(17))
    assert "one run" in " ".join(_plan(long, 5, "mm"))


def test_a_closing_error_is_a_doubt_of_a_rotary_test() -> None:
    at = np.array([0.0, 70.0, 190.0, 280.0, 360.0])
    found = doubts_of(at, X, "deg")[0]
    assert found.code == "S-EVAL-CLOSURE-FAR"
    assert found.blocking
    assert "closing error +4.000 arcsec over 360 deg, not removed: above 1 arcsec (the instrument's" in found.text
    assert not any("CLOSURE" in one.code for one in doubts_of(AT, X, "mm"))


@pytest.mark.parametrize(
    ("value", "u", "trials", "word"),
    [
        (8.0, 1.0, (7.0, 9.0), "pass"),
        (9.0, 1.0, (8.0, 10.0), "pass"),
        (9.5, 1.0, (8.5, 10.5), "not decidable"),
        (10.5, 1.0, (9.5, 11.5), "not decidable"),
        (11.5, 1.0, (10.6, 12.4), "fail"),
        (8.0, 1.0, (7.0, 11.0), "not decidable"),
        (11.5, 1.0, (9.0, 12.4), "not decidable"),
        (-8.0, 1.0, (-9.0, -7.0), "pass"),
        (-12.0, 1.0, (-13.0, -11.0), "fail"),
        (-12.0, 1.0, None, "fail"),
        (None, 1.0, None, "not decidable"),
        (8.0, None, None, "not decidable"),
        (float("nan"), 1.0, None, "not decidable"),
        (8.0, float("nan"), None, "not decidable"),
    ],
)
def test_verdict_by_guard_band(value: float | None, u: float | None, trials: tuple[float, float], word: str) -> None:
    found = decide("A", value, u, 10.0, trials)
    assert found.verdict == word
    assert found.rule == RULE
    assert bool(found.why) == (word == "not decidable")


def test_limits_are_checked() -> None:
    found = evaluate_by("2014", AT, X, "um", budget=Budget(eve=0.2))
    words = {item.parameter: item.verdict for item in found.decided({"A": 30.0, "E": 1.0, "B": 3.01})}
    assert words == {"A": "pass", "E": "fail", "B": "not decidable"}
    with pytest.raises(ModelError, match="E-EVAL-LIMIT-NAME"):
        found.decided({"Q": 1.0})
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ModelError, match="E-EVAL-LIMIT"):
            found.decided({"A": wrong})


def test_a_budget_from_a_file_never_takes_20_degrees_for_granted() -> None:
    unknown, notes = file_budget("um", 1000.0, None)
    known, _ = file_budget("um", 1000.0, 20.5)
    assert unknown.expansion == pytest.approx(18.0)
    assert known.expansion == pytest.approx(0.6)
    assert "5 to 35 °C" in " ".join(one.text for one in notes)
    assert file_budget("um", 0.0, None)[0].systematic == 0.0
    assert file_budget("arcsec", 360.0, None)[0].turning == 1.0
