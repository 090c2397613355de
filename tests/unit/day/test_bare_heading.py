"""A set-up's table whose heading names no unit is asked about; one that names another kind is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from gateway.config import SiteFile
from gateway.errors import CaptureError
from gateway.workflow.errors21.setup_capture import read_setup
from gateway.workflow.errors21.setups import plan_setups
from tests.unit.components.site import site_data

GOLDEN = Path(__file__).parents[2] / "golden" / "files"
ROWS = "0,+,1,0.5\n10,+,1,1.25\n10,-,1,-1.5\n0,-,1,0.25\n"


def test_bare_deviations_are_asked_for_and_stated_ones_read(tmp_path: Path) -> None:
    """The error's own unit would be a guess: a pitch in um per metre, or in urad, looks the same."""
    plan = plan_setups(SiteFile.model_validate(site_data()))
    units = {one.unit for one in plan if one.axis.kind == "linear"}
    assert units == {"um", "arcsec"}
    for unit in units:
        one = next(found for found in plan if found.unit == unit and found.axis.kind == "linear")
        path = tmp_path / f"{one.key}.csv"
        path.write_text(f"target_mm,direction,repetition,deviation\n{ROWS}", encoding="utf-8")
        with pytest.raises(ConfigError, match=r"E-IMPORT-READINGS.*reading_unit="):
            read_setup(path, one, "grinder", None)
        path.write_text(f"target_mm,direction,repetition,deviation_{unit}\n{ROWS}", encoding="utf-8")
        found = read_setup(path, one, "grinder", None)
        assert (found.deviations[1, 0].tolist(), found.axis_unit) == ([1.25, -1.5], "mm")


def test_a_length_that_says_so_is_no_angle(tmp_path: Path) -> None:
    one = next(one for one in plan_setups(SiteFile.model_validate(site_data())) if one.unit == "arcsec")
    path = tmp_path / "one.csv"
    path.write_text(f"target_mm,direction,repetition,deviation_um\n{ROWS}", encoding="utf-8")
    with pytest.raises(CaptureError) as caught:
        read_setup(path, one, "grinder", None)
    assert caught.value.code == "E-DAY-UNIT"


@pytest.mark.parametrize(("unit", "arcsec"), [("deg", 3600.0), ("mrad", 206.264806), ("urad", 0.206264806)])
def test_an_angle_in_a_file_of_lengths_is_scaled_from_its_stated_unit(tmp_path: Path, unit: str, arcsec: float) -> None:
    """An .rtl holds no unit of an angle: its numbers are those of the unit that the site file states."""
    one = next(one for one in plan_setups(SiteFile.model_validate(site_data())) if one.unit == "arcsec")
    stated = replace(one, setup=one.setup.model_copy(update={"unit": unit}))
    path = tmp_path / "pitch.rtl"
    path.write_bytes((GOLDEN / "basic.rtl").read_bytes())
    plain = read_setup(path, one, "grinder", None).deviations
    np.testing.assert_allclose(read_setup(path, stated, "grinder", None).deviations, arcsec * plain, rtol=1e-8)
