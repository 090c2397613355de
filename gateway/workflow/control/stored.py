"""What a stored run measured of the axes that its proposal is about."""

from __future__ import annotations

from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.domain.proposals import Proposal
from gateway.store import RunFolder
from gateway.workflow import stages
from gateway.workflow.axes.measure import MeasuredAxis


def stored_axes(folder: RunFolder, proposal: Proposal) -> dict[str, MeasuredAxis]:
    """Measurements by axis; the output axis of a cross table need not have been measured itself."""
    names = dict.fromkeys(change.axis for change in proposal.changes)
    own = {change.axis for change in proposal.changes if change.layer == "axis"}
    return {name: _stored(folder, name) for name in names if name in own or folder.has(stages.capture(name, "before"))}


def _stored(folder: RunFolder, axis: str) -> MeasuredAxis:
    capture = folder.get(stages.capture(axis, "before"), Capture)
    evaluation = folder.get(stages.evaluation(axis, "before"), Evaluation)
    return MeasuredAxis(capture, evaluation, folder.digest(stages.capture(axis, "before")))
