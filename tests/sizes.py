"""How much of a family of tests `make test` runs: a few, and the rest with `make long`.

What is marked `long` is the same code with other numbers or another machine; never the only test of something.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def few(values: Iterable[Any], keep: int = 1) -> list[Any]:
    """Values for ``parametrize``: the first ``keep`` as they are, the others marked `long`."""
    return [one if at < keep else long(one) for at, one in enumerate(values)]


def long(one: Any) -> Any:
    """One value for ``parametrize`` (a tuple for several names), marked `long`."""
    return pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.long)


def soak(one: Any) -> Any:
    """The same, marked `soak`: what `make long` has no time for."""
    return pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.soak)
