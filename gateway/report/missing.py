"""What a run did not reach, in words; pure."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.message import Message
from gateway.domain.outcomes import PushRecord
from gateway.report.material import ReportMaterial, ToothMaterial

PUSHED = ("committed", "already-applied")
_PARTS = {
    "before": "S-MISSING-SO-BEFORE",
    "trial": "S-MISSING-SO-TRIAL",
    "after": "S-MISSING-SO-AFTER",
}


def missing(report: ReportMaterial) -> tuple[Message, ...]:
    """One sentence for each stage that is not there; none for a run that had no tooth to look after."""
    tooth = report.tooth
    if tooth is None:
        return ()
    if tooth.kind == "closing":
        return (*_measured(report, tooth), *_proposed(tooth), *_pushed(tooth), *_parts(tooth, _PARTS), *_judged(tooth))
    return (*_pushed(tooth), *_parts(tooth, {one.part: "" for one in tooth.parts}))


def _measured(report: ReportMaterial, tooth: ToothMaterial) -> Iterator[Message]:
    if tooth.errors is None:
        yield Message.of("S-MISSING-ERRORS")
    never = [axis.axis for axis in report.axes if axis.before is None]
    once = [axis.axis for axis in report.axes if axis.before is not None and axis.after is None]
    if never:
        yield Message.of("S-MISSING-AXES", names=", ".join(never))
    if once:
        yield Message.of("S-MISSING-AGAIN", names=", ".join(once))


def _proposed(tooth: ToothMaterial) -> Iterator[Message]:
    if tooth.proposal is None:
        yield Message.of("S-MISSING-PROPOSAL")
        return
    if not tooth.proposal.cures:
        yield Message.of("S-MISSING-CURES")
    if not tooth.proposal.ranking:
        yield Message.of("S-MISSING-RANKING")


def _pushed(tooth: ToothMaterial) -> Iterator[Message]:
    waiting = [one.change.name for one in tooth.tables if not one.change.skipped and not _is_pushed(one.push)]
    if waiting:
        yield Message.of("S-MISSING-PUSH", names=", ".join(waiting))


def _is_pushed(push: PushRecord | None) -> bool:
    return push is not None and push.outcome in PUSHED


def _parts(tooth: ToothMaterial, wanted: dict[str, str]) -> Iterator[Message]:
    for name, so in wanted.items():
        part = tooth.part(name)
        if part.flank is None:
            code = "S-MISSING-INSPECTION" if part.ground is not None else "S-MISSING-PART"
            yield Message.of(code, part=name, so=Message.of(so) if so else "")


def _judged(tooth: ToothMaterial) -> Iterator[Message]:
    if tooth.verdict is None:
        yield Message.of("S-MISSING-VERDICT")
