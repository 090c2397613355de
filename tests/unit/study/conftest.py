"""One small study for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.study.calculate import Study, study
from gateway.study.inputs import load_errors, load_gear

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="session")
def found() -> Study:
    """A small study of the seeded machine."""
    gear = load_gear(EXAMPLES / "gears" / "rv-40e-like.toml")
    small = gear.model_copy(update={"flank": gear.flank.model_copy(update={"profile": 5, "width": 3})})
    return study(small, load_errors(EXAMPLES / "errors" / "seeded-machine.toml"), r=4)
