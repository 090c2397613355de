"""Tests of `make browser`: without the extra `browser` they are not collected; `make browser` installs it."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import pytest

collect_ignore_glob = [] if find_spec("playwright") and find_spec("axe_playwright_python") else ["test_*.py"]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """One browser for the tests of a module that need no cell: there nothing is far away."""
    from playwright.sync_api import expect

    from tests.browser.person import PATIENCE_MS, chromium
    from tests.browser.stage import SOON_MS

    expect.set_options(timeout=SOON_MS)
    with chromium() as found:
        yield found
    expect.set_options(timeout=PATIENCE_MS)
