"""A set-up's table whose heading names no unit holds its error's; one that names another kind is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.config import SiteFile
from gateway.errors import CaptureError
from gateway.workflow.errors21.filesetup import read_setup
from gateway.workflow.errors21.setups import planned
from tests.unit.components.site import site_data

ROWS = "0,+,1,0.5\n10,+,1,1.25\n10,-,1,-1.5\n0,-,1,0.25\n"


@pytest.mark.parametrize("heading", ["target", "target_mm"])
def test_bare_deviations_are_those_of_the_error(tmp_path: Path, heading: str) -> None:
    plan = planned(SiteFile.model_validate(site_data()))
    units = {one.unit for one in plan if one.axis.kind == "linear"}
    assert units == {"um", "arcsec"}
    for unit in units:
        one = next(found for found in plan if found.unit == unit and found.axis.kind == "linear")
        path = tmp_path / f"{one.key}.csv"
        path.write_text(f"{heading},direction,repetition,deviation\n{ROWS}", encoding="utf-8")
        found = read_setup(path, one, "grinder", None)
        assert (found.deviations[1, 0].tolist(), found.axis_unit) == ([1.25, -1.5], "mm")


def test_a_length_that_says_so_is_no_angle(tmp_path: Path) -> None:
    one = next(one for one in planned(SiteFile.model_validate(site_data())) if one.unit == "arcsec")
    path = tmp_path / "one.csv"
    path.write_text(f"target_mm,direction,repetition,deviation_um\n{ROWS}", encoding="utf-8")
    with pytest.raises(CaptureError) as caught:
        read_setup(path, one, "grinder", None)
    assert caught.value.code == "E-DAY-UNIT"
