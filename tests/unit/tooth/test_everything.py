"""What cross tables make of an axis: its curve and range with everything acting, and the words for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.message import Message
from drivers.types.tables import CompensationTable
from gateway.domain.proposals import TableChange
from gateway.workflow.tooth.messages import full_correction_outlooks, outlook_messages

AT = np.arange(0.0, 360.0, 15.0)


def table(index: int, over: str, values: np.ndarray, *, direction: int = 0, own: bool = False) -> CompensationTable:
    kind, last = ("axis" if own else "cross"), 360.0 if over == "C1" else 300.0
    step = last / (len(values) - 1)
    return CompensationTable(
        kind, over, "C1", 0.0, last, step, tuple(float(v) for v in values), over == "C1", index,
        "deg" if over == "C1" else "mm", "deg", direction=direction,
    )  # type: ignore[arg-type]  # fmt: skip


def change(new: CompensationTable, predicted: np.ndarray, *, skipped: Message | None = None) -> TableChange:
    old = replace(new, deviations=(0.0,) * len(new.deviations))
    at = AT if predicted.size else np.zeros(0)
    return TableChange("C1", old, new, False, "digest", at, predicted, np.full(at.size, 0.5), skipped=skipped)


def test_a_cross_table_over_the_axis_itself_is_in_its_curve_and_others_only_move_it() -> None:
    flat = np.zeros(25)
    own = change(table(0, "C1", flat, own=True), 0.3 * np.sin(np.radians(AT)))
    wave = 5.0 * np.cos(np.radians(3.0 * np.arange(0.0, 361.0, 15.0)))
    cross = [
        change(table(1, "C1", wave), np.zeros(0)),
        change(table(2, "Z1", np.array([0.0, 4.0, -2.0])), np.zeros(0)),
        change(table(3, "X1", np.array([0.0, 9.0])), np.zeros(0), skipped=Message.stored("no room")),
    ]
    (found,) = full_correction_outlooks([own], cross)
    assert np.allclose(found.deviation, own.predicted - 5.0 * np.cos(np.radians(3.0 * AT)))
    assert abs(found.M - np.ptp(found.deviation)) < 1e-12
    assert abs(found.M_U - np.hypot(0.5, 0.5)) < 1e-12
    assert found.M_alone < 1.0
    assert found.M > 9.0
    assert dict(found.moved_by) == {"Z1": 6.0}
    first, second = map(str, outlook_messages([found]))
    assert "on purpose" in first
    assert f"{found.M:.2f}" in first
    assert "6.00" in second


def test_a_table_of_one_direction_counts_half_in_the_mean_and_nothing_is_said_without_cross_tables() -> None:
    own = change(table(0, "C1", np.zeros(25), own=True), np.zeros(AT.size))
    steady = np.linspace(0.0, 4.0, 25)
    (found,) = full_correction_outlooks([own], [change(table(1, "C1", steady, direction=1), np.zeros(0))])
    assert np.allclose(found.deviation, -0.5 * np.interp(AT, np.arange(0.0, 361.0, 15.0), steady))
    assert list(outlook_messages(full_correction_outlooks([own], []))) == []
