"""How much of a family of tests `make test` runs: a few, and the rest with `make long` and `make soak`.

What is marked `long` or `soak` is the same code with other numbers or another machine; never its only test.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def few(values: Iterable[Any], keep: int = 1, more: int | None = None) -> list[Any]:
    """Values for ``parametrize``: the first ``keep`` as they are, then ``more`` marked `long` (or all).

    The others are marked `soak`.
    """
    ends = float("inf") if more is None else keep + more
    return [one if at < keep else long(one) if at < ends else soak(one) for at, one in enumerate(values)]


def long(one: Any) -> Any:
    """One value for ``parametrize`` (a tuple for several names), marked `long`."""
    return pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.long)


def soak(one: Any) -> Any:
    """The same, marked `soak`: what `make long` has no time for."""
    return pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.soak)
