"""Wear and heat while a part is ground, told from what closes after a turn: judged by parts of a true machine."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from drivers.message import prose
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_grid
from gateway.gear.process_drift import depth_running, index_running
from gateway.tooth import FlankMap
from gateway.workflow.tooth.inspection import drift_messages, expanded_uncertainty, is_significant
from simulators.cellfile import CellFile, Clamping, load_cell
from simulators.grinding import draw_clamping
from simulators.grinding.grinder import rotation_axis_frame
from simulators.truth import Truth
from tests.sizes import few
from tests.unit.simulators.planned_run import ground

PITCH = [{"kind": "harmonic", "order": one, "amplitude": 6.0 / one, "phase_deg": 50.0 * one} for one in (1, 2)]
WARM = {"warm_up": 4.0, "warm_up_h": 0.02}


def cell(name: str, wheel: dict[str, float], c: dict[str, Any], pitch: bool) -> CellFile:
    """A packaged cell whose C has a large pitch error or none, with a wheel that wears and a table that warms up."""
    raw = load_cell(name).model_dump()
    raw["truth"] = {"motions": {"ECC": PITCH if pitch else []}}
    raw["wheel"] = raw["wheel"] | wheel
    raw["axes"] = [one | {"drift_per_h": 0.0} | (c if one["letter"] == "C" else {}) for one in raw["axes"]]
    raw["climate"] = {}
    return CellFile.model_validate(raw)


def made(file: CellFile) -> tuple[FlankMap, CycloidGear]:
    """A part of this machine, clamped 1 µm off, as an inspection with 30 nm of noise has it."""
    assert file.part is not None
    gear = CycloidGear.of(file.part.gear.model_dump())
    grid = flank_grid(gear, profile=7, width=2)
    true = Truth(file)
    off = draw_clamping(Clamping(eccentric_um=1.0), 3, "blank")
    work = ground(true, file.part, rotation_axis_frame(true, file.part.grinding.height_mm).then(off), feed_mm_per_s=5.0)
    seen = work.surplus_um(np.arange(float(gear.zc)), grid.thetas, grid.zs)
    return FlankMap(grid.thetas, grid.zs, seen + np.random.default_rng(1).normal(0.0, 0.03, seen.shape)), gear


@pytest.mark.parametrize("name", few(["eleven", "demo"]))
def test_a_pitch_error_and_an_eccentric_part_are_nothing_that_runs(name: str) -> None:
    flank, gear = made(cell(name, {}, {}, pitch=True))
    assert np.ptp(flank.deviation_um) > 2.0
    assert not is_significant(depth_running(flank, gear))
    assert not is_significant(index_running(flank, gear))
    assert drift_messages(flank, gear) == ()


@pytest.mark.parametrize("name", few(["eleven", "demo"]))
def test_wear_and_heat_are_found_beside_a_pitch_error(name: str) -> None:
    wear = 0.6 / load_cell(name).part.gear.zc  # type: ignore[union-attr]
    flank, gear = made(cell(name, {"wear_um": wear}, {"drift": WARM}, pitch=True))
    bare, _ = made(cell(name, {}, {}, pitch=True))
    depth, index = depth_running(flank, gear), index_running(flank, gear)
    ran = flank.deviation_um - bare.deviation_um
    lever = gear.section(flank.theta_rad).h
    course = ran.mean(axis=2) @ lever / (lever @ lever) * 1e-3 * 206264.8
    assert depth.value == pytest.approx(wear * (gear.zc - 1), abs=expanded_uncertainty(depth))
    assert 1.0 < abs(course[-1] - course[0]) < 5.0
    assert index.value == pytest.approx(course[-1] - course[0], abs=expanded_uncertainty(index))
    assert is_significant(depth)
    assert is_significant(index)
    said = prose(drift_messages(flank, gear))
    assert f"{index.value:+.1f} arcsec" in said
    assert f"{depth.value:+.2f} µm" in said


def test_a_wheel_that_wears_on_one_side_runs_the_index_the_way_it_looks() -> None:
    """+ along Y is the right flank's side of the space: the space lies further clockwise, the lobes on."""
    flank, gear = made(cell("demo", {"wear_side_um": 0.01}, {}, pitch=False))
    index = index_running(flank, gear)
    section = gear.section(flank.theta_rad)
    arcsec = 0.38 * float(section.ny @ section.h / (section.h @ section.h)) * 1e-3 * 206264.8
    assert is_significant(index)
    assert index.value == pytest.approx(arcsec, abs=expanded_uncertainty(index))


def test_of_too_few_spaces_nothing_is_said() -> None:
    gear = CycloidGear(rp=40.0, rrp=5.0, a=2.0, zp=4, zc=3, b=10.0)
    grid = flank_grid(gear, profile=5, width=2)
    ramp = np.broadcast_to(np.arange(3.0)[:, None, None] * grid.section.nx, grid.shape)
    assert not is_significant(depth_running(FlankMap(grid.thetas, grid.zs, np.asarray(ramp)), gear))
