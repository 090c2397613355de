"""The end of a run on a console: axes, tables, set-up values, what is missing; the tooth's figure last."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from drivers.errors import words
from drivers.message import prose
from gateway.domain.outcomes import ActingCheck, AxisVerdict
from gateway.domain.values import COVERAGE
from gateway.report.material import ReportMaterial, ToothMaterial
from gateway.report.missing import PUSHED, missing
from gateway.report.sentences import plain
from gateway.report.tooth.errors import error_rows
from gateway.report.tooth.flank import before_after
from gateway.report.tooth.rows import cure_rows, setup_rows
from gateway.report.tooth.sentences import known


def axis_lines(verdicts: Iterable[AxisVerdict]) -> tuple[str, ...]:
    """What became of each axis: one line for all that improved as predicted, every word where one did not."""
    found = tuple(verdicts)
    well = ", ".join(one.axis for one in found if _well(one))
    rest = tuple(f"{one.axis}: {prose(one.words)}" for one in found if not _well(one))
    return (*((words("S-REPORT-AXES", names=well),) if well else ()), *rest)


def _well(verdict: AxisVerdict) -> bool:
    return verdict.improved and verdict.within_prediction


def details(verdicts: Iterable[AxisVerdict], acting: Iterable[ActingCheck] = ()) -> tuple[str, ...]:
    """What `axis_lines` leaves to the report, and the checks with every table acting that held."""
    told = [f"{one.axis}: {prose(one.words)}" for one in verdicts if _well(one)]
    return (*told, *(str(one.words) for one in acting if one.held))


def acting_lines(acting: Iterable[ActingCheck]) -> tuple[str, ...]:
    """What short checks with every table acting said, where that was not as predicted."""
    return tuple(str(one.words) for one in acting if not one.held)


def tooth_lines(report: ReportMaterial) -> tuple[str, ...]:
    """For people, one line each; nothing for a run without tooth or errors."""
    tooth = report.tooth
    if tooth is None:
        return ()
    if tooth.kind == "errors":
        return tuple(line for line in (known(error_rows(tooth.errors)) if tooth.errors else "", tooth.advice) if line)
    axes = axis_lines(axis.verdict for axis in report.axes if axis.verdict is not None)
    axes += acting_lines(axis.acting for axis in report.axes if axis.acting is not None)
    verdict = (prose(tooth.verdict.words),) if tooth.verdict is not None else ()
    return (*axes, *_tables(tooth), *_setup(tooth), *_incurable(tooth), *missing(report), *verdict, figure(tooth))


def figure(tooth: ToothMaterial) -> str:
    """The tooth's figure: flank RMS before -> after beside the prediction, the prediction alone, or that of a part."""
    ground, fair, after = before_after(tooth)
    start = fair if fair is not None else ground
    said = "" if fair is None else words("S-REPORT-APART")
    if start is None or (after is None and tooth.proposal is None):
        return _alone(tooth)
    if after is None:
        return words("S-REPORT-TOOTH-PREDICTED", before=f"{start:.2f}", predicted=_predicted(tooth), apart=said)
    beside = "" if tooth.proposal is None else f" ({_predicted(tooth)})"
    return words("S-REPORT-TOOTH", before=f"{start:.2f}", after=f"{after:.2f}", predicted=beside, apart=said)


def _alone(tooth: ToothMaterial) -> str:
    """A part alone has its own RMS; otherwise there is no figure."""
    last = next((one for one in reversed(tooth.parts) if one.flank is not None), None)
    if last is None or last.flank is None:
        return words("S-REPORT-NO-TOOTH")
    U = f"{COVERAGE * last.flank.rms_u_um:.2f}"
    return words("S-REPORT-PART", part=last.part, rms=f"{last.flank.fitted.rms_um:.2f}", U=U)


def _predicted(tooth: ToothMaterial) -> str:
    if tooth.proposal is None:
        return ""
    found = tooth.proposal.prediction
    return words("S-REPORT-PREDICTED", rms=f"{found.rms_um:.2f}", U=f"{COVERAGE * found.rms_u_um:.2f}")


def _tables(tooth: ToothMaterial) -> Iterator[str]:
    pushed = [one.change.name for one in tooth.tables if one.push is not None and one.push.outcome in PUSHED]
    if pushed:
        yield words("S-REPORT-TABLES", names=", ".join(pushed))


def _setup(tooth: ToothMaterial) -> Iterator[str]:
    rows = setup_rows(tooth)
    if rows:
        last = rows[-1]
        told = {"x": f"{last.values.x_um:+.2f}", "c": f"{last.values.c_arcsec:+.2f}"}
        name = last.name.replace("“", '"').replace("”", '"')
        yield words("S-REPORT-SETUP", name=name, **told, dressing=f"{last.values.dressing_um:+.2f}")


def _incurable(tooth: ToothMaterial) -> Iterator[str]:
    left = [f"{one.error} {one.floor_um:.2f} um" for one in cure_rows(tooth) if one.why and one.floor_um >= LEAST_UM]
    if left:
        yield words("S-REPORT-INCURABLE", names=", ".join(left), limit=plain(LEAST_UM))


LEAST_UM = 0.05  # below, what is left of an error is no news
