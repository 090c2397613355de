"""Every sentence the report says of the tooth, its errors and what was done: one place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from drivers.message import Message, prose
from drivers.terms import spoken
from gateway.domain.values import COVERAGE
from gateway.model.error_model import TWENTY_ONE
from gateway.report.material import Outcome, ReportMaterial, ToothMaterial
from gateway.report.sentences import OUTCOME, number, percent
from gateway.report.tooth.errors import ErrorRow
from gateway.report.tooth.flank import before_after, gain_pct

TOOTH_OUTCOME: dict[Outcome, str] = {
    "better": "Test parts were ground and inspected before and after the correction: the flank improved.",
    "unchanged": "Test parts were ground and inspected before and after: no change beyond the uncertainty.",
    "worse": "Test parts were ground and inspected before and after: the flank became worse.",
    "not-pushed": "Nothing was written to the controller by this run.",
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
    "eccentricity": "runout: eccentricity in it",
}
TITLE = {
    "errors": "Error measurement report",
    "part": "Gear inspection report",
    "closing": "Tooth and axis report",
    "": "Axis measurement and compensation report",
}
FIGURE = (
    "Flank figure: RMS of the normal deviation over all spaces, both flanks, 95 % of the profile in equal arc length "
    "and the full face width, after one rotation about the gear's axis is removed, nothing else. Normal deviation: "
    "+ = surplus material, µm."
)
SET_RIGHT = (
    "“Set-up values corrected”: one move of the infeed and one of the dresser are removed from the flank. They "
    "need no table, so the tables are judged against this flank."
)
TRACES = (
    "Normal deviation, µm, + = surplus. Profile: mean of all spaces and heights. Lead: mean of all spaces and the "
    "whole flank. Pitch: each flank's mean in every space less its mean over all. Runout: mean of "
    "both flanks likewise."
)
_CURED = (
    "Shares of the mean square of the flank before, from the model's maps. A move of X has the same effect on both "
    "flanks of a space, a turn of C the opposite. A part that depends on the height belongs to a table over Z, on the "
    "space to one over C. Moving the work on its table counts with the tables over C, constants with the set-up "
    "values. A negative share of {own} means that it corrects the axes but spoils the tooth; {cross} then corrects "
    "the tooth. “Set right”: the share of the flank after its set-up values are corrected, which is what the tables "
    "are for."
)
_LAYERS = (
    "{own} tables correct each axis by itself and were judged with {cross} off. {cross} tables hold what the tooth "
    "needs in addition; with them on, a single axis may measure worse, as predicted."
)
RANKING = (
    "Morris screening of the flank's RMS with correct set-up values: each error from zero to its measured size, an "
    "assumed one over its span. µ* with its 95 % interval; beside it the rank, or the ranks that cannot be separated. "
    "Colour: what corrects it on this machine."
)
SETUP = (
    "Set-up values are work offsets and the dressing offset. They are set in the grinding program, are not part of any "
    "table, and are valid for this clamping and wheel."
)
ALONE = (
    "Each error alone as measured, with the present set-up values; “left at best” is what remains of it with all "
    "tables and set-up values."
)
UNSEEN = "What the measurements do not show"


def cured() -> str:
    """How the shares of each cure were worked out."""
    return _CURED.format(own=spoken().own, cross=spoken().cross)


def layers() -> str:
    """What the two kinds of tables are for."""
    return _LAYERS.format(own=spoken().own, cross=spoken().cross)


def title(report: ReportMaterial) -> str:
    """What kind of report this is."""
    return TITLE[report.tooth.kind if report.tooth is not None else ""]


def sentence(report: ReportMaterial) -> str:
    """The band's sentence: of the tooth where it was judged, else of the axes."""
    verdict = report.tooth.verdict if report.tooth is not None else None
    if verdict is None:
        said = OUTCOME[report.outcome][2]
        judged = report.outcome in ("better", "unchanged", "worse")
        return f"{said} Nothing is proved about the tooth." if report.tooth is not None and judged else said
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
    model = ", by the model" if tooth.part("before").flank is None and tooth.verdict is None else " before"
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
    return (
        f"With the set-up values as ground: {number(ground)} µm. The difference to {number(fair)} µm comes from the "
        "set-up values alone and is not counted for the tables."
    )


def doubt(tooth: ToothMaterial) -> str:
    """How sure the prediction is and whether the flank kept it; "" without a prediction."""
    if tooth.proposal is None:
        return ""
    found = tooth.proposal.prediction
    said = (
        f"The standard uncertainty of the predicted flank is {number(found.u_um)} µm (RMS); tables and set-up values "
        f"leave {number(found.floor_um)} µm at best."
    )
    if tooth.proposal.b_left:
        share = number(100.0 * tooth.proposal.b_left, 0)
        said += f" Of a displacement along the wheel's axis, {share} % cannot be corrected on this gear."
    if tooth.verdict is None:
        return said
    held = "within" if tooth.verdict.within_prediction else "outside"
    return f"{said} The flank after is {held} the uncertainty of the prediction (k = 2)."


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
    return (
        f"Moving the work on its table would help: {number(x)} µm along x, {number(y)} µm along y, tilt "
        f"{number(a)} arcsec about x, {number(b)} arcsec about y. It changes at each clamping and is in no table."
    )
