"""The double's faults by name: listed out of the code, bounded, and played."""

from __future__ import annotations

from typing import Any

import pytest

from simulators.faults import named_faults
from simulators.pytest_plugin import FaultBox


def test_every_fault_has_a_meaning_of_its_own(trueflank_faults: FaultBox) -> None:
    known = trueflank_faults.known
    assert {"control.float32_tables", "server.answer_s", "wire.flip", "control.activation"} <= set(known)
    assert known["control.float32_tables"] == "table values are kept in single precision"
    assert [name for name, meaning in known.items() if not meaning.strip() or "\n" in meaning] == []


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("control.float32_tables", 1),
        ("wire.flip", 1.5),
        ("wire.flip", float("nan")),
        ("control.activation", "never"),
        ("control.loses_last_points", True),
        ("server.answer_s", -1.0),
    ],
)
def test_a_value_that_a_fault_cannot_have_is_refused_with_its_name(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=name):
        named_faults()[name].checked(value)


def test_a_name_that_does_not_exist_is_refused_with_those_that_do(trueflank_faults: FaultBox) -> None:
    async def main(_cell: Any) -> None:
        raise AssertionError("it never starts")

    with pytest.raises(ValueError, match=r"'control.none' is no fault; .*wire.flip"):
        trueflank_faults.in_memory(main, {"control.none": True}, "zero")


def test_a_fault_by_its_name_is_played(trueflank_faults: FaultBox) -> None:
    async def main(cell: Any) -> tuple[float, float]:
        cell.nck.set("$AA_ENC_COMP[0,0,X1]", 0.123456789, 0)
        return cell.nck.get("$AA_ENC_COMP[0,0,X1]"), cell.server.quirks.answer_s

    found, answer_s = trueflank_faults.in_memory(main, {"control.float32_tables": True, "server.answer_s": 0.5}, "zero")
    assert found != 0.123456789
    assert found == pytest.approx(0.123456789, rel=1e-6)
    assert answer_s == 0.5
