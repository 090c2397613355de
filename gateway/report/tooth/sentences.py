"""Every sentence the report says of the tooth, its errors and what was done: one place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from drivers.message import Message, prose, words
from drivers.terms import spoken
from gateway.domain.values import COVERAGE
from gateway.model.error_model import TWENTY_ONE
from gateway.report.material import Outcome, ReportMaterial, ToothMaterial
from gateway.report.sentences import OUTCOME, number, percent
from gateway.report.tooth.errors import ErrorRow
from gateway.report.tooth.flank import before_after, gain_pct

TOOTH_OUTCOME: dict[Outcome, str] = {
    "better": words("S-TOOTH-OUT-BETTER"),
    "unchanged": words("S-TOOTH-OUT-SAME"),
    "worse": words("S-TOOTH-OUT-WORSE"),
    "not-pushed": words("S-OUTCOME-NOT-PUSHED"),
}
FIGURE_NAMES = {
    "F_alpha": "profile: total F_α",
    "f_Halpha": "profile: slope f_Hα",
    "f_falpha": "profile: form f_fα",
    "F_beta": "lead: total F_β",
    "f_Hbeta": "lead: slope f_Hβ",
    "f_fbeta": "lead: form f_fβ",
    "F_p": "pitch: cumulative F_p",
    "f_p": "pitch: single f_p",
    "F_r": "runout F_r",
    "eccentricity": words("S-TOOTH-RUNOUT"),
}
TITLE = {
    "errors": "Error measurement report",
    "part": "Gear inspection report",
    "closing": words("S-TOOTH-REPORT"),
    "": words("S-TOOTH-AXIS-REPORT"),
}
FIGURE = words("S-TOOTH-FIGURE")
SET_RIGHT = words("S-TOOTH-SET-RIGHT")
TRACES = words("S-TOOTH-PARAMETERS")
RANKING = words("S-TOOTH-MORRIS")
SETUP = words("S-TOOTH-SETUP-VALUES")
ALONE = words("S-TOOTH-EACH")
UNSEEN = words("S-TOOTH-UNSEEN")


def cured() -> str:
    """How the shares of each cure were worked out."""
    return words("S-TOOTH-SHARES", own=spoken().own, cross=spoken().cross)


def layers() -> str:
    """What the two kinds of tables are for."""
    return words("S-TOOTH-TABLES", own=spoken().own, cross=spoken().cross)


def title(report: ReportMaterial) -> str:
    """What kind of report this is."""
    return TITLE[report.tooth.kind if report.tooth is not None else ""]


def sentence(report: ReportMaterial) -> str:
    """The band's sentence: of the tooth where it was judged, else of the axes."""
    verdict = report.tooth.verdict if report.tooth is not None else None
    if verdict is None:
        said = OUTCOME[report.outcome][2]
        judged = report.outcome in ("better", "unchanged", "worse")
        return words("S-TOOTH-NO-PROOF", said=said) if report.tooth is not None and judged else said
    said = TOOTH_OUTCOME[verdict.outcome]
    return said if report.outcome == verdict.outcome else f"{said} {OUTCOME[report.outcome][2]}"


@dataclass(frozen=True, slots=True)
class Box:
    """One large figure at the top: what it is, its number as text, its unit, and a class for its look."""

    what: str
    value: str
    unit: str
    look: str = ""


def boxes(tooth: ToothMaterial) -> tuple[Box, ...]:
    """Flank RMS before, after, the change, and what was predicted: those there are."""
    ground, fair, after = before_after(tooth)
    start = fair if fair is not None else ground
    model = words("S-TOOTH-BY-MODEL") if tooth.part("before").flank is None and tooth.verdict is None else " before"
    right = ", set-up values corrected" if fair is not None else ""
    found = [Box(f"Flank RMS{model}{right}", number(start), "µm")] if start is not None else []
    if after is not None:
        found.append(Box("Flank RMS after", number(after), "µm", "new"))
    if (change := gain_pct(tooth)) is not None:
        found.append(Box("Change", percent(change).removesuffix(" %"), "%"))
    if tooth.proposal is not None:
        one = tooth.proposal.prediction
        value = f"{number(one.rms_um)} ± {number(COVERAGE * one.rms_u_um)}"
        found.append(Box("Predicted, U with k = 2", value, "µm", "quiet"))
    return tuple(found)


def apart(tooth: ToothMaterial) -> str:
    """What the set-up values alone account for, which is no merit of the tables; "" where that is not known."""
    ground, fair, _after = before_after(tooth)
    if ground is None or fair is None:
        return ""
    return words("S-TOOTH-AS-GROUND", ground=number(ground), fair=number(fair))


def doubt(tooth: ToothMaterial) -> str:
    """How sure the prediction is and whether the flank kept it; "" without a prediction."""
    if tooth.proposal is None:
        return ""
    found = tooth.proposal.prediction
    said = words("S-TOOTH-U-FLOOR", u_um=number(found.u_um), floor_um=number(found.floor_um))
    if tooth.proposal.b_left:
        share = number(100.0 * tooth.proposal.b_left, 0)
        said += " " + words("S-TOOTH-ALONG-WHEEL", share=share)
    if tooth.verdict is None:
        return said
    held = "within" if tooth.verdict.within_prediction else "outside"
    return words("S-TOOTH-AFTER-HELD", said=said, held=held)


def known(rows: Sequence[ErrorRow]) -> str:
    """How many errors were measured and how many are only assumed, in English."""
    return prose(known_said(rows))


def known_said(rows: Sequence[ErrorRow]) -> Iterator[Message]:
    """How many errors were measured and how many are only assumed."""
    asked = [row for row in rows if row.name in TWENTY_ONE]
    guessed = [row.name for row in asked if row.state == "assumed"]
    beside = [row.name for row in rows if row.name not in TWENTY_ONE]
    told: dict[str, object] = {"count": len(asked) - len(guessed), "total": len(asked), "names": ", ".join(beside)}
    yield Message("S-REPORT-KNOWN-BESIDE" if beside else "S-REPORT-KNOWN", told)
    if guessed:
        yield Message.of("S-REPORT-ASSUMED", names=", ".join(guessed))


def mounting(tooth: ToothMaterial) -> str:
    """How the work should be moved on its table; "" where that would not help."""
    if tooth.proposal is None or not any((*tooth.proposal.eccentricity_um, *tooth.proposal.tilt_arcsec)):
        return ""
    (x, y), (a, b) = tooth.proposal.eccentricity_um, tooth.proposal.tilt_arcsec
    return words("S-TOOTH-MOVE-WORK", x=number(x), y=number(y), a=number(a), b=number(b))
