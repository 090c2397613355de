"""Every kind of evaluation that files alone allow, by the name that is typed; one call each, the function of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from gateway.errors import ModelError
from gateway.workflow.doubles import SAID, simulated_set
from gateway.workflow.files import linearkinds, rotarykinds
from gateway.workflow.files.kindrecords import KindAnswer, KindQuestion, MeasuredFile

Evaluate = Callable[[tuple[MeasuredFile, ...], KindQuestion], KindAnswer]
KINDS: Mapping[str, Evaluate] = {
    "positioning": linearkinds.positioning,
    "straightness": linearkinds.straight,
    "angular": linearkinds.angular,
    "squareness": linearkinds.square,
    "parallelism": linearkinds.parallelism,
    "six-dof": linearkinds.six_dof,
    "reversal": linearkinds.reversal,
    "axis-location": rotarykinds.axis_location,
    "rotary-motion": rotarykinds.motion,
    "harmonics": rotarykinds.spectrum,
}


def known_kind(kind: str) -> None:
    """Raises ModelError (E-KIND-NAME) before any file is read."""
    if kind not in KINDS:
        raise ModelError("E-KIND-NAME", "--kind", kind=kind, known=", ".join(KINDS))


def evaluate_kind(kind: str, files: tuple[MeasuredFile, ...], asked: KindQuestion) -> KindAnswer:
    """Evaluate files of one kind. Raises ModelError (E-KIND-NAME, E-KIND-FILES, E-KIND-UNIT and those of the kind)."""
    known_kind(kind)
    answer = KINDS[kind](files, asked)
    if any(simulated_set(one.measured) for one in files):
        return replace(answer, simulated=True, notes=(*answer.notes, SAID))
    return answer
