"""Figures and tables of an axis hold for the line that counts: the reflector's known lever is taken off, and told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.types.sensing import Ambient
from gateway.config import SiteFile
from gateway.domain.captures import Between, Capture
from gateway.evaluate.geometry.measurement import Measurement, arms, means_of
from gateway.evaluate.optics.corrections import begin
from gateway.model.components import value
from gateway.store import RunFolder, Store
from gateway.workflow.axes.measure import MeasuredAxis, move_to_functional_line
from gateway.workflow.axes.structure import structure_of
from gateway.workflow.errors21.measurement import fit_error_model
from gateway.workflow.errors21.setup_capture import axes_from_setups
from gateway.workflow.run import stages
from tests.steps import said
from tests.unit.components.machine import Machine, X
from tests.unit.components.site import setup, site_data

OFFSET = (0.0, 60.0, 120.0)
AIR = Ambient(20.0, 1013.25, 50.0, (20.0,))


def site_of(*, measured: bool = True, offset: tuple[float, float, float] | None = OFFSET) -> SiteFile:
    keys: dict[str, Any] = {} if offset is None else {"offset_mm": list(offset)}
    plan = [setup("EXX", "X1", "laser", **keys)]
    plan += [setup(name, "X1", "level") for name in ("EBX", "ECX")] if measured else []
    return SiteFile.model_validate(site_data(plan))


def captured(one: Measurement, between: Between | None = None) -> Capture:
    return Capture(
        axis="X1",
        component=one.component,
        axis_unit="mm",
        targets=one.targets,
        deviations=one.deviations,
        reading_u=0.01,
        ambient_start=AIR,
        ambient_end=AIR,
        corrections=begin("air+material"),
        live=None,
        sense=None,
        between=between,
    )


def run(folder: Path, machine: Machine, site: SiteFile) -> RunFolder:
    """A run whose set-ups were all measured."""
    stored = Store(folder).create("grinder")
    stored.put(stages.setup("EXX-X1"), captured(machine.length("EXX", OFFSET)))
    for name in ("EBX", "ECX"):
        stored.put(stages.setup(f"{name}-X1"), captured(machine.angle(name)))
    fit_error_model(site, stored, None)
    return stored


def of(folder: Path, machine: Machine, site: SiteFile) -> MeasuredAxis:
    return axes_from_setups(run(folder, machine, site), site)["X1"]


def true_range(machine: Machine) -> float:
    return float(np.ptp(machine.motion("EXX", X)))


@pytest.mark.parametrize("seed", range(5))
def test_the_range_is_that_of_the_line_that_counts(tmp_path: Path, seed: int) -> None:
    machine = Machine(seed)
    found = of(tmp_path, machine, site_of())
    assert pytest.approx(true_range(machine), abs=0.2) == found.evaluation.M
    assert found.capture.line_mm == OFFSET
    assert any("on the functional line of EXX" in flag and "Y +60, Z +120" in flag for flag in said(found.evaluation))


@pytest.mark.parametrize("seed", [1, 5, 9, 18])
def test_the_table_is_made_from_the_curve_that_the_model_has(seed: int) -> None:
    """Coarse structure that a smooth fit leaves out is in both or in none: seen from the flank they are one axis."""
    rng = np.random.default_rng(seed)
    at = np.linspace(0.0, 300.0, int(rng.integers(12, 24)))
    rough = 3.0 * np.sin(2.0 * at / rng.uniform(15.0, 40.0)) + 0.5 * rng.normal(0.0, 1.0, at.size).cumsum()
    one = Measurement("EZZ", "Z", "mm", at, rough[:, None, None] + rng.normal(0.0, 0.05, (at.size, 5, 2)))
    model = means_of(one).fitted()
    axis = next(axis for axis in site_of().axes if axis.name == "Z1")
    table = structure_of(axis, captured(one)).component
    np.testing.assert_allclose(value(table, at), value(model, at), atol=1e-6)
    assert np.ptp(value(table, at) - rough) < 0.3


def test_the_lever_moves_the_range_by_micrometres_here() -> None:
    """What was read and what is true differ far beyond the uncertainty, or the tests above would show nothing."""
    machine = Machine(1)
    read = machine.length("EXX", OFFSET).deviations.mean(axis=(1, 2))
    assert abs(np.ptp(read) - true_range(machine)) > 0.5


def test_a_line_that_nobody_named_is_that_of_the_reflector(tmp_path: Path) -> None:
    found = of(tmp_path, Machine(1), site_of(offset=None))
    assert found.capture.line_mm is None
    assert any("on the line of the reflector" in flag for flag in said(found.evaluation))


def test_angles_that_nobody_measured_stay_in_U(tmp_path: Path) -> None:
    machine, site = Machine(1), site_of(measured=False)
    stored = Store(tmp_path).create("grinder")
    stored.put(stages.setup("EXX-X1"), captured(machine.length("EXX", OFFSET)))
    fit_error_model(site, stored, None)
    found = axes_from_setups(stored, site)["X1"]
    levers = arms("X", "X", OFFSET)
    wanted = 2.0 * np.hypot(*levers.values()) * 5.0 / np.sqrt(3.0)
    assert found.evaluation.U["M"] > wanted
    assert abs(found.evaluation.M - true_range(machine)) < found.evaluation.U["M"]


def test_check_stops_and_the_measurement_after_a_push_stand_on_the_same_line(tmp_path: Path) -> None:
    machine, site = Machine(2), site_of()
    stored = run(tmp_path, machine, site)
    whole = captured(machine.length("EXX", OFFSET))
    at = slice(3, 6)
    between = Between(X[at], whole.deviations[at, :2])
    axis = next(one for one in site.axes if one.name == "X1")
    found = move_to_functional_line(replace(whole, between=between), axis, site, stored)
    assert found.between is not None
    np.testing.assert_allclose(found.between.deviations, found.deviations[at, :2], atol=1e-9)
    true = machine.motion("EXX", X)
    off = found.deviations.mean(axis=(1, 2)) - true
    assert np.ptp(off) < 0.2
