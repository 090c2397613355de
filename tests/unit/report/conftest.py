"""The page of what a file of tests calls its material."""

from __future__ import annotations

import pytest

from gateway.report import ReportMaterial, render


@pytest.fixture(scope="module")
def document(material: ReportMaterial) -> str:
    """The page as one HTML document."""
    return render(material)
