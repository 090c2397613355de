"""Page 1 of the report: M over the travel stands beside M of the targets exactly where it is the larger, as printed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.domain.figures import Evaluation
from gateway.report.document.content import TableBlock
from gateway.report.document.first import answer
from gateway.report.document.words import Tongue
from tests.unit.report import synthetic


def figures(m: float, travel: float | None) -> Evaluation:
    one = synthetic.axis_material("X1", "mm").before
    assert one is not None
    known = {name: value for name, value in one.U.items() if name != "M_travel"}
    return replace(one, M=m, M_travel=travel, U=known if travel is None else {**known, "M_travel": 0.5})


@pytest.mark.parametrize(
    ("before", "after", "row"),
    [
        ((10.0, 11.5), (2.0, 2.0), ("10.00", "11.50", "2.00")),
        ((10.0, 10.0), (2.0, 2.6), ("10.00", "10.00", "2.60")),
        ((10.0, 10.0), (2.0, 2.0), None),
        ((10.0, 9.0), (2.0, 1.5), None),
        ((10.0, 10.004), (2.0, 2.0), None),
        ((10.0, None), (2.0, None), None),
    ],
)
def test_m_over_the_travel_where_it_exceeds_m(
    before: tuple[float, float | None], after: tuple[float, float | None], row: tuple[str, str, str] | None
) -> None:
    axis = replace(synthetic.axis_material("X1", "mm"), before=figures(*before), after=figures(*after))
    report = replace(synthetic.material(), axes=(axis,))
    for language in ("en", "de", "zh"):
        t = Tongue(language)
        (table,) = [one for one in answer(report, t) if isinstance(one, TableBlock)]
        told = {line[1]: line for line in table.rows}
        name = t("figure_M_travel")
        assert (name in told) == (row is not None)
        if row is not None:
            assert (told["M"][2], told[name][2], told[name][4]) == row
            assert told[name][3] == "0.50"
