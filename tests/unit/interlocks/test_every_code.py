"""Every interlock code by itself, and a push that meets it: refused with not one write asked of the controller."""

from __future__ import annotations

import re
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import run_virtual
from drivers.errors import catalogue
from drivers.types.abilities import Marker, TableLimits
from drivers.types.doubts import Doubt
from drivers.types.machine import AxisState
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from drivers.types.tables import LiveSet, LiveTable, TemperatureShift, reversal_of
from drivers.types.uptime import Uptime
from gateway.domain.proposals import Approval, Chance, TableFinding
from gateway.interlocks import refusals
from gateway.interlocks.approval import people_needed, warnings
from gateway.interlocks.facts import PushFacts
from gateway.interlocks.measurement import allowed_drift_k
from gateway.push import controller_access
from gateway.push.context import plan_hash
from gateway.push.transaction import push_table
from tests.selftested import passed
from tests.steps import lines
from tests.unit.interlocks.asked import replace
from tests.unit.interlocks.test_interlocks import (
    CAPTURE,
    CHANGE,
    DEVIATIONS,
    GOOD,
    MACHINE,
    NEW,
    NOW,
    PROOF,
    RULES,
    STATE,
    axis,
    captured,
    new,
    shape,
)
from tests.unit.push.double import bench, change_of, journals_of

READS = {"identify", "state", "table_limits", "marker", "saved_tables"}
WIDE = TableFinding.older("W-COMP-BRIDGE [X1]: wide")
STEEP = replace(CHANGE, new=replace(NEW, deviations=shape(3, 30.0)))
PLAN = plan_hash(STEEP, MACHINE)
GIVEN = Approval(
    "second",
    PLAN,
    STEEP.base_digest,
    "SN-1",
    (NOW - timedelta(minutes=2)).isoformat(),
    (NOW + timedelta(minutes=8)).isoformat(),
)
TWO = replace(GOOD, change=STEEP, plan=PLAN, actor="first", approvals=(GIVEN,))

Z_STATE = AxisState("Z1", 0.0, True, True, 0.0, 0.0, "mm")
C_STATE = AxisState("C1", 0.0, True, True, 0.0, 0.0, "deg")
BOTH = replace(STATE, axes={**STATE.axes, "Z1": Z_STATE, "C1": C_STATE})
REVERSED = replace(
    GOOD, change=replace(CHANGE, new=reversal_of("X1", "mm", -2.4)), proof=replace(PROOF, kind="reversal")
)
WAVE = replace(NEW, kind="cross", input_axis="Z1", index=3)
CEC_PROOF = SignProof(MACHINE, "cross", "X1", 0.99, 0.02, -1, "2026-11-20T10:00:00+00:00")
HELD = replace(WAVE, index=5)
LIVE = LiveSet("X1", LiveTable(NEW, True), (), 0.0, "text", "digest")
CROSS = replace(
    GOOD,
    change=replace(CHANGE, new=WAVE, old=replace(WAVE, step=0.0, deviations=(0.0,)), old_enabled=False),
    state=BOTH,
    proof=CEC_PROOF,
    live=LIVE,
    limits=TableLimits(50, 1e-6, 0.2, 1.0),
)


def cross(**values: Any) -> PushFacts:
    return replace(CROSS, change=replace(CROSS.change, new=replace(WAVE, **values)))


def beside(*tables: LiveTable, others: tuple[LiveTable, ...] = ()) -> LiveSet:
    return replace(LIVE, cross=tables, others=others)


def z_axis(**values: Any) -> PushFacts:
    return replace(CROSS, state=replace(BOTH, axes={**BOTH.axes, "Z1": replace(Z_STATE, **values)}))


def approved(**values: Any) -> PushFacts:
    return replace(TWO, approvals=(replace(GIVEN, **values),))


def trial(**values: Any) -> PushFacts:
    return replace(GOOD, self_tests=True, self_test=replace(passed(MACHINE), **values))


def warmer(*, then: TemperatureShift | None, now: TemperatureShift | None) -> PushFacts:
    capture = replace(CAPTURE, live=replace(LIVE, temperature=then))
    return replace(GOOD, live=replace(LIVE, temperature=now), capture=capture)


def noisy(scatter: float) -> PushFacts:
    rng = np.random.default_rng(5)
    return captured(deviations=DEVIATIONS + rng.normal(0.0, scatter, DEVIATIONS.shape))


C_TABLE = replace(
    NEW, minimum=0.0, maximum=320.0, step=40.0, modulo=True, kind="cross", input_axis="C1", input_unit="deg", index=3
)
C_CHANGE = replace(CROSS.change, new=C_TABLE)
BIG = replace(HELD, deviations=tuple(value * 12.0 for value in WAVE.deviations))
TURNING = replace(HELD, input_axis="C1", input_unit="deg", minimum=-200.0, maximum=200.0)

MORE: list[tuple[str, PushFacts]] = [
    ("E-INT-INPUT", replace(CROSS, state=replace(BOTH, axes={"X1": BOTH.axes["X1"]}))),
    ("E-INT-REFERENCE", z_axis(referenced=False)),
    ("E-INT-MOVING", z_axis(in_position=False)),
    ("E-INT-UNIT", replace(GOOD, state=axis(unit="deg"))),
    ("E-INT-UNIT", z_axis(unit="deg")),
    ("E-INT-MARKER", replace(GOOD, marker=Marker(7, "in-progress"), marker_ours=False)),
    ("E-INT-MARKER", replace(GOOD, marker=Marker(7, "held"), marker_ours=False)),
    ("E-INT-KEY", replace(GOOD, key_taken="order-17")),
    ("E-INT-NO-BASE", replace(GOOD, change=replace(CHANGE, base_digest=""))),
    ("E-INT-BAD-PROOF", replace(GOOD, proof=replace(PROOF, slope=-1.3))),
    ("E-INT-BAD-PROOF", replace(GOOD, proof=replace(PROOF, slope_u=0.3))),
    ("E-INT-BAD-PROOF", replace(GOOD, proof=replace(PROOF, slope=-1.25, slope_u=0.12))),
    *[("E-INT-BAD-PROOF", replace(GOOD, proof=replace(PROOF, slope=-0.5, slope_u=u))) for u in (0.01, 0.12, 0.25)],
    *[("E-INT-BAD-PROOF", replace(GOOD, proof=replace(PROOF, slope=-2.0, slope_u=u))) for u in (0.01, 0.45, 0.5)],
    ("E-INT-SIGN", replace(GOOD, proof=replace(PROOF, slope=1.25, slope_u=0.16, sign=-1))),
    ("E-INT-BAD-PROOF", replace(GOOD, proof=replace(PROOF, slope=1.25, slope_u=0.16))),
    ("E-INT-BAD-PROOF", replace(CROSS, proof=replace(CEC_PROOF, sign=1))),
    ("E-INT-NO-PROOF", replace(CROSS, proof=PROOF)),
    ("E-INT-RESOLUTION", replace(GOOD, limits=TableLimits(100, 0.01, 1.0))),
    ("E-INT-RESOLUTION", replace(GOOD, limits=TableLimits(100, 0.0, 1.0))),
    ("E-INT-TURN", replace(CROSS, change=C_CHANGE)),
    ("E-INT-MODULO", cross(
        input_axis="C1", input_unit="deg", modulo=True, maximum=360.0, step=45.0, deviations=shape(8, 0.5)
    )),
    ("E-INT-VALUE", replace(CROSS, change=replace(
        CROSS.change, new=replace(WAVE, step=500.0, maximum=4000.0, deviations=shape(3, 201.0)),
        old=replace(WAVE, step=500.0, maximum=4000.0, deviations=shape(3, 150.0)), old_enabled=True,
    ), approvals_needed=1)),
    ("E-INT-CHANGE", replace(GOOD, approvals_needed=1, capture=None, change=replace(
        CHANGE, new=replace(NEW, step=500.0, maximum=4000.0, deviations=shape(3, 126.5))
    ))),
    ("E-INT-SLOPE", replace(GOOD, approvals_needed=1, change=replace(CHANGE, new=replace(
        NEW, deviations=shape(3, 65.0)
    )))),
    ("E-INT-COVERAGE", replace(new(minimum=-300.0, deviations=(0.0,) * 7 + NEW.deviations[1:]), approvals_needed=1)),
    ("E-INT-CROSS-POINTS", replace(CROSS, limits=TableLimits(8, 1e-6, 0.2, 1.0))),
    ("E-INT-CROSS-POINTS", replace(CROSS, limits=TableLimits(0, 1e-6, 0.2, 1.0))),
    ("E-INT-TYPE", cross(table_type=1)),
    ("E-INT-KIND", REVERSED),
    ("E-INT-DIRECTION", cross(direction=2)),
    ("E-INT-SELF", cross(input_axis="X1")),
    ("E-INT-INDEX", replace(CROSS, live=beside(LiveTable(replace(WAVE, input_axis="C1"), True)))),
    ("E-INT-INDEX", replace(CROSS, live=beside(LiveTable(replace(WAVE, direction=1), False)))),
    ("E-INT-INDEX", replace(CROSS, live=beside(others=(LiveTable(replace(WAVE, output_axis="Y1"), False),)))),
    ("E-INT-FACTOR", cross(multiply_by=9)),
    ("E-INT-SUM", replace(CROSS, limits=TableLimits(50, 1e-6, 0.2, 0.012))),
    ("E-INT-SUM", replace(CROSS, live=beside(LiveTable(BIG, True)))),
    ("E-INT-OTHERS", replace(
        CROSS, live=beside(LiveTable(TURNING, True)),
        state=replace(BOTH, axes={**BOTH.axes, "C1": replace(C_STATE, position=-100.0)}),
    )),
    ("E-INT-REPEAT", noisy(2.8)),
    ("E-INT-DOUBT", replace(GOOD, capture=replace(CAPTURE, doubts=(Doubt("S-EVAL-STEPS", blocking=True),)))),
    ("E-INT-GAIN", replace(GOOD, change=replace(CHANGE, predicted=0.6 * np.array(NEW.deviations)))),
    ("E-INT-APPROVAL-MISSING", replace(TWO, approvals=())),
    ("E-INT-APPROVAL-MISSING", replace(GOOD, approvals_needed=2)),
    ("E-INT-RISK", replace(GOOD, approvals_needed=1, unprotected="plain")),
    ("E-INT-APPROVAL-EXPIRED", approved(expires_utc=NOW.isoformat())),
    ("E-INT-APPROVAL-EXPIRED", approved(given_utc=(NOW + timedelta(hours=1)).isoformat())),
    ("E-INT-APPROVAL-EXPIRED", approved(expires_utc="soon")),
    ("E-INT-APPROVAL-SAME-PERSON", approved(actor="first")),
    ("E-INT-APPROVAL-OWN-ACCOUNT", approved(kept_by=("other", "FIRST"))),
    ("E-INT-APPROVAL-OTHER-PLAN", approved(plan_hash="0" * 64)),
    ("E-INT-APPROVAL-OTHER-PLAN", approved(base_digest="other")),
    ("E-INT-APPROVAL-OTHER-PLAN", approved(serial="SN-2")),
    ("E-INT-APPROVAL-TOO-LONG", approved(expires_utc=(NOW + timedelta(days=3650)).isoformat())),
    ("E-INT-APPROVAL-TOO-LONG", approved(expires_utc=(NOW + timedelta(minutes=8, seconds=1)).isoformat())),
    ("E-INT-APPROVAL-EXPIRED", approved(
        given_utc=(NOW + timedelta(minutes=1)).isoformat(), expires_utc=(NOW + timedelta(minutes=9)).isoformat()
    )),
    ("E-INT-APPROVAL-EXPIRED", replace(TWO, consent_utc=NOW + timedelta(minutes=8))),
    ("E-INT-APPROVAL-EXPIRED", replace(approved(given_at=Uptime("a", 10.0)), uptime=Uptime("a", 610.0))),
    ("E-INT-APPROVAL-EXPIRED", replace(approved(given_at=Uptime("a", 10.0)), uptime=Uptime("a", 9.0))),
    ("E-INT-APPROVAL-EXPIRED", replace(
        approved(given_at=Uptime("a", 10.0)), consent_utc=NOW, consent_uptime=Uptime("a", 611.0)
    )),
    ("E-INT-APPROVAL-CLOCK", replace(TWO, overtaken_approvals=(GIVEN,))),
    ("E-INT-APPROVAL-OTHER-RUN", approved(run_id="20261121T100000000Z-mill-0000")),
    ("E-INT-APPROVAL-USED", replace(TWO, used_approvals=(GIVEN,))),
    ("E-INT-APPROVAL-UNRECORDED", replace(TWO, unrecorded_approvals=(GIVEN,))),
    ("E-INT-APPROVAL-UNSIGNED", replace(TWO, unsigned_approvals=(GIVEN,))),
    ("E-INT-AUDIT-BROKEN", replace(GOOD, audit_broken="entry 7 was altered")),
    ("E-INT-AUDIT-BEHIND", replace(GOOD, behind="no line has it")),
    ("E-INT-AUDIT-BEHIND", replace(GOOD, behind="no line has it", purpose="sign-proof")),
    ("E-INT-JOURNAL-MISSING", replace(GOOD, missing=(432_100_007,))),
    ("E-INT-NOT-PROPOSED", replace(GOOD, is_proposed=False)),
    ("E-INT-TEMPERATURE-MOVED", warmer(then=TemperatureShift(0.005), now=TemperatureShift())),
    ("E-INT-TEMPERATURE-MOVED", warmer(then=TemperatureShift(0.0, 1e-6), now=TemperatureShift(0.0, 2e-6, 10.0))),
    ("E-INT-NO-SELF-TEST", replace(GOOD, self_tests=True)),
    ("E-INT-NO-SELF-TEST", replace(GOOD, self_tests=True, purpose="sign-proof")),
    ("E-INT-OTHER-SELF-TEST", trial(machine=replace(MACHINE, version="V4.7"))),
    ("E-INT-SELF-TEST", trial(failed=("READ",))),
    ("E-INT-SELF-TEST", trial(stopped="alarm 17070")),
    ("E-INT-SELF-TEST", trial(passed=())),
]  # fmt: skip
C_EEC = replace(
    NEW, input_axis="C1", output_axis="C1", input_unit="deg", output_unit="deg", minimum=0.0, maximum=360.0, step=45.0
)
C_CROSS = replace(C_EEC, kind="cross", index=3)
MORE.append((
    "E-INT-BOTH-LAYERS",
    replace(
        CROSS, change=replace(CROSS.change, axis="C1", new=C_CROSS), proof=replace(CEC_PROOF, output_axis="C1"),
        live=LiveSet("C1", LiveTable(C_EEC, True), (), 0.0, "", ""), capture=None,
    ),
))  # fmt: skip
JUMP = ("E-INT-JUMP", replace(GOOD, moment="release", state=axis(position=150.0)))
CROSS_JUMP = ("E-INT-JUMP", replace(z_axis(position=150.0), moment="release"))
ALL = [*RULES, *MORE]
NAMES = [f"{number}-{code}" for number, (code, _facts) in enumerate(ALL)]


def codes(facts: PushFacts) -> set[str]:
    return {refusal.code for refusal in refusals(facts)}


@pytest.mark.parametrize(("code", "facts"), [*MORE, JUMP, CROSS_JUMP], ids=lambda one: one if type(one) is str else "")
def test_each_rule_alone(code: str, facts: PushFacts) -> None:
    assert codes(facts) == {code}
    (refusal,) = refusals(facts)
    assert "<" not in refusal.words
    assert catalogue()[code]["do"]


def test_sound_cross_and_two_person_pushes_have_no_reason_against_them() -> None:
    assert codes(CROSS) == set()
    assert codes(TWO) == set()
    assert codes(trial()) == set()
    assert codes(replace(GOOD, proof=replace(PROOF, slope=-1.25, slope_u=0.16))) == set()  # as it agrees with 1 by U
    still = TemperatureShift(0.003, 1e-5, 20.0)
    assert codes(warmer(then=still, now=replace(still, constant=0.00305))) == set()
    assert codes(warmer(then=None, now=still)) == set()  # what was never read cannot be compared
    assert codes(replace(GOOD, self_tests=True, purpose="restore")) == set()  # the way back is always open
    assert (
        codes(replace(CROSS, live=beside(LiveTable(WAVE, True), LiveTable(replace(HELD, direction=1), False)))) == set()
    )
    assert codes(cross(multiply_by=4)) == set()  # by itself: t x t


@pytest.mark.parametrize(("code", "facts"), ALL, ids=NAMES)
def test_a_push_that_meets_it_asks_the_controller_for_no_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, facts: PushFacts
) -> None:
    async def met(*_args: Any, **_more: Any) -> PushFacts:
        return facts

    monkeypatch.setattr(controller_access, "read_facts", met)
    at = bench(tmp_path, by_hand=True)
    before = at.machine.live()
    record = run_virtual(lambda: push_table(change_of(at.machine), at.context))
    if code == "E-INT-NOTHING":
        assert record.outcome != "refused"
        return
    assert record.outcome == "refused"
    assert [step.split(":")[0] for step in lines(record)] == [refusal.code for refusal in refusals(facts)]
    assert set(at.controller.calls) <= READS
    assert (at.machine.live(), at.machine.writes, at.machine.jumps) == (before, [], [])
    assert journals_of(tmp_path) == ()


def test_no_code_of_the_interlocks_is_left_out() -> None:
    room = Path(__file__).parents[3] / "gateway" / "interlocks"
    used = {code for path in room.glob("*.py") for code in re.findall(r'"(E-INT-[A-Z-]+)"', path.read_text())}
    shown = {code for code, _facts in [*ALL, JUMP]}
    assert used == shown
    assert len(used) >= 60


def test_a_second_person_counts_and_one_is_enough_without_a_warning() -> None:
    assert (people_needed(GOOD), people_needed(TWO)) == (1, 2)
    assert {warning.code for warning in warnings(TWO)} == {"W-INT-SLOPE"}
    third = replace(GIVEN, actor="third", plan_hash="0")
    assert codes(replace(TWO, approvals=(third, GIVEN))) == set()
    assert codes(replace(TWO, approvals_needed=3)) == {"E-INT-APPROVAL-MISSING"}
    assert codes(replace(TWO, approvals_needed=3, approvals=(GIVEN, replace(third, plan_hash=PLAN)))) == set()


def test_on_an_open_road_one_person_alone_types_the_risk_where_the_site_lets_one_push() -> None:
    """A second person, or by the site's own key one; who is alone takes the risk word for word."""
    plain = replace(GOOD, unprotected="plain", approvals=())
    assert codes(plain) == codes(replace(plain, risk_taken=True)) == {"E-INT-APPROVAL-MISSING"}
    alone = replace(plain, approvals_needed=1)
    assert codes(alone) == {"E-INT-RISK"}
    assert codes(replace(alone, risk_taken=True)) == set()
    second = replace(TWO, unprotected="plain", approvals_needed=1)
    assert codes(second) == set()
    assert codes(replace(second, approvals=(replace(GIVEN, plan_hash="0"),))) == {"E-INT-RISK"}
    assert codes(replace(alone, purpose="restore")) == set()


@pytest.mark.parametrize(
    ("code", "facts"),
    [
        ("W-INT-SLOPE", TWO),
        ("W-INT-CHANGE", replace(GOOD, change=replace(CHANGE, new=replace(NEW, step=500.0, maximum=4000.0,
                                                                         deviations=shape(3, 60.0))))),
        ("W-INT-AGE", captured(ended_utc=(NOW - timedelta(hours=5)).isoformat())),
        ("W-INT-FINDING", replace(GOOD, change=replace(CHANGE, findings=(WIDE,)))),
        ("W-INT-NO-MARKER", replace(GOOD, marker_kept=False)),
        ("W-INT-UNPROTECTED", replace(GOOD, unprotected="plain")),
        ("W-INT-MARK-LOST", replace(GOOD, mark_lost=7)),
        ("W-INT-STRANGER", replace(GOOD, marker=Marker(7, "committed"), stranger=7)),
        ("W-INT-ALARM", replace(GOOD, alarms=("X1: switched off",))),
        ("W-INT-COVERAGE", new(minimum=-50.0, maximum=450.0, deviations=(0.0, *NEW.deviations, 0.0))),
    ],
)  # fmt: skip
def test_each_warning_asks_for_a_second_person(code: str, facts: PushFacts) -> None:
    facts = replace(
        facts, approvals=(), capture=facts.request.capture if code in ("W-INT-AGE", "W-INT-COVERAGE") else None
    )
    if code == "W-INT-COVERAGE":
        targets = np.linspace(5.0, 395.0, 9)
        facts = replace(facts, capture=replace(CAPTURE, targets=targets))
    assert {warning.code for warning in warnings(facts)} == {code}
    assert people_needed(facts) == 2
    assert warnings(facts)[0].words.startswith(code)
    assert codes(facts) == {"E-INT-APPROVAL-MISSING"}


def test_a_small_gain_is_written_only_where_its_chances_speak_for_it() -> None:
    little = replace(CHANGE, predicted=0.6 * np.array(NEW.deviations))
    for chance, met in ((Chance(2.0, 0.2, 0.01), False), (Chance(0.1, 0.2, 0.01), True), (Chance(2.0, 0.2, 0.1), True)):
        assert ("E-INT-GAIN" in codes(replace(GOOD, change=replace(little, chance=chance)))) == met


def test_warmth_is_judged_by_what_is_read_now() -> None:
    assert codes(replace(GOOD, ambient_now=None)) == set()
    assert codes(replace(GOOD, ambient_now=Ambient(material_degc=(23.1,)))) == {"E-INT-WARMTH"}


def test_degrees_count_by_what_they_spoil_of_the_table() -> None:
    def allowed(scale: float, **values: object) -> float:
        table = replace(NEW, deviations=tuple(scale * one for one in NEW.deviations), **values)
        return allowed_drift_k(replace(CHANGE, new=table, old_enabled=False))

    assert allowed(0.1) == allowed(0.0) == 2.0
    assert allowed(2.0) == pytest.approx(0.25 * 31.0 / (3.5e-3 * 400.0))
    assert allowed(2.0, maximum=800.0, step=100.0) == pytest.approx(allowed(2.0) / 2.0)
    assert allowed(50.0) == 8.0
    assert allowed(0.1, output_unit="deg") == 8.0
    assert allowed(2.0, kind="cross", index=1) == 4.0
    assert allowed(2.0, kind="cross", index=1, output_unit="deg") == 8.0


def test_the_plan_hash_is_of_what_is_written_and_nothing_else() -> None:
    assert plan_hash(CHANGE, MACHINE) == plan_hash(replace(CHANGE, findings=(WIDE,), predicted=np.ones(9)), MACHINE)
    others = [
        plan_hash(replace(CHANGE, new=replace(NEW, deviations=shape(3, 15.500001))), MACHINE),
        plan_hash(replace(CHANGE, new=replace(NEW, index=1)), MACHINE),
        plan_hash(replace(CHANGE, base_digest="x"), MACHINE),
        plan_hash(CHANGE, replace(MACHINE, serial="SN-2")),
        plan_hash(CHANGE, replace(MACHINE, version="V4.9")),
    ]
    assert len({plan_hash(CHANGE, MACHINE), *others}) == 6
    assert re.fullmatch(r"[0-9a-f]{64}", others[0])
