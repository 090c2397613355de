"""Whatever a caller sends by the shipped description, no route ends in a fault of ours; run by `make services`."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, settings

from gateway.users import Tries
from tests.unit.web.services import TOKEN, Time, offered
from tests.unit.web.test_daemon import SITE

pytestmark = pytest.mark.services
BEARER = {"Authorization": f"Bearer {TOKEN}"}
FOLDER = tempfile.TemporaryDirectory(prefix="trueflank-api-")
OFFER = offered(Path(FOLDER.name), SITE, asks=Tries(Time(), 10**9, 1.0), tries=Tries(Time(), 10**9, 1.0))
RUN = OFFER.at.store.create("hall-3")
SCHEMA: Any = schemathesis.openapi.from_dict(OFFER.app.openapi())
SCHEMA.app = OFFER.app


@SCHEMA.parametrize()
@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
def test_no_route_ends_in_a_fault(case: Any) -> None:
    if "site" in (case.path_parameters or {}):
        case.path_parameters["site"] = "hall-3"
    if "run" in (case.path_parameters or {}):
        case.path_parameters["run"] = RUN.run_id
    answer = case.call(base_url="http://127.0.0.1", headers=BEARER)
    assert answer.status_code < 500, answer.text
    assert TOKEN not in answer.text
