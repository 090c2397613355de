"""A part against the model that its set-ups told: honest, one optic reversed, one error absent; all from one truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivers.types.values import FloatArray
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty
from gateway.correct.outlook.part_agreement import compare_part
from gateway.correct.outlook.prediction import flank_map
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.evaluate.geometry.error_model import error_model
from gateway.evaluate.geometry.measurement import Measurement
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel, chain_of_errors, yk7350b
from gateway.tooth import FlankAgreement, FlankMap, InspectedFlank

GEAR = CycloidGear(rp=90.0, rrp=10.0, a=4.0, zp=12, zc=11, b=15.0)
GRID = flank_grid(GEAR, profile=7, width=3)
PLAN = Plan((AxisGrid("C", 0.0, 360.0, 5.0, 0.0, modulo=True), AxisGrid("Z", 0.0, 300.0, 10.0, 0.0)), zeros=("X",))
HEIGHT, DISTANCE = 150.0, 190.0
BALL_UM = 10.0
AT = np.linspace(0.0, 337.5, 16)
Curve = Callable[[FloatArray], FloatArray]


def wave(order: int, size: float, phase: float) -> Curve:
    """A wave around the turn, um or arcsec, of positions in deg."""
    return lambda q: size * np.cos(order * np.deg2rad(q) + phase)


# What the machine does, um: orders 1 and 3 of a radial pair, the first against the axis.
TRUTH: dict[str, list[Curve]] = {
    "EXC": [wave(1, 0.3, 0.4), wave(3, 0.7, 1.0)],
    "EYC": [wave(1, 0.3, 0.4 + 0.5 * np.pi), wave(2, 0.6, 2.0)],
    "ECC": [wave(1, 7.0, 0.2), wave(2, 5.0, 1.5)],
}
# A ball that is off its axis rides with it.
READ: dict[str, Curve] = {"EXC": wave(1, BALL_UM, 0.0), "EYC": wave(1, BALL_UM, -0.5 * np.pi)}


def true_error(name: str, q: FloatArray) -> FloatArray:
    """An error at positions in deg."""
    return np.asarray(sum(one(q) for one in TRUTH[name]))


def measured(seed: int, turned: str = "") -> ErrorModel:
    """What set-ups with 0.06 um of noise tell; ``turned`` was read with the other sign."""
    rng = np.random.default_rng(seed)
    found = []
    for name in TRUTH:
        read = true_error(name, AT) + (READ[name](AT) if name in READ else 0.0)
        every = read[:, None, None] + rng.normal(0.0, 0.06, (AT.size, 2, 2))
        every = -every if name == turned else every
        found.append(
            Measurement(
                component=name,
                letter="C",
                axis_unit="deg",
                targets=AT,
                deviations=every - every[0, 0, 0],
                reference=0.0,
                modulo=True,
                systematic=0.05,
            )
        )
    spans = dict.fromkeys(chain_names(), 0.3)
    return error_model(found, spans, linear_um=0.3, angular_arcsec=0.3)


def chain_names() -> tuple[str, ...]:
    """The errors that nobody measured here are small."""
    return tuple(name for name in yk7350b().error_names() if name not in TRUTH)


@cache
def ground(seed: int, size: float = 1.0) -> InspectedFlank:
    """The part of the true machine: off its zeros, eccentric in its clampings, every place with noise."""
    rng = np.random.default_rng(seed)
    scale = {"EXC": 1e-3, "EYC": 1e-3, "ECC": np.pi / 180.0 / 3600.0}

    def error(name: str) -> Curve:
        return lambda q: size * scale[name] * true_error(name, np.rad2deg(q))

    chain = yk7350b({name: error(name) for name in TRUTH}, c_frame="fixed")
    flank = flank_map(Grinding(chain, GEAR, DISTANCE), GRID).deviation_um
    section, phi = GEAR.section(GRID.thetas), np.asarray(GEAR.space_angle(GRID.ks))[:, None, None]
    nx, ny = section.nx[None, :, None], section.ny[None, :, None]
    off = 1.7 * (nx * np.cos(phi) - ny * np.sin(phi)) - 0.8 * (nx * np.sin(phi) + ny * np.cos(phi))
    touched = rng.normal(0.0, 0.2, (GEAR.zc, 3, GRID.zs.size)) * 0.3
    noise = np.einsum("it,kiz->ktz", np.stack([section.nx, section.ny, 0.1 * section.h]), touched)
    whole = flank + off + 4.0 * nx - 3.0 * ny + noise
    count = GRID.shape[0] * GRID.shape[2]
    ks, zs = np.repeat(GRID.ks, GRID.zs.size), np.tile(GRID.zs, GRID.ks.size)
    points = np.zeros(count * GRID.thetas.size)
    return InspectedFlank(
        part="before",
        source="",
        serial="",
        k=points,
        theta_rad=points,
        z_mm=points,
        deviation_um=points,
        u_um=0.2,
        place_k=ks,
        place_z_mm=zs,
        abg=np.zeros((count, 3)),
        abg_u=np.zeros((count, 3)),
        fitted=FlankMap(GRID.thetas, GRID.zs, whole),
        rms_u_um=0.3,
    )


def compared(model: ErrorModel, part: InspectedFlank) -> FlankAgreement:
    """The part against the model."""
    grinding = Grinding(chain_of_errors(model, height_mm=HEIGHT), GEAR, DISTANCE)
    return compare_part(grinding, GRID, PLAN, model=model, shop=ProcessUncertainty(), part=part)


@pytest.mark.parametrize("seed", range(1, 4))
def test_an_honest_machine_raises_no_alarm(seed: int) -> None:
    found = compared(measured(seed), ground(seed))
    assert (found.outcome, found.explanations) == ("agrees", ())
    assert found.missed_um < 1.5 * found.u_um


@pytest.mark.parametrize("name", ["EXC", "EYC"])
def test_a_reversed_indicator_is_refused_and_named(name: str) -> None:
    """10 um of the ball's own eccentricity then look like an error of the axis."""
    found = compared(measured(1, turned=name), ground(1))
    assert found.outcome == "apart"
    assert found.missed_um > 3.0 * found.u_um
    assert [(one.error, one.how, one.factor) for one in found.explanations] == [(name, "reversed", -2.0)]
    assert found.explanations[0].left_um < 2.0 * found.u_um


def test_an_error_that_the_part_does_not_have_is_said_to_be_absent() -> None:
    """The readings of C show 12 arcsec, the part nothing of it."""
    model = measured(1)
    without = replace(ground(1), fitted=_without_c(ground(1).fitted))
    found = compared(model, without)
    assert found.outcome == "apart"
    assert [(one.error, one.how) for one in found.explanations] == [("ECC", "absent")]


def _without_c(flank: FlankMap) -> FlankMap:
    """The flank less what the true error of C does to it."""
    chain = yk7350b({"ECC": lambda q: np.pi / 648000.0 * true_error("ECC", np.rad2deg(q))}, c_frame="fixed")
    alone = flank_map(Grinding(chain, GEAR, DISTANCE), GRID).deviation_um
    return replace(flank, deviation_um=flank.deviation_um - alone)


@pytest.mark.parametrize(
    ("space", "points", "height", "depth_um", "outcome"),
    [(3, slice(2, 6), 1, 25.0, "apart"), (0, slice(0, 2), 0, 8.0, "look"), (5, slice(3, 4), 1, 25.0, "apart")],
)
def test_a_pit_in_the_face_is_seen_and_accuses_no_error(
    space: int, points: slice, height: int, depth_um: float, outcome: str
) -> None:
    """Rust over a few points of one space: nothing that an error of the machine can leave."""
    pitted = np.array(ground(1).fitted.deviation_um)
    pitted[space, points, height] -= depth_um
    part = replace(ground(1), fitted=replace(ground(1).fitted, deviation_um=pitted))
    found = compared(measured(1), part)
    assert (found.outcome, found.explanations) == (outcome, ())
