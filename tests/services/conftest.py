"""Tests of `make services`: their libraries are in an extra of their own, and without it they are not collected.

`make services` installs the extra; where nothing is collected then, pytest itself ends with an error. It also loads
schemathesis' plugin: to collect its tests costs seconds, and all other targets deselect them.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

collect_ignore = [] if find_spec("psycopg") else ["test_postgresql.py"]


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """The tests by description are for who loads the plugin that makes them."""
    if collection_path.name == "test_api.py" and not config.pluginmanager.has_plugin("schemathesis.pytest.plugin"):
        return True
    return None
