"""The handbook's figures are drawn by the code, and its page of maths says their numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import trueflank as tf
from release import figures

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "maths.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", figures.FIGURES)
def test_a_figure_is_drawn_and_shown(name: str, tmp_path: Path) -> None:
    path = tmp_path / "drawn.png"
    figures.FIGURES[name]().savefig(path)
    assert path.stat().st_size > 5000
    assert f"(maths-{name}.png)" in PAGE
    assert (ROOT / "docs" / f"maths-{name}.png").is_file()


def test_the_page_says_what_the_functions_give() -> None:
    flank, best = figures.tangential()
    assert f"RMS is {flank.rms:.2f} µm" in PAGE
    assert f"take it to {best.rms_after:.2f} µm" in PAGE
    turned = max(np.abs(table.deviations).max() for table in best.tables if table.name.startswith("C"))
    assert f"up to {turned:.0f} arcsec on purpose" in PAGE


def test_the_formulas_of_the_page_are_those_of_the_figures() -> None:
    found = figures.measured()
    told, x = tf.evaluate(found), found.deviations
    mean, s = x.mean(axis=1), x.std(axis=1, ddof=1)
    assert told["B"] == pytest.approx(np.abs(mean[:, 0] - mean[:, 1]).max())
    assert told["E"] == pytest.approx(np.ptp(mean))
    assert told["A"] == pytest.approx((mean + 2 * s).max() - (mean - 2 * s).min())
    b = np.abs(mean[:, 0] - mean[:, 1])
    assert told["R"] == pytest.approx(max((2 * s.sum(axis=1) + b).max(), (4 * s).max()))
