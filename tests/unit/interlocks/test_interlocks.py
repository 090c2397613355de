"""Each reason not to write, alone and all together; a sound push has none."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import catalogue
from drivers.message import Message
from drivers.types.abilities import TableLimits
from drivers.types.identity import MachineIdentity
from drivers.types.machine import AxisState, ChannelStatus, MachineState
from drivers.types.moves import SafePlaces
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.axes import AxisRecord
from gateway.domain.captures import Capture, Corrections
from gateway.domain.equipment import SenseProof
from gateway.domain.proposals import TableChange, TableFinding
from gateway.interlocks import PushFacts, refusals, value_at
from gateway.store.records import read_typed, write_typed
from tests.placed import PLACES
from tests.unit.interlocks.asked import CAN, Asked, replace

NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)
MACHINE = MachineIdentity("SN-1", "V4.8", ("X1", "C1"))
PROOF = SignProof(MACHINE, "axis", "X1", -1.0, 0.02, 1, "2026-11-20T10:00:00+00:00")
TARGETS = np.linspace(0.0, 400.0, 9)
OLD = CompensationTable("axis", "X1", "X1", 0.0, 400.0, 50.0, (0.0, 2.0, 4.0, 6.0, 4.0, 2.0, 0.0, -2.0, 0.0))
NEW = replace(OLD, deviations=(0.0, 5.0, 12.0, 15.5, 9.0, 4.0, -3.0, -6.0, 0.0))
LIVE = LiveSet("X1", LiveTable(OLD, True), (), 0.0, "text", "digest")
STATE = MachineState(ChannelStatus.RESET, "AUTO", "", (), 2, {"X1": AxisState("X1", 0.0, True, True, 0.0, 0.0, "mm")})
DEVIATIONS = np.repeat(np.repeat(np.array(NEW.deviations)[:, None, None], 5, axis=1), 2, axis=2) + 0.5
CAPTURE = Capture(
    "X1", "EXX", "mm", TARGETS, DEVIATIONS, 0.05, Ambient(20.0, material_degc=(20.0,)),
    Ambient(20.5, material_degc=(20.4, 20.6)), Corrections(Message.stored("edlen"), Message.stored("to 20")), LIVE,
    SenseProof("laser", "X1", 1, 1.0, (10.0,)), ended_utc=(NOW - timedelta(hours=1)).isoformat(),
)  # fmt: skip
AXIS = AxisRecord("X1", "X", "mm", False, False, (0.0, 400.0), 0.0, 2000.0)
CHANGE = TableChange("X1", OLD, NEW, True, "digest", TARGETS, np.full(9, 0.1), np.full(9, 0.5))
GOOD = PushFacts(
    CHANGE, "table", "start",
    Asked(MACHINE, AXIS, proof=PROOF, capture=CAPTURE, ambient_now=Ambient(20.0, material_degc=(20.0,))),
    CAN, MACHINE, STATE, TableLimits(100, 1e-6, 1.0), 0.0, NOW, True, places=PLACES,
)  # fmt: skip


def codes(facts: PushFacts) -> set[str]:
    return {refusal.code for refusal in refusals(facts)}


def axis(**values: Any) -> MachineState:
    return replace(STATE, axes={"X1": replace(STATE.axes["X1"], **values)})


def new(**values: Any) -> PushFacts:
    return replace(GOOD, change=replace(CHANGE, new=replace(NEW, **values)))


def shape(place: int, value: float) -> tuple[float, ...]:
    values = list(NEW.deviations)
    values[place] = value
    return tuple(values)


def captured(**values: Any) -> PushFacts:
    return replace(GOOD, capture=replace(CAPTURE, **values))


def missing(places: list[tuple[int, int, int]]) -> np.ndarray[Any, Any]:
    deviations = DEVIATIONS.copy()
    for place in places:
        deviations[place] = np.nan
    return deviations


def other(**values: Any) -> MachineIdentity:
    return replace(MACHINE, **values)


WIDE = CompensationTable("axis", "X1", "X1", -300.0, 400.0, 50.0, (0.0,) * 7 + NEW.deviations[1:])
C_AXIS = replace(NEW, output_unit="deg", input_unit="deg")
MODULO = CompensationTable(
    "axis", "X1", "X1", 0.0, 360.0, 45.0, (*NEW.deviations[:-1], 0.9), True, input_unit="deg", output_unit="deg"
)
SUSPECTS = (*((target, 0, 0) for target in range(9)), (0, 1, 0), (1, 1, 0))

RULES: list[tuple[str, PushFacts]] = [
    ("E-INT-MACHINE", replace(GOOD, found=other(serial="SN-2"), proof=replace(PROOF, machine=other(serial="SN-2")))),
    ("E-INT-MACHINE", replace(GOOD, expected=other(version="V4.7"))),
    ("E-INT-MACHINE", replace(GOOD, expected=other(axis_names=("C1", "X1")))),
    (
        "E-INT-INCH",
        replace(
            GOOD, found=other(unit_system="inch"), expected=other(unit_system="inch"),
            proof=replace(PROOF, machine=other(unit_system="inch")),
        ),
    ),
    ("E-INT-CHANNEL", replace(GOOD, state=replace(STATE, channel=ChannelStatus.ACTIVE))),
    ("E-INT-CHANNEL", replace(GOOD, state=replace(STATE, channel=ChannelStatus.INTERRUPTED))),
    ("E-INT-MODE", replace(GOOD, state=replace(STATE, mode="JOG"))),
    ("E-INT-ALARM", replace(GOOD, state=replace(STATE, alarms=(4075,)))),
    ("E-INT-AXIS", replace(GOOD, state=replace(STATE, axes={}))),
    ("E-INT-REFERENCE", replace(GOOD, state=axis(referenced=False))),
    ("E-INT-MOVING", replace(GOOD, state=axis(in_position=False))),
    ("E-INT-ACCESS", replace(GOOD, state=replace(STATE, access_level=4), access_level_needed=3)),
    ("E-INT-NO-PLACE", replace(GOOD, places=SafePlaces())),
    ("E-INT-OUTSIDE", replace(GOOD, places=SafePlaces({"X1": (5.0, 400.0)}))),
    ("E-INT-NAME", replace(GOOD, typed_name="")),
    ("E-INT-NAME", replace(GOOD, typed_name="Mill")),
    ("E-INT-UNFINISHED", replace(GOOD, unfinished=("tx-000001.jnl",))),
    ("E-INT-SKIPPED", replace(GOOD, change=replace(CHANGE, skipped=Message.stored("inside U")))),
    ("E-INT-NOTHING", replace(GOOD, change=replace(CHANGE, old=NEW))),
    ("E-INT-LOST-UPDATE", replace(GOOD, unchanged=False)),
    ("E-INT-NO-PROOF", replace(GOOD, proof=None)),
    ("E-INT-NO-PROOF", replace(GOOD, proof=replace(PROOF, output_axis="Z1"))),
    ("E-INT-NO-PROOF", replace(GOOD, proof=replace(PROOF, kind="cross"))),
    ("E-INT-OTHER-PROOF", replace(GOOD, proof=replace(PROOF, machine=other(version="V4.7")))),
    ("E-INT-SIGN", replace(GOOD, proof=replace(PROOF, sign=-1, slope=1.0))),
    ("E-INT-OTHER-AXIS", replace(new(output_axis="Z1"), proof=replace(PROOF, output_axis="Z1"))),
    ("E-INT-POINTS", replace(GOOD, limits=TableLimits(8, 1e-6, 1.0))),
    ("E-INT-GRID", new(step=49.0)),
    ("E-INT-GRID", new(maximum=float("nan"))),
    ("E-INT-FINDING", replace(GOOD, change=replace(CHANGE, findings=(TableFinding.older("odd"),)))),
    ("E-INT-FINITE", new(deviations=shape(3, float("nan")))),
    ("E-INT-FINITE", new(deviations=shape(3, float("-inf")))),
    ("E-INT-REF-VALUE", replace(GOOD, reference=50.0)),
    ("E-INT-REF-VALUE", replace(GOOD, reference=375.0)),
    ("E-INT-NOWHERE", replace(GOOD, agreeing_position=None)),
    ("E-INT-DATE", captured(ended_utc="")),
    ("E-INT-DATE", captured(ended_utc="yesterday")),
    ("E-INT-DATE", captured(ended_utc="2026-11-21T11:00:00")),
    ("E-INT-AGE", captured(ended_utc=(NOW - timedelta(hours=25)).isoformat())),
    ("E-INT-AGE", captured(ended_utc=(NOW + timedelta(minutes=3)).isoformat())),
    ("E-INT-WARMTH", replace(GOOD, ambient_now=Ambient(material_degc=(22.6,)))),
    ("E-INT-WARMTH", replace(GOOD, ambient_now=Ambient(air_degc=18.0))),
    ("E-INT-INCOMPLETE", captured(deviations=missing([(4, 0, 0), (4, 1, 0), (4, 2, 0)]))),
    ("E-INT-INCOMPLETE", captured(suspects=((4, 0, 1), (4, 1, 1), (4, 3, 1)))),
    ("E-INT-SUSPECTS", captured(suspects=SUSPECTS)),
    ("E-INT-MEASURED", captured(axis="Z1")),
    ("E-INT-MEASURED", captured(axis_unit="deg")),
    ("E-INT-SENSE", captured(sense=None)),
    ("E-INT-GAIN", replace(GOOD, change=replace(CHANGE, predicted=-2.0 * np.array(NEW.deviations)))),
]  # fmt: skip


def test_a_sound_push_has_no_reason_against_it() -> None:
    assert refusals(GOOD) == ()


@pytest.mark.parametrize(("code", "facts"), RULES, ids=[f"{n}-{code}" for n, (code, _f) in enumerate(RULES)])
def test_each_rule_alone(code: str, facts: PushFacts) -> None:
    assert codes(facts) == {code}


@pytest.mark.parametrize(
    ("code", "facts"),
    [
        ("E-INT-VALUE", new(deviations=shape(3, 200.5))),
        ("E-INT-SLOPE", new(deviations=shape(3, 65.0))),
        ("E-INT-CHANGE", new(deviations=shape(3, 126.5))),
        ("E-INT-COVERAGE", new(minimum=-300.0, maximum=400.0, deviations=WIDE.deviations)),
        ("E-INT-MODULO", replace(GOOD, change=replace(CHANGE, new=MODULO))),
    ],
)
def test_limits(code: str, facts: PushFacts) -> None:
    assert code in codes(facts)


@pytest.mark.parametrize(
    ("unit", "value", "refused"),
    [("mm", 200.0, False), ("mm", 200.01, True), ("deg", 180.0, False), ("deg", 180.01, True)],
)
def test_a_value_at_its_limit_passes(unit: Any, value: float, refused: bool) -> None:
    table = replace(NEW, deviations=shape(3, value), output_unit=unit)
    assert ("E-INT-VALUE" in codes(replace(GOOD, change=replace(CHANGE, new=table)))) is refused


@pytest.mark.parametrize("channel", list(ChannelStatus))
def test_between_the_halves_the_program_waits_or_has_ended(channel: ChannelStatus) -> None:
    assert codes(replace(GOOD, moment="release", state=replace(STATE, channel=channel))) == set()


def test_warnings_of_a_proposal_are_no_reason() -> None:
    change = replace(CHANGE, findings=tuple(map(TableFinding.older, ("W-COMP-STEEP [X1]: steep", "E-COMP-ODD: odd"))))
    (refusal,) = refusals(replace(GOOD, change=change))
    assert str(refusal.fields["finding"]) == "E-COMP-ODD: odd"


def test_a_table_that_was_off_counts_as_zero_for_the_change() -> None:
    big = replace(NEW, deviations=tuple(value * 7.0 for value in NEW.deviations))
    near = replace(big, deviations=tuple(value + 1.0 for value in big.deviations))
    on = replace(GOOD, change=replace(CHANGE, old=near, new=replace(big, deviations=(0.0, *big.deviations[1:]))))
    assert "E-INT-CHANGE" not in codes(on)
    far = replace(on.change, new=replace(NEW, deviations=shape(3, 121.0)), old_enabled=False)
    assert "E-INT-CHANGE" in codes(replace(on, change=far))


def test_harmless_alarms_and_other_modes_can_be_allowed() -> None:
    state = replace(STATE, mode="JOG", alarms=(700010,))
    assert codes(replace(GOOD, state=state)) == {"E-INT-MODE", "E-INT-ALARM"}
    assert codes(replace(GOOD, state=state, modes=("AUTO", "JOG"), harmless_alarms=(700010,))) == set()


@pytest.mark.parametrize(("position", "refused"), [(0.0, False), (9.9, False), (10.1, True), (150.0, True)])
def test_the_jump_is_judged_where_the_axis_stands(position: float, refused: bool) -> None:
    state = replace(axis(position=position), channel=ChannelStatus.INTERRUPTED)
    facts = replace(GOOD, moment="release", state=state)
    assert codes(facts) == ({"E-INT-JUMP"} if refused else set())


def test_a_restore_is_not_judged_by_the_limits_of_new_tables() -> None:
    wild = replace(NEW, deviations=shape(3, 900.0))
    change = replace(CHANGE, new=wild)
    facts = replace(GOOD, purpose="restore", change=change, proof=None, unfinished=("tx",), capture=None)
    assert codes(facts) == set()
    assert codes(replace(facts, typed_name="")) == {"E-INT-NAME"}
    assert codes(replace(facts, found=other(serial="?"))) == {"E-INT-MACHINE"}


def test_a_sign_proof_needs_no_proof() -> None:
    assert codes(replace(GOOD, purpose="sign-proof", proof=None, capture=None)) == set()


def test_a_file_has_no_date_and_no_sense_of_its_own() -> None:
    assert codes(captured(source="x.rtl", ended_utc="", sense=None)) == set()


def test_a_modulo_axis_is_covered_all_round() -> None:
    table = CompensationTable(
        "axis", "C1", "C1", 0.0, 360.0, 5.0, (0.0,) * 73, True, input_unit="deg", output_unit="deg"
    )
    change = replace(CHANGE, axis="C1", new=table, old=replace(table, deviations=(0.0, 1.0) + (0.0,) * 71))
    targets = np.arange(24) * 15.0
    capture = replace(CAPTURE, axis="C1", axis_unit="deg", targets=targets, deviations=np.ones((24, 5, 2)))
    state = replace(STATE, axes={"C1": replace(STATE.axes["X1"], name="C1", unit="deg")})
    facts = replace(
        GOOD, change=replace(change, predicted=np.zeros(24)), capture=capture, state=state,
        proof=replace(PROOF, output_axis="C1"),
    )  # fmt: skip
    assert codes(facts) == set()
    half = replace(capture, targets=targets[:12], deviations=np.ones((12, 5, 2)))
    assert "E-INT-COVERAGE" in codes(replace(facts, capture=half))


def test_all_at_once() -> None:
    facts = replace(
        GOOD, typed_name="x", found=other(serial="?"), state=replace(axis(referenced=False), alarms=(1,), mode="MDA"),
        limits=TableLimits(1, 1e-6, 1.0), unfinished=("tx",), unchanged=False,
    )  # fmt: skip
    wanted = "NAME MACHINE REFERENCE ALARM MODE POINTS UNFINISHED LOST-UPDATE OTHER-PROOF"
    assert codes(facts) == {f"E-INT-{word}" for word in wanted.split()}


def test_every_refusal_has_its_words() -> None:
    for _code, facts in RULES:
        for refusal in refusals(facts):
            assert refusal.code in catalogue()
            assert "<" not in refusal.words
            assert catalogue()[refusal.code]["do"]


numbers = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=120, deadline=None, derandomize=True)
@given(
    st.lists(numbers, max_size=12).map(tuple), numbers, numbers, numbers, st.booleans(), st.sampled_from(["mm", "deg"])
)
def test_any_table_gives_reasons_never_a_crash(
    deviations: tuple[float, ...], minimum: float, maximum: float, step: float, modulo: bool, unit: Any
) -> None:
    table = CompensationTable(
        "axis", "X1", "X1", minimum, maximum, step, deviations, modulo, input_unit=unit, output_unit=unit
    )
    with np.errstate(all="ignore"):
        found = refusals(replace(GOOD, change=replace(CHANGE, new=table)))
        if not found:
            values = np.array(deviations)
            assert np.all(np.isfinite(values))
            assert abs(value_at(table, 0.0)) <= 0.1 + 1e-6
            assert np.max(np.abs(values)) <= 200.0 + 1e-6


def test_a_reading_out_of_line_that_no_table_was_fitted_to_is_no_scatter() -> None:
    """A file brings its outliers with it, and nothing can be taken again."""
    deviations = DEVIATIONS.copy()
    far = (2, 1, 0)
    deviations[far] += 40.0
    assert "E-INT-REPEAT" in codes(captured(deviations=deviations))
    assert "E-INT-REPEAT" not in codes(captured(deviations=deviations, suspects=(far,)))


def test_a_finding_of_an_older_record_weighs_as_it_did() -> None:
    """A record of an older version held a sentence behind its code; E refused, W asked, two were judged by a limit."""
    sentences = ("E-COMP-ODD: odd", "odd", "W-COMP-BRIDGE [X1]: wide", "W-COMP-STEEP [X1]: steep", "W-COMP-FLAT: flat")
    weights = [TableFinding.older(one).weight.value for one in sentences]
    assert weights == ["refuses", "refuses", "asks", "judged", "judged"]
    kept = write_typed(replace(CHANGE, findings=()), TableChange, "")
    assert isinstance(kept, dict)
    read = read_typed({**kept, "findings": list(sentences)}, TableChange, "", "here")
    assert [str(one.message) for one in read.findings] == list(sentences)
