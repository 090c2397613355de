"""Every worked metrology case through the functions the run calls."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.unit.evaluate.cases import CONTRASTS, RUN, stated

GOLDEN = Path(__file__).parents[2] / "golden" / "metrology_cases.json"
CASES = json.loads(GOLDEN.read_text(encoding="utf-8"))["cases"]


def agree(found: Any, expected: Any, rel: float, tolerance: float, path: str) -> None:
    """Compare whatever the case states; a stated null must be None or NaN."""
    if isinstance(expected, dict):
        for name, value in expected.items():
            agree(found[name], value, rel, tolerance, f"{path}.{name}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), path
        for i, value in enumerate(expected):
            agree(found[i], value, rel, tolerance, f"{path}[{i}]")
    elif expected is None:
        assert found is None or np.isnan(found), path
    elif isinstance(expected, str):
        assert found == expected, path
    else:
        assert float(found) == pytest.approx(expected, rel=rel, abs=tolerance), path


@pytest.mark.parametrize("case", CASES, ids=[case["id"] for case in CASES])
def test_case(case: dict[str, Any]) -> None:
    found = RUN[case["kind"]](case["input"])
    agree(found, stated(case), case["tol_rel"], case["tol_abs"], case["id"])
    for name in CONTRASTS.keys() & case["expected"].keys():
        wrong = pytest.approx(case["expected"][name], rel=case["tol_rel"], abs=case["tol_abs"])
        assert float(found[CONTRASTS[name]]) != wrong, name


def test_all_cases_are_there() -> None:
    assert len(CASES) == 51
