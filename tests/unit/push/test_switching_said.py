"""By how much switching moves an axis, said before the press: each table that does, and in one line the rest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from drivers.errors import words
from drivers.types.tables import CompensationTable
from gateway.push.load import OFF_CODES, _say_moves


def test_tables_that_move_nothing_share_one_line_and_the_others_have_one_each() -> None:
    said: list[tuple[str, dict[str, Any]]] = []

    def load(name: str, kind: Any, axis: str) -> Any:
        table = CompensationTable(
            kind=kind,
            input_axis="Z1",
            output_axis=axis,
            input_unit="mm",
            output_unit="mm",
            minimum=0.0,
            maximum=100.0,
            step=100.0,
            deviations=(0.0, 0.0),
        )
        context = SimpleNamespace(say=lambda code, **fields: said.append((code, fields)))
        work = SimpleNamespace(axis=axis, context=context, agreeing_position=40.0, change=SimpleNamespace(name=name))
        return SimpleNamespace(work=work, order=SimpleNamespace(table=table))

    loads = (
        load("Z1", "axis", "Z1"),
        load("Z1-reversal", "reversal", "Z1"),
        load("X1-cec2", "cross", "X1"),
    )
    _say_moves(OFF_CODES, loads, (0.004, -1.48, 0.0))
    assert [words(code, **fields) for code, fields in said] == [
        "switching Z1-reversal off will move Z1 by 1.48 \u00b5m, with Z1 at 40 mm",
        "switching Z1, X1-cec2 off moves no axis",
    ]
