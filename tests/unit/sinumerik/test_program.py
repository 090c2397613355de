"""Generated programs as text: motion, hand-shake, the two halves, what is never written."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import LocalProtocolError, TableError
from drivers.sinumerik.ncprogram import measuring as measuring_program
from drivers.sinumerik.ncprogram import pushing as pushing_program
from drivers.sinumerik.ncprogram.backup import ReservedPoints
from drivers.sinumerik.ncprogram.blocks import Motion
from drivers.sinumerik.ncprogram.measuring import MachineSetting
from drivers.sinumerik.ncprogram.words import Words
from drivers.types.identity import MachineIdentity
from drivers.types.orders import PushOrder, SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from simulators.nck.language.parser import parse

LOOPED = MachineSetting(Words(80), ReservedPoints(80, (0, 30), ("X1", "Z1", "C1")), modulo=False)
SETTING = replace(LOOPED, loops=False)  # written out one by one, as a control without arrays gets it
TABLE = CompensationTable("axis", "X1", "X1", 0.0, 100.0, 50.0, (0.0, -3.0, 0.0))
PROOF = SignProof(MachineIdentity("S", "V", ("X1",)), "axis", "X1", 1.0, 0.01, 1, "2026-01-01")
ORDER = PushOrder(4711, TABLE, "X", False, True, 0.0, "table", PROOF)


def rounds(count: int, targets: tuple[float, ...] = (0.0, 50.0, 100.0)) -> tuple[Stop, ...]:
    return tuple(
        Stop(target, approach, repetition, label)
        for repetition in range(count)
        for approach, order in ((1, targets), (-1, targets[::-1]))
        for label, target in enumerate(order)
    )


def plan(stops: tuple[Stop, ...], **more: object) -> StopPlan:
    made = StopPlan("T", "X1", "X", "mm", False, stops, 500.0, 5.0, 1.0, "TRUEFLANK SETUP EXX ON X")
    return replace(made, **more)


def moves(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("SUPA")]


def test_like_repetitions_become_one_loop_and_others_are_written_out() -> None:
    looped = measuring_program.build_measuring_program(plan(rounds(5)), 123456, SETTING)
    assert "FOR UROUND=0 TO 4" in looped
    assert looped.count("R80=R80+1") == 6
    uneven = measuring_program.build_measuring_program(plan((*rounds(2), Stop(10.0, 1, 2, 9))), 123456, SETTING)
    assert "FOR UROUND" not in uneven
    assert uneven.count("R80=R80+1") == 13
    for text in (looped, uneven):
        parse(text)


def test_each_stop_is_approached_from_its_own_side_with_overrun() -> None:
    assert moves(measuring_program.build_measuring_program(plan(rounds(1)), 1, SETTING)) == [
        "SUPA G1 X=-5.0 F=500.0",
        "SUPA G1 X=0.0 F=500.0",
        "SUPA G1 X=50.0 F=500.0",
        "SUPA G1 X=100.0 F=500.0",
        "SUPA G1 X=105.0 F=500.0",
        "SUPA G1 X=100.0 F=500.0",
        "SUPA G1 X=50.0 F=500.0",
        "SUPA G1 X=0.0 F=500.0",
    ]


def test_a_modulo_axis_turns_with_acp_and_acn() -> None:
    turning = plan(rounds(1, (0.0, 180.0, 360.0)), letter="C", axis="C1", unit="deg", rotary=True)
    assert [
        line.split()[2]
        for line in moves(measuring_program.build_measuring_program(turning, 1, replace(SETTING, modulo=True)))
    ] == [
        "C=DC(355.0)",
        "C=ACP(0.0)",
        "C=ACP(180.0)",
        "C=ACP(0.0)",
        "C=IC(5.0)",
        "C=ACN(0.0)",
        "C=ACN(180.0)",
        "C=ACN(0.0)",
    ]


def test_standing_still_to_switch_does_not_move() -> None:
    stops = tuple(Stop(50.0, 1, 0, n, switch) for n, switch in enumerate((True, False, True)))
    text = measuring_program.build_measuring_program(plan(stops), 1, SETTING)
    assert len(moves(text)) == 2
    assert text.count("$MA_ENC_COMP_ENABLE[0,X1]=1\nNEWCONF") == 2
    assert text.count("$MA_ENC_COMP_ENABLE[0,X1]=0\nNEWCONF") == 1


@given(
    st.lists(st.tuples(st.integers(-72, 72), st.sampled_from([1, -1])), min_size=1, max_size=12),
    st.floats(0.5, 20.0),
    st.booleans(),
)
def test_every_stop_is_reached_in_its_own_direction(
    places: list[tuple[int, int]], overrun: float, modulo: bool
) -> None:
    """Walk the blocks as an axis would: at each stop the position is right and the last move went its way."""
    stops = [Stop(place * 5.0, approach) for place, approach in places]
    motion = Motion("C", modulo, 100.0, round(overrun, 3))
    position, last = 7.7, 0.0
    for stop, leg in zip(stops, motion.legs(stops), strict=True):
        for block in leg:
            moved = _travel(block, position)
            position += moved
            last = moved if abs(moved) > 1e-9 else last
        away = (position - stop.target) % 360.0 if modulo else position - stop.target
        assert min(away, 360.0 - away) == pytest.approx(0.0, abs=1e-6) if modulo else away == pytest.approx(0.0)
        assert last * stop.approach > 0


def _travel(block: str, position: float) -> float:
    word = block.split()[2].removeprefix("C=")
    found = re.fullmatch(r"(?:(DC|ACP|ACN|IC)\()?(-?[\d.]+)\)?", word)
    assert found is not None
    how, value = found[1], float(found[2])
    if how == "IC":
        return value
    if how is None:
        return value - position
    ahead = round((value - position) % 360.0, 9) % 360.0
    if how == "ACP" or ahead == 0.0:
        return ahead
    return ahead - 360.0 if how == "ACN" or ahead > 180.0 else ahead


def test_the_counter_is_written_last_and_every_wait_can_be_left() -> None:
    text = measuring_program.build_measuring_program(plan(rounds(1)), 1, SETTING)
    for block in text.split("G4 F1.0\n")[1:]:
        lines = block.splitlines()
        counted = lines.index("R80=R80+1")
        assert all(f"R8{n}=" in "\n".join(lines[:counted]) for n in range(1, 5))
        waiting = lines[lines.index("WHILE R85<>R80") : lines.index("ENDWHILE")]
        assert "IF R86<>0 GOTOF TF_LEFT" in waiting
        assert "IF UWAITED>57600 GOTOF TF_LEFT" in waiting


def test_tables_are_saved_before_the_first_move_and_the_set_up() -> None:
    text = measuring_program.build_measuring_program(plan(rounds(1)), 1, SETTING)
    saved, setup, moved = text.index('"M17"'), text.index("TRUEFLANK SETUP EXX ON X"), text.index("SUPA")
    assert saved < setup < moved
    assert "$MA_BACKLASH[0,X1]" in text
    assert "IF $AN_CEC_STEP[1]<>0" in text
    assert "$AN_CEC[0," not in text
    assert "SETUP" not in measuring_program.build_measuring_program(plan(rounds(1), setup=""), 1, SETTING)
    assert "WRITE" not in measuring_program.build_measuring_program(plan(rounds(1), save_tables=False), 1, SETTING)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"axis": 'X1"'}, "E-PROGRAM-NAME"),
        ({"letter": "X\nM30"}, "E-PROGRAM-NAME"),
        ({"setup": 'a")\nM30'}, "E-PROGRAM-MESSAGE"),
        ({"stops": (), "save_tables": False}, "E-PROGRAM-EMPTY"),
    ],
)
def test_nothing_can_break_out_of_a_block(change: dict[str, object], code: str) -> None:
    with pytest.raises(LocalProtocolError, match=code):
        measuring_program.build_measuring_program(replace(plan(rounds(1)), **change), 1, SETTING)


def texts_of(order: PushOrder, setting: MachineSetting = SETTING) -> list[str]:
    return [
        make([(order, setting)])
        for make in (
            pushing_program.build_push_program,
            pushing_program.build_loading_program,
            pushing_program.build_enabling_program,
        )
    ]


def test_push_programs_are_readable_and_never_write_the_memory_data() -> None:
    cross = replace(TABLE, kind="cross", index=1, input_axis="Z1", output_axis="X1")
    for order in (ORDER, replace(ORDER, enable=False), replace(ORDER, table=cross, purpose="sign-proof", proof=None)):
        for text in texts_of(order):
            parse(text)
            assert not re.search(r"^\$M[AN]_MM_\w+\[[^\]]*\]=", text, re.MULTILINE)


def test_order_of_the_first_half() -> None:
    text = pushing_program.build_push_program([(ORDER, SETTING)])
    marks = [
        'DELETE(UERR,"/_N_SPF_DIR/_N_TFBACK_X1_SPF")',
        "IF ABS($AA_IM[X1]-0.0)>0.001\nSUPA G1 X=0.0 F=500.0\nENDIF",
        "$MA_ENC_COMP_ENABLE[0,X1]=0\nNEWCONF",
        "IF $MA_ENC_COMP_ENABLE[0,X1]<>0 GOTOF TF_LEFT",
        "$AA_ENC_COMP_STEP[0,X1]=50.0",
        "$AA_ENC_COMP[0,1,X1]=-0.003000",
        "FOR UPOINT=3 TO 79\n$AA_ENC_COMP[0,UPOINT,X1]=0\nENDFOR",
        'DELETE(UERR,"/_N_SPF_DIR/_N_TFREAD_X1_SPF")',
        "IF R82==0 GOTOF TF_HELD",
        'MSG("TRUEFLANK LOADED X1(X1) WAITS FOR R89=4711")\nUWAITED=0\nWHILE R89<>4711',
        "IF R89<>4711 GOTOF TF_HELD",
        "$MA_ENC_COMP_ENABLE[0,X1]=1\nENDIF\nNEWCONF\nSTOPRE",
        'MSG("TRUEFLANK ACTIVATE NCK RESET AND REFERENCE X1")\nM0',
    ]
    places = [text.index(mark) for mark in marks]
    assert places == sorted(places)


def test_the_switch_goes_on_at_one_place_only_and_not_at_all_unless_ordered() -> None:
    assert pushing_program.build_push_program([(ORDER, SETTING)]).count("ENABLE[0,X1]=1") == 1
    assert pushing_program.build_loading_program([(ORDER, SETTING)]).count("ENABLE[0,X1]=1") == 0
    for text in texts_of(replace(ORDER, enable=False)):
        assert "ENABLE[0,X1]=1" not in text


def test_a_table_that_does_not_fit_or_has_no_proof_makes_no_program() -> None:
    with pytest.raises(TableError, match="E-TABLE-POINTS"):
        pushing_program.build_push_program([(ORDER, replace(SETTING, memory=ReservedPoints(2)))])
    with pytest.raises(TableError, match="E-TABLE-NO-PROOF"):
        pushing_program.build_push_program([(replace(ORDER, proof=None), SETTING)])
    bad = replace(TABLE, deviations=(0.0, float("nan"), 0.0))
    with pytest.raises(TableError, match="E-TABLE-FINITE"):
        pushing_program.build_push_program([(replace(ORDER, table=bad), SETTING)])
    exact = pushing_program.build_push_program([(ORDER, replace(SETTING, memory=ReservedPoints(3)))])
    assert "FOR UPOINT=3" not in exact


def test_new_tables_are_rounded_once_and_restored_ones_are_not() -> None:
    fine = replace(TABLE, deviations=(0.0, 1.23456789, 0.0))
    assert "$AA_ENC_COMP[0,1,X1]=0.001235\n" in pushing_program.build_push_program(
        [(replace(ORDER, table=fine), SETTING)]
    )
    restored = pushing_program.build_push_program(
        [(replace(ORDER, table=fine, purpose="restore", proof=None), SETTING)]
    )
    assert "$AA_ENC_COMP[0,1,X1]=0.0012345679\n" in restored
    assert "IF ABS($AA_ENC_COMP[0,1,X1]-0.0012345679)>0.000000001\n" in restored
