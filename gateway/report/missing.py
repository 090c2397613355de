"""What a run did not reach, in words; pure."""

from __future__ import annotations

from collections.abc import Iterator

from gateway.domain.outcomes import PushRecord
from gateway.report.material import ReportMaterial, ToothMaterial

PUSHED = ("committed", "already-applied")
_PARTS = {
    "before": "there is no flank to compare with",
    "trial": "the set-up values were not tried on a part",
    "after": "nothing is proved on the tooth",
}


def missing(report: ReportMaterial) -> tuple[str, ...]:
    """One sentence for each stage that is not there; none for a run that had no tooth to look after."""
    tooth = report.tooth
    if tooth is None:
        return ()
    if tooth.kind == "closing":
        return (*_measured(report, tooth), *_proposed(tooth), *_pushed(tooth), *_parts(tooth, _PARTS), *_judged(tooth))
    return (*_pushed(tooth), *_parts(tooth, {one.part: "" for one in tooth.parts}))


def _measured(report: ReportMaterial, tooth: ToothMaterial) -> Iterator[str]:
    if tooth.errors is None:
        yield "The errors of the machine were not measured in this run."
    never = [axis.axis for axis in report.axes if axis.before is None]
    once = [axis.axis for axis in report.axes if axis.before is not None and axis.after is None]
    if never:
        yield f"Not measured as an axis: {', '.join(never)}."
    if once:
        yield f"Not measured again after the push: {', '.join(once)}."


def _proposed(tooth: ToothMaterial) -> Iterator[str]:
    if tooth.proposal is None:
        yield "Nothing was proposed for the tooth: no prediction, no cures, no ranking."
        return
    if not tooth.proposal.cures:
        yield "Which correction acts on which error was not calculated."
    if not tooth.proposal.ranking:
        yield "The errors were not ranked."


def _pushed(tooth: ToothMaterial) -> Iterator[str]:
    waiting = [one.change.name for one in tooth.tables if not one.change.skipped and not _is_pushed(one.push)]
    if waiting:
        yield f"Proposed but not in the control: {', '.join(waiting)}."


def _is_pushed(push: PushRecord | None) -> bool:
    return push is not None and push.outcome in PUSHED


def _parts(tooth: ToothMaterial, wanted: dict[str, str]) -> Iterator[str]:
    for name, so in wanted.items():
        part = tooth.part(name)
        if part.flank is None:
            done = "was ground but not inspected" if part.ground is not None else "was neither ground nor inspected"
            yield f"Part “{name}” {done}" + (f": {so}." if so else ".")


def _judged(tooth: ToothMaterial) -> Iterator[str]:
    if tooth.verdict is None:
        yield "The tooth was not judged."
