"""The end of a run on a console: axes, tables, set-up values, what is missing; the tooth's figure last."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from drivers.message import Message, Quantity, fixed
from gateway.domain.outcomes import ActingCheck, AxisVerdict
from gateway.domain.values import COVERAGE
from gateway.report.material import ReportMaterial, ToothMaterial
from gateway.report.missing import PUSHED, missing
from gateway.report.tooth.errors import error_rows
from gateway.report.tooth.flank import before_after
from gateway.report.tooth.rows import cure_rows, setup_rows
from gateway.report.tooth.sentences import known_said

Lines = tuple[Message, ...]


def axis_lines(verdicts: Iterable[AxisVerdict]) -> Lines:
    """What became of each axis: one line for all that improved as predicted, every word where one did not."""
    found = tuple(verdicts)
    well = ", ".join(one.axis for one in found if _well(one))
    rest = tuple(_of_axis(one) for one in found if not _well(one))
    return (*((Message.of("S-REPORT-AXES", names=well),) if well else ()), *rest)


def _of_axis(verdict: AxisVerdict) -> Message:
    return Message.of("S-REPORT-AXIS", axis=verdict.axis, said=verdict.words)


def _well(verdict: AxisVerdict) -> bool:
    return verdict.improved and verdict.within_prediction


def details(verdicts: Iterable[AxisVerdict], acting: Iterable[ActingCheck] = ()) -> Lines:
    """What `axis_lines` leaves to the report, and the checks with every table acting that held."""
    told = (_of_axis(one) for one in verdicts if _well(one))
    return (*told, *(one.words for one in acting if one.held))


def acting_lines(acting: Iterable[ActingCheck]) -> Lines:
    """What short checks with every table acting said, where that was not as predicted."""
    return tuple(one.words for one in acting if not one.held)


def tooth_lines(report: ReportMaterial) -> Lines:
    """For people, one line each; nothing for a run without tooth or errors."""
    tooth = report.tooth
    if tooth is None:
        return ()
    if tooth.kind == "errors":
        return (*(known_said(error_rows(tooth.errors)) if tooth.errors else ()), *tooth.advice)
    axes = axis_lines(axis.verdict for axis in report.axes if axis.verdict is not None)
    axes += acting_lines(axis.acting for axis in report.axes if axis.acting is not None)
    verdict = tooth.verdict.words if tooth.verdict is not None else ()
    return (*axes, *_tables(tooth), *_setup(tooth), *_incurable(tooth), *missing(report), *verdict, figure(tooth))


def figure(tooth: ToothMaterial) -> Message:
    """The tooth's figure: flank RMS before -> after beside the prediction, the prediction alone, or that of a part."""
    ground, fair, after = before_after(tooth)
    start = fair if fair is not None else ground
    said = "" if fair is None else Message.of("S-REPORT-APART")
    if start is None or (after is None and tooth.proposal is None):
        return _alone(tooth)
    if after is None:
        predicted = _predicted(tooth)
        return Message.of("S-REPORT-TOOTH-PREDICTED", before=fixed(start), predicted=predicted, apart=said)
    beside = "" if tooth.proposal is None else Message.of("S-REPORT-BESIDE", predicted=_predicted(tooth))
    return Message.of("S-REPORT-TOOTH", before=fixed(start), after=fixed(after), predicted=beside, apart=said)


def _alone(tooth: ToothMaterial) -> Message:
    """A part alone has its own RMS; otherwise there is no figure."""
    last = next((one for one in reversed(tooth.parts) if one.flank is not None), None)
    if last is None or last.flank is None:
        return Message.of("S-REPORT-NO-TOOTH")
    U = fixed(COVERAGE * last.flank.rms_u_um)
    return Message.of("S-REPORT-PART", part=last.part, rms=fixed(last.flank.fitted.rms_um), U=U)


def _predicted(tooth: ToothMaterial) -> Message | str:
    if tooth.proposal is None:
        return ""
    found = tooth.proposal.prediction
    return Message.of("S-REPORT-PREDICTED", rms=fixed(found.rms_um), U=fixed(COVERAGE * found.rms_u_um))


def _tables(tooth: ToothMaterial) -> Iterator[Message]:
    pushed = [one.change.name for one in tooth.tables if one.push is not None and one.push.outcome in PUSHED]
    if pushed:
        yield Message.of("S-REPORT-TABLES", names=", ".join(pushed))


def _setup(tooth: ToothMaterial) -> Iterator[Message]:
    rows = setup_rows(tooth)
    if rows:
        last = rows[-1]
        moves = {"x": last.values.x_um, "c": last.values.c_arcsec, "dressing": last.values.dressing_um}
        told = {key: fixed(value, signed=True) for key, value in moves.items()}
        yield Message.of("S-REPORT-SETUP", name=last.name, **told)


def _incurable(tooth: ToothMaterial) -> Iterator[Message]:
    cures = [one for one in cure_rows(tooth) if one.why and one.floor_um >= LEAST_UM]
    if cures:
        left = tuple(Message.of("S-REPORT-LEFT", error=one.error, floor=fixed(one.floor_um)) for one in cures)
        yield Message.of("S-REPORT-INCURABLE", names=left, limit=Quantity(LEAST_UM))


LEAST_UM = 0.05  # below, what is left of an error is no news
