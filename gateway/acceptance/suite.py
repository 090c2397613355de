"""The shipped acceptance suite: one test for each check of a site and each of its axes."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.acceptance.judging import run_check
from gateway.acceptance.pytest_plugin import RESULTS
from gateway.acceptance.working import SiteDesk


def test_acceptance(trueflank_case: Any, trueflank_desk: SiteDesk, request: pytest.FixtureRequest) -> None:
    """What was seen stands in the JUnit file as a property, and in the sheet."""
    check, axis = trueflank_case
    allow = request.config.getoption("--allow")
    result = asyncio.run(run_check(check, axis, trueflank_desk, allow))
    request.config.stash[RESULTS].append(result)
    properties = {**result.as_record(), "site": trueflank_desk.site.site.name}
    request.node.user_properties += properties.items()
    if result.outcome == "skipped":
        pytest.skip(result.said)
    if result.outcome == "failed":
        pytest.fail(result.said, pytrace=False)
