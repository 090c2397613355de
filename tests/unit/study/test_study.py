"""Studies: shipped gears and machines, what is told, pictures, and files that are wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image
from matplotlib.figure import Figure

import trueflank as tf
from drivers.errors import ConfigError, TrueflankError
from drivers.units import arcsec_to_rad
from gateway.cli.files.study import study_command
from gateway.errors import ModelError, StoreError
from gateway.gear.first_order import first_order
from gateway.gear.flank import flank_figure
from gateway.study import describe, drawing
from gateway.study.calculate import Study, study, the_order
from gateway.study.inputs import ErrorFile, gear_of, load_errors, load_gear
from gateway.study.machine import error_names, grid_of, grinding_of, machine_of, plan_of
from gateway.study.pictures import write_pictures

EXAMPLES = Path(__file__).parents[3] / "examples"
GEARS = sorted((EXAMPLES / "gears").glob("*.toml"))
ERRORS = sorted((EXAMPLES / "errors").glob("*.toml"))


def test_five_gears_are_shipped_and_all_can_be_ground() -> None:
    errors = load_errors(EXAMPLES / "errors" / "equal-steps.toml")
    seen = {}
    for path in GEARS:
        file = load_gear(path)
        grinding = grinding_of(file, errors)
        grid = grid_of(file, grinding.gear)
        e = first_order(grinding, grid.k, grid.theta, grid.z)
        assert 0.001 < flank_figure(np.broadcast_to(e, grid.shape), grid.section.h).rms < 0.02
        seen[path.stem] = grinding.gear
    assert len(seen) == 5
    assert (seen["stack-of-three"].zc, seen["stack-of-three"].b) == (39, 60.0)
    assert seen["eleven-lobes"].zc == 11


def test_equal_steps_are_the_papers_sizes() -> None:
    file = load_errors(EXAMPLES / "errors" / "equal-steps.toml")
    chain = machine_of(file)
    q = np.zeros(1)
    for axis in chain.axes:
        np.testing.assert_allclose(axis.errors(q)[0, :3], 0.005)
        np.testing.assert_allclose(axis.errors(q)[0, 3:], np.deg2rad(0.01))
    assert len(error_names(chain)) == 21


def test_functions_are_read_in_um_and_arcsec_over_mm_and_deg() -> None:
    file = ErrorFile.model_validate(
        {
            "name": "x",
            "errors": {
                "EXZ": {"type": "poly", "c": [1.0, 2.0], "q0": 10.0, "scale": 100.0},
                "ECC": {"type": "fourier", "a": [3.0], "b": [0.0, 2.0], "period": 360.0},
                "EYX": {"type": "pl", "q": [-100.0, 0.0], "v": [4.0, 0.0]},
                "EAC": {"type": "pl", "q": [0.0, 180.0], "v": [0.0, 5.0], "period": 360.0},
                "B0Z": 10.0,
            },
        }
    )
    chain = machine_of(file)
    assert chain.axis("Z").value("dx", np.array(60.0)) == pytest.approx(0.002)
    turn = np.deg2rad(30.0)
    wanted = arcsec_to_rad(3.0 * np.cos(turn) + 2.0 * np.sin(2.0 * turn))
    assert chain.axis("C").value("ec", np.array(turn)) == pytest.approx(wanted)
    assert chain.axis("X").value("dy", np.array(-50.0)) == pytest.approx(0.002)
    assert chain.axis("C").value("ea", np.array(1.5 * np.pi)) == pytest.approx(arcsec_to_rad(2.5))
    assert chain.axis("Z").loc["B0"] == pytest.approx(arcsec_to_rad(10.0))


def test_a_seed_gives_one_machine_and_given_errors_replace_drawn_ones() -> None:
    file = load_errors(EXAMPLES / "errors" / "seeded-machine.toml")
    one, two = machine_of(file), machine_of(file)
    q = np.linspace(-1.0, 1.0, 5)
    for a, b in zip(one.axes, two.axes, strict=True):
        np.testing.assert_array_equal(a.errors(q), b.errors(q))
    assert file.seeded is not None
    other = machine_of(file.model_copy(update={"seeded": file.seeded.model_copy(update={"seed": 8})}))
    assert not np.allclose(one.axis("X").errors(q), other.axis("X").errors(q))
    np.testing.assert_array_equal(one.axis("C").value("ec", q), other.axis("C").value("ec", q))


def test_the_plan_follows_the_file_or_suits_the_gear() -> None:
    gear = load_gear(EXAMPLES / "gears" / "stack-of-three.toml")
    errors = load_errors(EXAMPLES / "errors" / "seeded-machine.toml")
    plan = plan_of(errors, grinding_of(gear, errors))
    assert (plan.grid("X").minimum, plan.grid("C").step) == (-240.0, 15.0)
    assert (plan.grid("Z").minimum, plan.grid("Z").maximum) == (-35.0, 35.0)
    assert plan.bounds == {"C": 45.0}
    wrong = errors.model_copy(update={"tables": {"Y": errors.tables["X"]}})
    with pytest.raises(ModelError, match="Y"):
        plan_of(wrong, grinding_of(gear, errors))


def test_everything_is_told_and_the_tooth_gets_better(found: Study) -> None:
    data = json.loads(json.dumps(describe.as_data(found)))
    assert data["by_tooth"]["after"]["RMS normal deviation"] < 0.1 * data["by_tooth"]["before"]["RMS normal deviation"]
    for key in ("cumulative pitch F_p", "runout F_r", "profile F_a"):
        assert data["by_tooth"]["after"][key] < data["by_tooth"]["before"][key]
    assert set(data["one_at_a_time"]) == set(found.names)
    assert len(data["ranking"]["equal_steps"]["rms"]) == 21
    assert {one["tag"] for one in data["cures"].values()} <= {"axis", "set-up", "cross", "product", "mech", "none"}
    assert data["cures"]["EZZ"]["tag"] == "none"
    assert data["floor"]["products_um"] <= data["floor"]["tables_um"] <= data["floor"]["before_um"]
    assert max(abs(v) for a in data["by_axis"] if a["axis"] == "C" for v in a["predicted"]) <= 45.0 + 0.5
    assert data["next"][0]["share"] >= data["next"][-1]["share"]
    assert sum(one["share"] for one in data["next"]) == pytest.approx(1.0)
    assert {one["kind"] for one in data["tables"]} == {"axis", "cross"}
    assert data["truncation_um"] < 0.25


def test_products_are_worked_out_only_behind_a_proof() -> None:
    gear = load_gear(EXAMPLES / "gears" / "stack-of-three.toml")
    small = gear.model_copy(update={"flank": gear.flank.model_copy(update={"profile": 4, "width": 5})})
    errors = load_errors(EXAMPLES / "errors" / "seeded-machine.toml")
    plain = study(small, errors, r=1)
    assert plain.products == ()
    assert "not proved" in describe.product_lines(plain)[0]
    proved = study(small, errors.model_copy(update={"multiplication_proved": True}), r=1)
    assert proved.products
    assert proved.products[-1].after < 0.7 * proved.correction.checked.rms
    assert proved.products[-1].after >= proved.floor.products * 0.999
    assert "X(Z)*(C)" in describe.product_lines(proved)[0]
    assert proved.with_products is not None
    # The products are worked out to first order; second order with all of them acting finds the same.
    assert proved.with_products.figure.rms == pytest.approx(proved.products[-1].after, rel=0.02)
    assert f"{proved.with_products.figure.rms * 1e3:.3f} µm" in describe.product_lines(proved)[-1]


def test_exact_means_before_and_after_too() -> None:
    gear = load_gear(EXAMPLES / "gears" / "stack-of-three.toml")
    small = gear.model_copy(update={"flank": gear.flank.model_copy(update={"profile": 2, "width": 3})})
    errors = load_errors(EXAMPLES / "errors" / "seeded-machine.toml")
    second, whole = (study(small, errors, order=order, r=1) for order in ("second", "exact"))
    for name in ("before", "with_own", "after"):
        one, other = getattr(second, name).deviation, getattr(whole, name).deviation
        assert 0.0 < np.max(np.abs(one - other)) < 5e-6
    assert "exactly" in describe.order_line(whole)
    assert "second order" in describe.order_line(second)


def test_one_at_a_time_is_what_the_reference_says(found: Study) -> None:
    largest = {one.name: float(np.max(np.abs(one.deviation))) * 1e3 for one in found.alone}
    assert largest["EXX"] == pytest.approx(5.0, abs=0.1)
    assert 12.0 < largest["ECZ"] < 14.0
    assert 8.0 < largest["ECC"] < 9.0
    for name in ("EZX", "EZZ", "EZC", "EBZ"):
        assert largest[name] < 1e-6
    assert 1e-4 < largest["EAZ"] < 5e-3


def test_where_nothing_deviates_a_picture_is_white(found: Study, tmp_path: Path) -> None:
    sheet = Figure(figsize=(6.0, 3.0))
    drawing.flank_maps(sheet, found, [("flat", np.zeros(found.grid.shape)), ("as it is", found.before.deviation)])
    sheet.savefig(tmp_path / "flat.png")
    panel = image.imread(tmp_path / "flat.png")
    middle = panel[int(0.25 * panel.shape[0]), int(0.5 * panel.shape[1]), :3]
    assert np.all(middle > 0.96)
    assert panel[int(0.75 * panel.shape[0]), :, :3].std() > 0.1
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="E-STUDY-WRITE"):
        write_pictures(found, tmp_path / "file")


def test_the_command_tells_people_and_programs_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gear, errors = EXAMPLES / "gears" / "eleven-lobes.toml", EXAMPLES / "errors" / "seeded-machine.toml"
    options = {"scheduler": "", "workers": None, "order": "first", "trajectories": 2}
    study_command(gear, errors, as_json=False, **options)  # type: ignore[arg-type]
    text = capsys.readouterr().out
    for part in ("by axis", "by tooth", "set-up values", "ECC", "RMS on the flank", "next"):
        assert part in text
    study_command(gear, errors, plots=tmp_path, as_json=True, **options)  # type: ignore[arg-type]
    data = json.loads(capsys.readouterr().out)
    assert data["gear"] == "11-lobe disc"
    paths = [Path(one) for one in data["pictures"]]
    assert {path.stem for path in paths} == {
        "one-at-a-time",
        "flank-before-after",
        "ranking",
        "pitch",
        "axes-before-after",
    }
    for path in paths:
        picture = image.imread(path)
        assert picture.shape[1] > 1200
        assert picture[..., :3].std() > 0.02


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("name = ", "E-STUDY-TOML"),
        ('name = "x"\n[grinding]\ncentre_distance_mm = 100.0', "E-STUDY-VALUE"),
        ('name = "x"\n[gear]\nrp=1.0\nrrp=1.0\na=1.0\nzp=4\nzc=3\nfoo=1\n[grinding]\ncentre_distance_mm=9.0', "foo"),
    ],
)
def test_a_wrong_gear_file_names_file_and_key(tmp_path: Path, text: str, code: str) -> None:
    path = tmp_path / "gear.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=code) as caught:
        load_gear(path)
    assert str(path) in str(caught.value)
    with pytest.raises(ConfigError, match="E-STUDY-READ"):
        load_gear(tmp_path / "nothing.toml")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('name = "x"', "seed"),
        ('name = "x"\n[errors]\nEXX = "five"', "errors"),
        ('name = "x"\n[errors]\nEXX = {type = "spline"}', "errors"),
        ('name = "x"\n[errors]\nEXX = 1.0\n[tables.X]\nminimum=0.0\nmaximum=10.0\nstep=3.0', "divide"),
        ('name = "x"\n[errors]\nEXX = 1.0\n[machine]\npreset = ""', "chain"),
    ],
)
def test_a_wrong_error_file_says_why(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "errors.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=why):
        load_errors(path)


def test_unknown_errors_and_orders_are_refused_by_name() -> None:
    file = ErrorFile.model_validate({"name": "x", "errors": {"EXY": 1.0}})
    with pytest.raises(ModelError, match="EXY"):
        machine_of(file)
    with pytest.raises(ModelError, match="third"):
        the_order("third")
    gear = load_gear(EXAMPLES / "gears" / "rv-20e-like.toml")
    with pytest.raises(ModelError, match="E-GEAR-UNDERCUT"):
        gear_of(gear.model_copy(update={"gear": gear.gear.model_copy(update={"rrp": 9.0})}))


@pytest.mark.parametrize(
    ("one", "code", "said"),
    [
        ('{ type = "fourier", c = [1.0, 2.0] }', "E-STUDY-VALUE", 'c of type "fourier" means nothing'),
        ('{ type = "fourier" }', "E-STUDY-VALUE", "needs a0, a or b"),
        ('{ type = "poly", c = [0.0, 1.0], a0 = 3.0 }', "E-STUDY-VALUE", "a0"),
        ('{ type = "pl", q = [-300.0, 0.0], v = [0.0, 5.0], scale = 2.0 }', "E-STUDY-VALUE", "scale"),
        ('{ type = "fourier", a = [1.0] }', "E-CHAIN-MOTION-DATA", "period in mm"),
    ],
)
def test_a_key_that_an_error_has_no_use_for_is_refused_and_so_is_a_wave_without_length(
    one: str, code: str, said: str, tmp_path: Path
) -> None:
    """Each was an error of nothing, or a wave of 6.28 mm, without a word."""
    (tmp_path / "errors.toml").write_text(f'name = "x"\n[errors]\nEXX = {one}\n', encoding="utf-8")
    with pytest.raises(TrueflankError) as refused:
        tf.Machine.load(tmp_path / "errors.toml").relative(X=-160.0, Z=0.0, C=0.0)
    assert refused.value.code == code
    assert said in str(refused.value)
