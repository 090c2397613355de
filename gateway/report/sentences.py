"""The report's words and number formats: one place for every sentence it prints."""

from __future__ import annotations

import re
import unicodedata
from datetime import UTC, datetime
from math import isfinite

from drivers.message import Message, Moment, term, words
from drivers.terms import spoken
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable
from gateway.domain.captures import Capture
from gateway.report.material import AxisMaterial, Outcome, ReportMaterial
from gateway.report.parameters import parameter_rows

UNIT = {"um": "µm", "arcsec": "arcsec", "mm": "mm", "deg": "deg"}
ABSENT = "–"
MICRO = re.compile(r"\bum\b")

# symbol, headline, sentence: the state is told by form and word, never by colour alone.
OUTCOME: dict[Outcome, tuple[str, str, str]] = {
    "better": ("✔", "Better", words("S-OUTCOME-BETTER")),
    "unchanged": ("=", "Unchanged", words("S-OUTCOME-UNCHANGED")),
    "worse": ("✖", "Worse", words("S-OUTCOME-WORSE")),
    "not-pushed": ("○", "Not pushed", words("S-OUTCOME-NOT-PUSHED")),
    "pushed": ("○", "Pushed", words("S-OUTCOME-PUSHED")),
    "measured": ("○", "Measured", words("S-OUTCOME-MEASURED")),
    "inspected": ("○", "Inspected", words("S-OUTCOME-INSPECTED")),
}

PUSH = {
    "committed": "written, read back equal, enabled, effect proved",
    "already-applied": words("S-PUSH-HELD-ALREADY"),
    "rolled-back": words("S-PUSH-RESTORED"),
    "untouched": words("S-PUSH-NOT-STARTED"),
    "held": words("S-PUSH-HELD-OFF"),
    "held-on": words("S-PUSH-HELD-ON"),
    "refused": words("S-PUSH-REFUSED"),
    "skipped": "not written",
}

GLOSSARY = (
    ("E", "bidirectional systematic deviation"),
    ("R", "bidirectional repeatability"),
    ("B", "reversal"),
    ("A", "bidirectional accuracy"),
    ("M", words("S-GLOSSARY-M")),
    ("M_travel", words("S-GLOSSARY-M-TRAVEL")),
)


def visible(text: str) -> str:
    """Text without what a reader cannot see: control, direction and broken characters become U+FFFD."""
    hidden = {"Cc", "Cf", "Cs"}
    return "".join(
        letter if letter in "\n\t" or unicodedata.category(letter) not in hidden else "\ufffd" for letter in text
    )


def number(value: float | None, decimals: int = 2) -> str:
    """Fixed decimals with a true minus sign; a dash for what does not exist; never "-0.00"."""
    if value is None or not isfinite(value):
        return ABSENT
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0.0 else text.replace("-", "−")


def signed(value: float | None, decimals: int = 2) -> str:
    """As `number`, with a plus sign in front of what is above zero."""
    text = number(value, decimals)
    return f"+{text}" if value is not None and isfinite(value) and float(f"{value:.{decimals}f}") > 0 else text


def percent(value: float | None) -> str:
    """A change in whole percent, signed."""
    return ABSENT if value is None or not isfinite(value) else f"{signed(value, 0)} %"


def shortest(value: object) -> str:
    """A coefficient as short as it can be told: 11.5, 1.000271."""
    return f"{value:.7g}".replace("-", "−") if isinstance(value, float) else str(value)


def step_line(step: Message) -> str:
    """A step of a push: when, what, and the details that its journal has; a refusal's reason as it is."""
    at = step.fields.get("utc")
    if not isinstance(at, Moment):
        return str(step)
    told = ", ".join(f"{key} {value}" for key, value in step.fields.items() if key != "utc")
    return f"{at.utc} {step}" + (f": {told}" if told else "")


def micro(text: str) -> str:
    """A sentence with um written as µm."""
    return MICRO.sub("µm", text)


def plain(value: float) -> str:
    """A round number without needless digits: 2, 0.25."""
    return f"{value:g}".replace("-", "−")


def when(stamp: str) -> str:
    """An ISO 8601 moment as "2026-03-02 14:05 UTC"; anything else as it is."""
    try:
        moment = datetime.fromisoformat(stamp)
    except ValueError:
        return stamp or ABSENT
    return moment.astimezone(UTC).strftime("%Y-%m-%d %H:%M UTC") if moment.tzinfo else stamp


def open_road(report: ReportMaterial) -> tuple[str, ...]:
    """Lines where the connection to the control was not protected, or a person answers for who it is."""
    told = [words("S-REPORT-UNPROTECTED", unprotected=report.unprotected)] if report.unprotected else []
    who, why = report.excused
    if why:
        told.append(words("S-REPORT-EXCUSED", who=who, why=why))
    for one in report.accepted:
        told.append(
            words("S-REPORT-ACCEPTED", fact=one.fact, was=one.was, value=one.value, who=one.who, reason=one.reason)
        )
    return tuple(told)


def still_on(report: ReportMaterial) -> tuple[Message, ...]:
    """One line for each table whose push was held with nothing to prove that it is off: first in every report."""
    tables = report.tooth.tables if report.tooth is not None else ()
    pushes = [(axis.axis, axis.push) for axis in report.axes]
    pushes += [(one.change.name, one.push) for one in (*(one for axis in report.axes for one in axis.beside), *tables)]
    left = {name: push for name, push in pushes if push is not None and push.outcome == "held-on"}
    return tuple(
        Message.of("S-REPORT-STILL-ON", table=name, backup=push.backup_path or Message.of("S-REPORT-NO-BACKUP"))
        for name, push in left.items()
    )


def axis_state(axis: AxisMaterial) -> tuple[str, str, str]:
    """Class, symbol and word of one axis: what became of it."""
    if axis.push is not None and axis.push.outcome == "held-on":
        return "worse", "✖", words("S-REPORT-HELD-ON")
    if axis.verdict is not None:
        return _judged(axis)
    if axis.push is not None and axis.push.outcome in {"rolled-back", "held"}:
        return "worse", "✖", axis.push.outcome.replace("-", " ")
    if axis.change is not None and axis.change.skipped:
        return "unchanged", "=", "not corrected"
    return "not-pushed", "○", "proposed only" if axis.change is not None else "measured only"


def _judged(axis: AxisMaterial) -> tuple[str, str, str]:
    verdict = axis.verdict
    if verdict is not None and verdict.improved:
        return "better", "✔", "improved"
    rows = parameter_rows(axis.axis, axis.before, axis.after)
    worse = verdict is not None and verdict.worse
    worse = worse or any(row.parameter == "M" and row.significant and (row.change_pct or 0.0) > 0.0 for row in rows)
    return ("worse", "✖", "worse") if worse else ("unchanged", "=", "unchanged")


def axis_kind(axis: AxisMaterial) -> str:
    """What was measured, for a heading."""
    kind = "angular positioning" if axis.rotary else "linear positioning"
    return f"{kind} {axis.component}".strip()


def value_sense(table: CompensationTable, proof: SignProof | None) -> str:
    """What a positive stored value does on the machine, and how that is known."""
    terms = spoken()
    rule = term({"axis": terms.own_rule, "cross": terms.cross_rule, "reversal": terms.reversal_rule}[table.kind])
    if proof is None:
        return words("S-SENSE-UNPROVED", rule=rule)
    return words(
        "S-SENSE-PROVED",
        rule=rule,
        date_utc=when(proof.date_utc),
        slope=signed(proof.slope, 3),
        U=number(2 * proof.slope_u, 3),
    )


def suspects(name: str, capture: Capture) -> tuple[str, ...]:
    """One sentence for each reading of the capture (before, after) that stands out of line."""
    return tuple(f"{name.capitalize()}: {_suspect(capture, *place)}" for place in capture.suspects)


def _suspect(capture: Capture, target: int, repetition: int, approach: int) -> str:
    if not (0 <= target < capture.targets.size and 0 <= repetition < capture.deviations.shape[1]):
        return words("S-SUSPECT-OUTSIDE", target=target + 1, repetition=repetition + 1)
    where = f"{number(float(capture.targets[target]), 3)} {UNIT[capture.axis_unit]}"
    value = signed(float(capture.deviations[target, repetition, approach]), 2)
    return words(
        "S-SUSPECT",
        target=target + 1,
        at=where,
        repetition=repetition + 1,
        way="−" if approach else "+",
        value=value,
        unit=UNIT[capture.unit],
    )
