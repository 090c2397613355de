"""The linear flank: Jacobian, blocks, RMS, visibility and cures."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.correct.flank.compensability import cures, observability, tangential_cure
from gateway.errors import ModelError
from gateway.gear.first_order import OFFSET, RADIUS, ErrorParameter, first_order, linear_flank
from gateway.gear.flank import flank_figure, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import MOTION_NAMES, TWENTY_ONE, yk7350b
from gateway.model.motion import Fourier, Polynomial
from tests.unit.gear.machines import DISC, RV40E, random_constants

RNG = np.random.default_rng(0)


def grinding_of(**errors: float) -> Grinding:
    return Grinding(yk7350b(errors), RV40E, 160.0)


def test_constants_give_the_first_order_flank() -> None:
    grid = flank_grid(RV40E, profile=4, width=3, spaces=(0, 5, 17))
    flank = linear_flank(grinding_of(), grid, TWENTY_ONE)
    e = random_constants(RNG)
    v = np.array([e[name] for name in TWENTY_ONE])
    wanted = first_order(grinding_of(**e), grid.k, grid.theta, grid.z).ravel()
    np.testing.assert_allclose(flank.deviations(v), wanted, atol=1e-16)
    np.testing.assert_allclose(flank.jacobian() @ v, wanted, atol=1e-16)


def test_basis_functions_give_the_flank_of_the_function() -> None:
    grid = flank_grid(RV40E, profile=3, width=4, spaces=(0, 9))
    wave, bend = Fourier(0.0, (1.0,), (), 12.0), Polynomial((0.0, 0.0, 1.0), 0.0, 5.0)
    flank = linear_flank(
        grinding_of(),
        grid,
        [ErrorParameter("EXZ", wave), ErrorParameter("EAZ", bend), ErrorParameter("EYZ", np.cos, ("C",), "EYZ over C")],
    )
    assert flank.names == ("EXZ", "EAZ", "EYZ over C")
    whole = Grinding(yk7350b({"EXZ": wave, "EAZ": bend}), RV40E, 160.0)
    wanted = first_order(whole, grid.k, grid.theta, grid.z).ravel()
    np.testing.assert_allclose(flank.deviations(np.array([1.0, 1.0, 0.0])), wanted, atol=1e-14)
    turned = flank.deviations(np.array([0.0, 0.0, 1.0])).reshape(grid.shape)
    c = grinding_of().commands(grid.ks, 0.0)["C"]
    np.testing.assert_allclose(
        turned, np.broadcast_to(grid.section.ny, grid.shape) * np.cos(c)[:, None, None], atol=1e-15
    )


@pytest.mark.parametrize("many", [21, 90])
def test_blocks_go_into_the_given_output(many: int) -> None:
    grid = flank_grid(DISC, profile=3, width=4)
    names = [MOTION_NAMES[i % 18] for i in range(many)]
    parameters = [ErrorParameter(name, Fourier(1.0, (0.3,), (), 3.0 + i)) for i, name in enumerate(names)]
    flank = linear_flank(Grinding(yk7350b(), DISC, 190.0), grid, parameters)
    V = RNG.normal(size=(many, 7))
    out = np.empty((flank.points, 7))
    result = flank.deviations(V, out)
    assert result.base is out or result is out
    np.testing.assert_allclose(out, flank.jacobian() @ V, rtol=1e-12, atol=1e-10)
    rms = flank.normal_form().rms(V)
    np.testing.assert_allclose(rms, np.sqrt(np.mean(out**2, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(
        flank.normal_form().gram, flank.jacobian().T @ flank.jacobian() / flank.points, rtol=1e-9, atol=1e-9
    )


def test_figure_of_the_linear_flank_is_the_figure_of_the_points() -> None:
    grid = flank_grid(RV40E, profile=5, width=3)
    flank = linear_flank(grinding_of(), grid, TWENTY_ONE)
    v = np.array(list(random_constants(RNG).values()))
    e = flank.deviations(v).reshape(grid.shape)
    assert float(flank.figure_form.rms(v)) == pytest.approx(flank_figure(e, grid.section.h).rms, rel=1e-11)
    nothing = np.array([1.0 if name == "EZX" else 0.0 for name in TWENTY_ONE])
    assert float(flank.figure_form.rms(nothing)) < 1e-15


def test_commands_and_dressing_have_their_signs() -> None:
    grid = flank_grid(RV40E, profile=3, width=2, spaces=(0, 4))
    flank = linear_flank(grinding_of(), grid, ["X", "Z", "C", OFFSET, RADIUS])
    J = flank.jacobian().reshape(*grid.shape, 5)
    s = grid.section
    for column, wanted in enumerate((-s.nx, 0.0 * s.nx, -s.h, s.ny, -s.nx)):
        np.testing.assert_allclose(J[..., column], np.broadcast_to(wanted, grid.shape), atol=1e-13)


def test_goldens_of_the_house_as_jacobian_signs() -> None:
    """A deviation d that a table holds does the harm of the error: EXX = X(X), EXZ = -X(Z), ECC = C(C)."""
    grid = flank_grid(RV40E)
    J = linear_flank(grinding_of(), grid, ["EXX", "EXZ", "ECC", "X", "C"]).jacobian()
    exx, exz, ecc, x, c = J.T
    np.testing.assert_allclose(exx, x, atol=1e-12)
    np.testing.assert_allclose(exz, -x, atol=1e-12)
    np.testing.assert_allclose(ecc, c, atol=1e-12)


def test_five_um_of_eyc_cost_about_17_arcsec_on_c() -> None:
    grid = flank_grid(RV40E)
    cure = tangential_cure(RV40E, grid.thetas)
    arcsec = np.rad2deg(cure.dc_per_B * 0.005) * 3600.0
    assert 15.0 < abs(arcsec) < 18.0
    assert 0.04 < cure.eta < 0.09
    assert tangential_cure(DISC, flank_grid(DISC).thetas).eta > 0.3


@pytest.mark.parametrize(("frame", "rank"), [("moving", 9), ("fixed", 5)])
def test_what_the_flank_shows(frame: str, rank: int) -> None:
    grid = flank_grid(RV40E, profile=5, width=3)
    found = observability(linear_flank(Grinding(yk7350b(c_frame=frame), RV40E, 160.0), grid, TWENTY_ONE))  # type: ignore[arg-type]
    assert found.rank == rank
    assert set(found.null) == {"EZX", "EZZ", "EZC", "EAZ", "EBZ"}


def test_cures_name_the_simplest_and_what_is_left() -> None:
    grid = flank_grid(DISC, profile=4, width=3)
    grinding = Grinding(yk7350b(c_frame="fixed"), DISC, 190.0)
    wave = Fourier(0.0, (1.0,), (), 10.0)
    round_ = Fourier(0.0, (0.0, 1.0))
    asked = [
        "EXX",
        "EYZ",
        "ECC",
        "EZX",
        "EBX",
        "A0C",
        ErrorParameter("EXZ", wave),
        ErrorParameter("EXC", round_),
        ErrorParameter("ECC", round_, label="ECC 2c"),
        ErrorParameter("EBC", round_),
        ErrorParameter("EYZ", wave, label="EYZ wave"),
    ]
    found = {cure.error: cure for cure in cures(grinding, grid, asked)}
    wanted = {
        "EXX": "X zero",
        "EYZ": "dressing offset",
        "ECC": "C zero",
        "EZX": "none needed",
        "EBX": "X(Z)",
        "A0C": "mechanical only",
        "EXZ": "X(Z)",
        "EXC": "X(C)",
        "ECC 2c": "C(C)",
        "EBC": "X(Z)*(C)",
        "EYZ wave": "mechanical only",
    }
    assert {name: cure.by for name, cure in found.items()} == wanted
    for name, cure in found.items():
        assert cure.floor <= min(cure.left.values()) + 1e-12
        assert cure.floor == pytest.approx(0.0, abs=1e-9) or name in ("A0C", "EYZ wave")
    assert 0.3 < found["EYZ wave"].floor / found["EYZ wave"].rms < 0.45
    with pytest.raises(ModelError):
        cures(grinding, grid, ["EXX"], share=1.5)
