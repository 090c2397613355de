"""The library's edges: what cannot be is refused by name, what a workshop has is accepted; nothing is guessed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers.types.sensing import Ambient
from gateway.errors import AmbientOutOfRange, ModelError
from gateway.evaluate.geometry.error_model import error_model
from gateway.evaluate.geometry.measurement import Measurement
from gateway.evaluate.geometry.rotary_motion import harmonics
from gateway.evaluate.geometry.straightness import from_face_diagonals, straightness
from gateway.evaluate.optics import air, displacement
from gateway.evaluate.optics.rotary_calibration import closure
from gateway.evaluate.standards import iso230_2
from gateway.evaluate.standards.conformity import class_limits
from gateway.evaluate.standards.registry import asme_b554_1992, nmtba, vdi3441
from gateway.evaluate.standards.statistics import from_rows
from gateway.evaluate.uncertainty.budget import (
    Budget,
    coverage_factor,
    expanded_uncertainties,
    misalignment_um,
    variance_limit,
)
from gateway.gear.cycloid import limits
from gateway.gear.flank import trace_values
from gateway.model.components import value
from gateway.model.fit import fit_positioning
from gateway.model.frames import chain_of
from gateway.model.waves import fit_means
from gateway.study.inputs import ErrorFile
from gateway.study.machine import machine_of
from tests.steps import said

AT = np.linspace(0.0, 400.0, 6)
X = np.random.default_rng(1).normal(0.0, 0.2, (6, 5, 2)) + AT[:, None, None] / 100.0
ANY: Any = None
NAN = float("nan")
EXX: dict[str, Any] = {"name": "EXX", "axis": "X", "axis_unit": "mm", "kind": "linear"}


def linear_axis(err: dict[str, Any]) -> dict[str, Any]:
    return {"work": [{"kind": "prismatic", "name": "X", "axis": [1, 0, 0], "err": err}]}


def measured(deviations: np.ndarray, component: str = "EXX") -> Measurement:
    return Measurement(component, "X", "mm", AT, deviations)


REFUSED: dict[str, Callable[[], object]] = {
    "coverage in percent": lambda: coverage_factor(95, 9.0),
    "coverage of all": lambda: coverage_factor(1.0, 9.0),
    "no degrees of freedom": lambda: coverage_factor(0.95, 0.0),
    "a variance limit in percent": lambda: variance_limit(95, 4, 9),
    "a variance of no readings": lambda: variance_limit(0.95, 0, 9),
    "no reading": lambda: expanded_uncertainties(0, 1.0, 0.1),
    "an uncertainty that is none": lambda: expanded_uncertainties(5, NAN, 0.1),
    "more means than targets": lambda: fit_means(AT, np.zeros(5), 0.1, **EXX),
    "means that are words": lambda: fit_means(AT, ["a"] * 6, 0.1, **EXX),
    "uncertainties of other targets": lambda: fit_means(AT, AT, [0.1, 0.1], **EXX),
    "targets that are nowhere": lambda: fit_means(np.full(6, np.inf), AT, 0.1, **EXX),
    "one number for targets": lambda: fit_positioning(3.0, 1.0, 0.1, **EXX),
    "a class of no diameter": lambda: class_limits(NAN, 2.0, 20.0, 5),
    "a class for a negative width": lambda: class_limits(100.0, 2.0, -20.0, 5),
    "a grade there is none of": lambda: class_limits(100.0, 2.0, 20.0, 40),
    "a turn without targets": lambda: closure([], []),
    "a turn with other deviations": lambda: closure([0.0, 360.0], [1.0]),
    "a pin circle of nothing": lambda: limits(0.0, 5.0, 1.0, 12, 11),
    "a pin circle that is no number": lambda: limits(NAN, 5.0, 1.0, 12, 11),
    "a trace along nothing": lambda: trace_values(np.zeros(9), np.full(9, NAN)),
    "a unit of length for deviations": lambda: iso230_2.evaluate_iso230_2(AT, X, ANY or "mm"),
    "readings that are words": lambda: iso230_2.evaluate_iso230_2(AT, [["a"]], "um"),
    "an edition there is none of": lambda: iso230_2.evaluate_iso230_2(AT, X, "um", edition="2015"),
    "an unknown kind of axis": lambda: iso230_2.minimum_targets(ANY or "spindle", 300.0),
    "no travel": lambda: iso230_2.minimum_targets("linear", 0.0),
    "an unknown line": lambda: straightness(AT, AT, ANY or "chebyshev"),
    "positions that are words": lambda: straightness(["a", "b"], [1.0, 2.0]),
    "angles that are words": lambda: harmonics(["a", "b"], [1.0, 2.0], [1]),
    "an unknown equation": lambda: air.index(Ambient(20.0, 1013.25, 50.0), equation=ANY or "owens"),
    "a travel of nothing": lambda: misalignment_um(0.0, 1.0),
    "a beam of nothing": lambda: displacement.cosine_error_mm(0.0, 1.0),
    "a rectangle of nothing": lambda: from_face_diagonals(1.0, 1.0, 0.0, 100.0),
    "one place twice": lambda: straightness([0.0, 0.0], [1.0, 2.0]),
    "errors as a list": lambda: chain_of(linear_axis([1.0])),  # type: ignore[arg-type]
    "5 mm of EXX": lambda: chain_of(linear_axis({"dx": 5.0})),
    "5 mm of EXX by function": lambda: chain_of(linear_axis({"dx": {"type": "poly", "c": [0.0, 5.0]}})).actual(
        {"X": 1.0}
    ),
    "5 mm of EXX as measured": lambda: error_model([measured(1000.0 * X)], {}),
    "a degree of EBX as measured": lambda: error_model([measured(1000.0 * X, "EBX")], {}),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused_by_name(name: str) -> None:
    with pytest.raises(ModelError) as caught:
        REFUSED[name]()
    assert "{" not in caught.value.what


@pytest.mark.parametrize("equation", [air.edlen, air.edlen_1966, air.ciddor])
@pytest.mark.parametrize("given", [(20.0, 1013.25, 50.0), (20.0, 101325.0, 50.0, 0.633), (293.15, 101325.0, 50.0)])
def test_air_in_other_units_is_refused(equation: Callable[..., float], given: tuple[float, ...]) -> None:
    with pytest.raises(AmbientOutOfRange, match="E-EVAL-AMBIENT"):
        equation(*given)


@pytest.mark.parametrize("ambient", [Ambient(20.0, 1013.25, 0.4), Ambient(-6.0, 1013.25, 30.0)])
def test_dry_and_cold_air_is_air(ambient: Ambient) -> None:
    assert 1.0002 < air.index(ambient) < 1.0004


def test_an_edition_may_be_a_number() -> None:
    assert iso230_2.evaluate_iso230_2(AT, X, "um", edition=ANY or 2014).edition == "2014"


def test_the_two_directions_may_have_unequal_repetitions() -> None:
    rows = from_rows(np.ones((4, 5)), np.zeros((4, 3)))
    assert rows.shape == (4, 5, 2)
    assert np.isnan(rows[:, 3:, 1]).all()
    assert pytest.approx(1.0) == iso230_2.evaluate_iso230_2(np.arange(4.0), rows, "um").B
    with pytest.raises(ModelError):
        from_rows(np.ones((4, 5)), np.zeros((3, 5)))


def test_a_target_left_with_one_reading_is_left_out_of_R_and_A_alone() -> None:
    gap = X.copy()
    gap[2, 1:, 0] = np.nan
    whole = np.delete(X, 2, axis=0)
    found = iso230_2.evaluate_iso230_2(AT, gap, "um", budget=Budget(eve=0.2))
    rest = iso230_2.evaluate_iso230_2(np.delete(AT, 2), whole, "um", budget=Budget(eve=0.2))
    assert found.R_up == pytest.approx(rest.R_up)
    assert found.R is not None
    assert found.A is not None
    assert {"R", "A", "M", "B"} <= set(found.U)
    assert any("left out of R, A" in flag for flag in said(found))
    for other in (vdi3441(gap), nmtba(gap), asme_b554_1992(gap)):
        assert all(value is not None for value in other.values.values()), other.standard
        assert any("one reading" in flag for flag in said(other))


def test_sums_of_two_motions_stand_in_an_error_file() -> None:
    wave = {"type": "fourier", "a": [2.0], "period": 10.0}
    line = {"type": "poly", "c": [0.0, 3.0], "scale": 100.0}

    def of(exx: Any) -> np.ndarray:
        file = ErrorFile.model_validate({"name": "two", "errors": {"EXX": exx}})
        return machine_of(file).axis("X").value("dx", np.linspace(-100.0, 0.0, 7))

    np.testing.assert_allclose(of([wave, line, 1.0]), of(wave) + of(line) + of(1.0))


def test_a_gap_in_a_capture_leaves_no_nan_in_its_record() -> None:
    shown = np.broadcast_to(AT[:, None, None], X.shape) / 1e6 + AT[:, None, None]
    fraction = np.linspace(0.0, 1.0, X.size).reshape(X.shape)
    fraction[3, 4, 1] = np.nan
    setup = displacement.LinearSetup(datum_mm=0.0, dead_path_mm=20.0, expansion_ppm_per_k=11.5)
    start, end = Ambient(20.0, 1013.25, 50.0, (20.0,)), Ambient(21.0, 1013.25, 50.0, (21.0,))
    found, done = displacement.linear_deviations(shown, AT, setup, start=start, end=end, fraction=fraction)
    assert np.isnan(found).sum() == 1
    assert all(math.isfinite(value) for value in done.details.values() if isinstance(value, float))


def test_a_target_that_is_no_place_is_left_out_of_a_fit() -> None:
    holed = AT.copy()
    holed[2] = NAN
    found = fit_means(holed, AT / 100.0, 0.1, **EXX)
    assert float(value(found, 400.0)) == pytest.approx(4.0, abs=0.01)
