"""Tests of `make services`: their libraries are in an extra of their own, and without it they are not collected.

`make services` installs the extra; where nothing is collected then, pytest itself ends with an error.
"""

from __future__ import annotations

from importlib.util import find_spec

collect_ignore = [] if find_spec("schemathesis") and find_spec("psycopg") else ["test_api.py", "test_postgresql.py"]
