"""What a reversal does to a flank whose spaces are ground in one direction, in words; pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers.message import Message, fixed
from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, mm_to_um
from gateway.config import WorkSection
from gateway.domain.captures import Capture
from gateway.domain.proposals import TableChange
from gateway.evaluate.behaviour.repeatability import approach_of


def ground_one_way(
    axis: str, capture: Capture, work: WorkSection | None, own: Sequence[TableChange], *, lever_mm: FloatArray
) -> tuple[Message, ...]:
    """What the reversal of the index ``axis`` makes on the flank; nothing where it was come to from one side only.

    ``own`` are the changes of the axis layer, ``lever_mm`` what a turn of 1 rad moves each flank point by along its
    normal. What varies from place to place moves the spaces against each other; what is the same everywhere, and the
    reversals of infeed and stroke, leave no mark.
    """
    both = np.all(np.any(np.isfinite(capture.deviations), axis=1), axis=1)
    if work is None or not np.any(both):
        return ()
    varies = float(arcsec_to_rad(approach_of(capture).reversal))
    paired = any(
        one.axis == axis and one.new.kind == "cross" and one.layer == "axis" and not one.skipped for one in own
    )
    code = "S-TOOTH-ONE-WAY-PAIR" if paired else "S-TOOTH-ONE-WAY"
    moved = float(mm_to_um(varies * np.sqrt(np.mean(np.square(lever_mm)))))
    return (Message.of(code, axis=axis, way="+" if work.index_sense > 0 else "-", moved=fixed(moved)),)
