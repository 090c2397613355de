"""Every axis with all tables acting stands in page and document: predicted, and as a short check found it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.domain.outcomes import ActingCheck
from gateway.report import AxisMaterial, ReportMaterial, render
from gateway.report.document.charts import axes
from gateway.report.document.content import Block, Pair, Paragraph, PictureBlock, Whole
from gateway.report.document.words import Tongue
from gateway.tooth import AxisOutlook
from gateway.workflow.axes.short_capture import judge_combined_effect
from tests.unit.report import synthetic
from tests.unit.report.test_page import Outline

SPOILT = "With every table acting, as predicted: M = 9.00 ± 0.64 arcsec (k = 2); with its own table alone 0.00 arcsec."


def outlook(axis: AxisMaterial, size: float) -> AxisOutlook:
    """An axis whose own curve cross tables change by so much, about zero with its own table alone."""
    assert axis.change is not None
    at, U = axis.change.targets, axis.change.predicted_U
    curve = axis.change.predicted + 0.5 * size * np.cos(np.radians(3.0 * at))
    M_U = float(np.sqrt(2.0) * U[0])
    return AxisOutlook(
        axis.axis, axis.deviation_unit, at, curve, U, M=float(np.ptp(curve)), M_U=M_U, M_alone=0.0, moved_by={}
    )


def check(said: AxisOutlook) -> ActingCheck:
    few = slice(None, None, 4)
    return judge_combined_effect(
        said, (said.targets[few], said.deviation[few] + 3.0, np.full(said.targets[few].size, 0.3))
    )


def run(*, checked: bool) -> ReportMaterial:
    """X1 keeps its own curve, C1 is spoilt by 9 arcsec."""
    first, _, last = (one := synthetic.material()).axes
    spoilt = outlook(last, 9.0)
    found = check(spoilt) if checked else None
    return replace(one, axes=(replace(first, outlook=outlook(first, 0.0)), replace(last, outlook=spoilt, acting=found)))


def flat(blocks: tuple[Block, ...]) -> list[Block]:
    inner: list[Block] = []
    for one in blocks:
        parts = one.blocks if isinstance(one, Whole) else (*one.left, *one.right) if isinstance(one, Pair) else ()
        inner += flat(parts) if parts else [one]
    return inner


@pytest.mark.parametrize("checked", [False, True])
def test_page_and_document_show_every_axis_with_everything_acting(checked: bool) -> None:
    material = run(checked=checked)
    text = Outline(render(material)).text
    said = SPOILT.replace("as predicted", "predicted and checked at 6 targets") if checked else SPOILT
    assert said in text
    assert (
        "With every table acting, as predicted: M = 0.00 ± 0.64 µm (k = 2); no cross table changes its curve." in text
    )
    blocks = flat(axes(material, Tongue("en")))
    told = [one.text for one in blocks if isinstance(one, Paragraph) and one.text.startswith("With all tables acting")]
    assert told[0].startswith("With all tables acting, predicted: M = 0.00 ± 0.64 µm. No cross table")
    assert ("as predicted" if checked else "Not checked by measuring.") in told[1]
    drawn = [
        one for one in blocks if isinstance(one, PictureBlock) and one.caption.startswith("With all tables acting")
    ]
    (svg,) = (one.svg for one in drawn)
    assert "arcsec" in svg
    assert "predicted" not in svg  # the caption says it, in the reader's language
