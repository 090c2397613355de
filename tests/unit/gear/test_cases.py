"""Every worked case of a kind answered here agrees to its own tolerance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.unit.gear.cases import CASES, KINDS


@pytest.mark.parametrize("case", [c for c in CASES if c["kind"] in KINDS], ids=lambda c: c["id"])
def test_case(case: dict[str, Any]) -> None:
    answer = KINDS[case["kind"]](case["input"])
    for key, wanted in case["expect"].items():
        if isinstance(wanted, list) and wanted and isinstance(wanted[0], str):
            assert set(answer[key]) == set(wanted)
        else:
            rel, absolute = case.get("rel", 1e-9), case.get("abs", 1e-12)
            np.testing.assert_allclose(np.asarray(answer[key]), np.asarray(wanted), rtol=rel, atol=absolute)
