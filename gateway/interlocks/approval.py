"""Who must agree: one person, a second one when anything warns; and the audit chain must be whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime

from drivers.errors import words
from drivers.local.names import person_key
from gateway.domain.proposals import Approval, FindingWeight
from gateway.interlocks.facts import (
    APPROVED_AHEAD,
    APPROVED_FOR,
    MAX_AGE,
    ROUNDING,
    WARN_AGE,
    PushFacts,
    Refusal,
    Rule,
    refuse,
)
from gateway.interlocks.measurement import unmeasured_range
from gateway.interlocks.table import largest_change, steepest


def warnings(facts: PushFacts) -> tuple[Refusal, ...]:
    """Everything that does not forbid the push but asks for a second pair of eyes; what forbids it is no warning."""
    return tuple(warning for rule in _WARNING for warning in rule(facts))


def people_needed(facts: PushFacts) -> int:
    """How many people must agree, the one who pushes among them."""
    if facts.request.approvals_needed is not None:
        return facts.request.approvals_needed
    return 2 if warnings(facts) else 1


def _steep(facts: PushFacts) -> Iterator[Refusal]:
    slope, limit = steepest(facts.table), facts.bounds.warn_slope
    if limit + ROUNDING < slope <= facts.bounds.slope + ROUNDING:
        fields = {"slope": round(slope, 4), "limit": limit, "per": facts.table.input_unit}
        yield from refuse("W-INT-SLOPE", table=facts.table.called, unit=facts.table.deviation_unit, **fields)


def _far(facts: PushFacts) -> Iterator[Refusal]:
    change, limit = largest_change(facts.change), facts.bounds.warn_change
    if limit + ROUNDING < change <= facts.bounds.change + ROUNDING:
        fields = {"change": round(change, 3), "limit": limit}
        yield from refuse("W-INT-CHANGE", table=facts.table.called, unit=facts.table.deviation_unit, **fields)


def _old(facts: PushFacts) -> Iterator[Refusal]:
    capture = facts.request.capture
    if capture is None or not capture.ended_utc:
        return
    try:
        age = facts.now_utc - datetime.fromisoformat(capture.ended_utc)
    except (ValueError, TypeError):
        return
    if WARN_AGE < age <= MAX_AGE:
        hours, limit = round(age.total_seconds() / 3600.0, 1), WARN_AGE.total_seconds() / 3600.0
        yield from refuse("W-INT-AGE", axis=capture.axis, hours=hours, limit=limit)


def _doubtful_findings(facts: PushFacts) -> Iterator[Refusal]:
    """What the proposal itself found doubtful, but for what is judged here by its own limit."""
    for finding in facts.change.findings:
        if finding.weight is FindingWeight.ASKS:
            yield from refuse("W-INT-FINDING", table=facts.table.called, finding=finding.message)


def _extrapolation(facts: PushFacts) -> Iterator[Refusal]:
    beyond, widest = unmeasured_range(facts) if facts.table.kind == "axis" else (0.0, 0.0)
    if ROUNDING < beyond <= 0.5 * widest + ROUNDING:
        yield from refuse("W-INT-COVERAGE", table=facts.table.called, beyond=round(beyond + widest, 3), interval=widest)


def _no_marker(facts: PushFacts) -> Iterator[Refusal]:
    if not facts.can.marker:
        yield from refuse("W-INT-NO-MARKER", axis=facts.change.axis)


def _marker_doubts(facts: PushFacts) -> Iterator[Refusal]:
    """A control that lost its memory, or one that another gateway has pushed to since."""
    if facts.mark.lost:
        yield from refuse("W-INT-MARK-LOST", number=facts.mark.lost)
    if facts.mark.stranger and facts.marker is not None and facts.marker.state in ("none", "committed"):
        yield from refuse("W-INT-STRANGER", number=facts.mark.stranger)


def _live_alarms(facts: PushFacts) -> Iterator[Refusal]:
    for alarm in facts.request.alarms:
        yield from refuse("W-INT-ALARM", axis=facts.change.axis, alarm=alarm)


def _open_connection(facts: PushFacts) -> Iterator[Refusal]:
    if facts.can.unprotected:
        yield from refuse("W-INT-UNPROTECTED", road=facts.can.unprotected)


_WARNING: tuple[Rule, ...] = (
    _steep,
    _far,
    _old,
    _extrapolation,
    _doubtful_findings,
    _no_marker,
    _marker_doubts,
    _live_alarms,
    _open_connection,
)


def _approvals(facts: PushFacts) -> Iterator[Refusal]:
    wanted = people_needed(facts)
    problems = {approval: tuple(_approval_problem(facts, approval)) for approval in facts.request.approvals}
    people = _people(problems)
    if len(people) + 1 >= wanted:
        return
    found = [one for problem in problems.values() for one in problem]
    yield from found
    if not found:
        why = "; ".join(warning.words for warning in warnings(facts)) or words("W-INT-APPROVAL-ASKED")
        yield from refuse(
            "E-INT-APPROVAL-MISSING", table=facts.table.called, needed=wanted, have=len(people) + 1, why=why
        )


def _people(problems: Mapping[Approval, tuple[Refusal, ...]]) -> set[str]:
    return {person_key(approval.actor) for approval, problem in problems.items() if not problem}


def _risk(facts: PushFacts) -> Iterator[Refusal]:
    """Where this site lets one person push alone, that person types the risk of a connection that lies open."""
    if not facts.can.unprotected or facts.request.risk_taken or people_needed(facts) > 1:
        return
    if not _people({approval: tuple(_approval_problem(facts, approval)) for approval in facts.request.approvals}):
        yield from refuse("E-INT-RISK", road=facts.can.unprotected)


def _approval_problem(facts: PushFacts, approval: Approval) -> Iterator[Refusal]:
    """Why this approval does not count, if it does not."""
    wanted = (facts.plan, facts.change.base_digest, facts.request.machine.serial)
    if (approval.plan_hash, approval.base_digest, approval.serial) != wanted:
        yield from refuse("E-INT-APPROVAL-OTHER-PLAN", actor=approval.actor)
    elif approval.run_id != facts.request.run_id:
        yield from refuse("E-INT-APPROVAL-OTHER-RUN", actor=approval.actor, run=approval.run_id or "none")
    elif approval in facts.request.used_approvals:
        yield from refuse("E-INT-APPROVAL-USED", actor=approval.actor)
    elif approval in facts.request.unrecorded_approvals:
        yield from refuse("E-INT-APPROVAL-UNRECORDED", actor=approval.actor)
    elif approval in facts.request.unsigned_approvals:
        yield from refuse("E-INT-APPROVAL-UNSIGNED", actor=approval.actor)
    elif not _is_short_enough(approval):
        yield from refuse("E-INT-APPROVAL-TOO-LONG", actor=approval.actor, given=approval.given_utc, **_times(approval))
    elif _is_clock_set_back(facts, approval):
        yield from refuse("E-INT-APPROVAL-CLOCK", actor=approval.actor, given=approval.given_utc)
    elif not _holds(facts, approval):
        yield from refuse("E-INT-APPROVAL-EXPIRED", actor=approval.actor, given=approval.given_utc, **_times(approval))
    elif person_key(approval.actor) == person_key(facts.request.actor):
        yield from refuse("E-INT-APPROVAL-SAME-PERSON", actor=approval.actor)
    elif person_key(facts.request.actor) in map(person_key, approval.kept_by):
        yield from refuse("E-INT-APPROVAL-OWN-ACCOUNT", actor=approval.actor, by=facts.request.actor)


def _times(approval: Approval) -> dict[str, object]:
    return {"until": approval.expires_utc, "minutes": round(APPROVED_FOR.total_seconds() / 60.0)}


def _is_short_enough(approval: Approval) -> bool:
    """Whether it ends soon enough after it was given."""
    try:
        given, until = datetime.fromisoformat(approval.given_utc), datetime.fromisoformat(approval.expires_utc)
        return until - given <= APPROVED_FOR
    except (ValueError, TypeError):
        return True  # then it never holds


def _age_s(facts: PushFacts, approval: Approval) -> float | None:
    """Its age by the computer's own count when it must hold; None where that cannot be compared."""
    request = facts.request
    if request.consent_utc is not None:
        return approval.age_s(request.consent_uptime) if request.consent_uptime is not None else None
    return approval.age_s(facts.uptime)


def _is_clock_set_back(facts: PushFacts, approval: Approval) -> bool:
    """Whether only the calendar can tell its age, and that was set back since it was given."""
    return _age_s(facts, approval) is None and approval in facts.request.overtaken_approvals


def _holds(facts: PushFacts, approval: Approval) -> bool:
    """Whether it still holds: by the computer's own count, or after a restart and at another computer by the dates."""
    age_s = _age_s(facts, approval)
    if age_s is None:
        return _is_valid_at(approval, facts.request.consent_utc or facts.now_utc)
    try:
        long = datetime.fromisoformat(approval.expires_utc) - datetime.fromisoformat(approval.given_utc)
        return 0.0 <= age_s < long.total_seconds()
    except (ValueError, TypeError):
        return False


def _is_valid_at(approval: Approval, now: datetime) -> bool:
    """Whether ``now`` lies between its own two dates; another PC's clock may be a little ahead."""
    try:
        given, until = datetime.fromisoformat(approval.given_utc), datetime.fromisoformat(approval.expires_utc)
        return given - APPROVED_AHEAD <= now < until
    except (ValueError, TypeError):
        return False


def _audit(facts: PushFacts) -> Iterator[Refusal]:
    if facts.request.audit_broken:
        yield from refuse("E-INT-AUDIT-BROKEN", why=facts.request.audit_broken)


def _proposal(facts: PushFacts) -> Iterator[Refusal]:
    if not facts.request.is_proposed:
        yield from refuse("E-INT-NOT-PROPOSED", table=facts.table.called, plan=facts.plan[:12])


APPROVED: tuple[Rule, ...] = (_approvals, _risk, _audit, _proposal)
