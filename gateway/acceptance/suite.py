"""The shipped acceptance suite: one test for each check of a site and each of its axes."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from drivers.errors import TrueflankError
from gateway.acceptance.checks import SiteDesk, run_check
from gateway.acceptance.pytest_plugin import RESULTS


def test_acceptance(trueflank_case: Any, trueflank_desk: SiteDesk, request: pytest.FixtureRequest) -> None:
    """What was seen stands in the JUnit file as a property, and in the sheet."""
    check, axis = trueflank_case
    level = request.config.getoption("--allow")
    try:
        result = asyncio.run(run_check(check, axis, trueflank_desk, level))
    except TrueflankError as error:
        pytest.fail(str(error), pytrace=False)
    request.config.stash[RESULTS].append(result)
    properties = {"check": result.name, "level": result.level, "outcome": result.outcome, "said": result.said}
    properties["site"] = trueflank_desk.site.site.name
    request.node.user_properties += properties.items()
    if result.outcome == "skipped":
        pytest.skip(result.said)
    if result.outcome == "wrong":
        pytest.fail(result.said, pytrace=False)
