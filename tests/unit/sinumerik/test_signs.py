"""The sign of cross tables is turned in one place, by the proof that came with order or question."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.sinumerik.tablefile.tables import order_sense, sense_of, table_by_proof, tables_by_proof
from drivers.types.orders import PushOrder
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Sense
from tests.signed import proof_of

OWN = CompensationTable("axis", "X1", "X1", 0.0, 20.0, 10.0, (0.0, 2.0, -1.0))
CROSS = CompensationTable("cross", "Z1", "X1", 0.0, 20.0, 10.0, (0.0, 3.0, -4.0), index=2, reverse=(1.0, 0.0, -2.0))
LIVE = LiveSet("X1", LiveTable(OWN, True), (LiveTable(CROSS, True),), 0.0, "", "0" * 64, (LiveTable(CROSS, False),))


def order(table: CompensationTable, sign: Sense | None) -> PushOrder:
    proof = proof_of(sign) if sign is not None else None
    return PushOrder(
        1, table, letter="Z", rotary=False, enable=True, agreeing_position=0.0, purpose="table", proof=proof
    )


def test_without_a_proof_cross_tables_are_as_stored() -> None:
    assert tables_by_proof(LIVE, None) == LIVE
    assert sense_of(None) == 1


@pytest.mark.parametrize("sign", [1, -1])
def test_values_are_turned_once_and_back(sign: Sense) -> None:
    meant = tables_by_proof(LIVE, proof_of(sign))
    assert meant.sense == sign
    assert meant.own == LIVE.own
    for one in (*meant.cross, *meant.others):
        assert one.table.deviations == tuple(sign * value + 0.0 for value in CROSS.deviations)
        assert one.table.reverse == tuple(sign * value + 0.0 for value in CROSS.reverse)
    assert tables_by_proof(meant, proof_of(sign)) == meant  # never twice
    assert tables_by_proof(meant, None) == LIVE


def test_an_axis_table_and_a_proof_of_one_turn_nothing() -> None:
    proof = replace(proof_of(-1), kind="axis", sign=1)
    assert table_by_proof(OWN, 1, proof_of(-1)) == OWN
    assert tables_by_proof(LIVE, proof) == LIVE


@pytest.mark.parametrize(("table", "sign", "sense"), [(CROSS, -1, -1), (CROSS, 1, 1), (CROSS, None, 1), (OWN, -1, 1)])
def test_an_order_says_its_sense(table: CompensationTable, sign: Sense | None, sense: Sense) -> None:
    assert order_sense(order(table, sign)) == sense
