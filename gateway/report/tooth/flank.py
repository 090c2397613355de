"""The flank of a run in figures: its states from before to after, each with RMS, largest and uncertainty; pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.message import words
from drivers.terms import spoken
from drivers.types.values import FloatArray
from gateway.domain.values import COVERAGE
from gateway.gear.process_drift import set_right
from gateway.report.material import ToothMaterial
from gateway.tooth import FlankMap, FlankPrediction, InspectedFlank

ENDS = ("before", "after")
FROM_GEAR = words("S-FLANK-FROM-GEAR")
STEPS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
Source = Literal["inspected", "worked out", "by the model", "predicted"]


@dataclass(frozen=True, slots=True)
class FlankState:
    """One state of the flank, um: its map, its figures, and U (k = 2) of the RMS where it is known.

    ``largest`` is to either side; ``u`` of a predicted state is that of the RMS to be expected.
    """

    key: str
    title: str
    source: Source
    map: FlankMap
    rms: float
    largest: float
    U: float | None

    @property
    def text(self) -> str:
        """Title with its source, for a heading."""
        return f"{self.title}, {self.source}"


def states(tooth: ToothMaterial) -> tuple[FlankState, ...]:
    """Before as ground, before with its set-up values right, predicted, trial, after: those there are, in that order.

    Without an inspected part before, the model's own flank before and with axis tables alone stand in its place.
    """
    before, after = tooth.part("before").flank, tooth.part("after").flank
    prediction = tooth.proposal.prediction if tooth.proposal is not None else None
    found: list[FlankState] = []
    if before is not None:
        found.append(_inspected("before", words("S-FLANK-AS-GROUND"), before))
        U = COVERAGE * before.rms_u_um
        found += _right(tooth, "before-set-right", words("S-FLANK-SET-RIGHT"), before.fitted, U)
    elif prediction is not None:
        found.append(_state("model-before", words("S-FLANK-AS-IS"), "by the model", prediction.before))
        found += _right(tooth, "model-set-right", "present state, set-up values corrected", prediction.before, None)
        found.append(_state("model-own", f"with {spoken().own} alone", "by the model", prediction.with_own))
    found += _predicted(prediction) if prediction is not None else []
    found += [_inspected("part", one.part, one.flank) for one in tooth.parts if one.flank and one.part not in ENDS]
    if after is not None:
        found.append(_inspected("after", "after", after))
    if tooth.from_gear is not None:
        asked = tooth.from_gear
        found.append(_state("predicted", FROM_GEAR, "predicted", asked.after, COVERAGE * asked.u_um))
    return tuple(found)


def shown(found: Sequence[FlankState]) -> tuple[FlankState, ...]:
    """The states drawn as maps: all but parts between before and after, unless there is nothing else."""
    between = any(one.key == "before" for one in found)
    return tuple(one for one in found if not between or one.key != "part")


def close_up(found: Sequence[FlankState]) -> tuple[FlankState, ...]:
    """The small ones, to be drawn again on a finer scale: predicted and after, beside a larger one."""
    small = tuple(one for one in found if one.key in ("predicted", "after"))
    return small if small and len(small) < len(found) and top_of(small) < 0.5 * top_of(found) else ()


def top_of(found: Sequence[FlankState]) -> float:
    """The one limit (um) of a scale on which these maps fit, rounded up to a plain number.

    As ground does not count where it stands beside the same flank with its set-up values right: they can be any size.
    """
    right = any(one.key == "before-set-right" for one in found)
    scaled = [one for one in found if one.key != "before" or not right]
    largest = max(float(np.max(np.abs(one.map.deviation_um))) for one in scaled)
    if largest <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(largest))
    return float(next(step for step in (*STEPS, 20.0) if step * power >= largest * (1.0 - 1e-12)) * power)


def before_after(tooth: ToothMaterial) -> tuple[float | None, float | None, float | None]:
    """RMS (um) before as ground, before with set-up values right, after: the verdict's, else the maps'.

    Without a part before, the model's own flank stands for it.
    """
    if tooth.verdict is not None:
        return tooth.verdict.before_um, tooth.verdict.before_set_right_um, tooth.verdict.after_um
    by = {one.key: one.rms for one in states(tooth)}
    ground, fair = by.get("before"), by.get("before-set-right")
    if ground is None:
        ground, fair = by.get("model-before"), by.get("model-set-right")
    return ground, fair, by.get("after")


def gain_pct(tooth: ToothMaterial) -> float | None:
    """Change of the RMS in percent, from before with its set-up values right (else as ground) to after."""
    ground, fair, after = before_after(tooth)
    start = fair if fair is not None else ground
    return None if start is None or after is None or start == 0.0 else 100.0 * (after - start) / start


@dataclass(frozen=True, slots=True)
class Traces:
    """Means of a map for small charts, um: profile (T,), lead (2, Z), pitch (2, K), runout (K,); left flank first.

    Pitch is each flank's mean in every space less its mean over all, runout the mean of both flanks likewise:
    normal deviations, + surplus.
    """

    profile: FloatArray
    lead: FloatArray
    pitch: FloatArray
    runout: FloatArray


def traces(flank: FlankMap) -> Traces:
    """The traces of a map with both flanks; a flank without points is NaN."""
    e = flank.deviation_um
    both = [e[:, side, :] for side in (flank.theta_rad > 0.0, flank.theta_rad < 0.0)]
    lead = np.stack([_mean(one, (0, 1)) for one in both])
    index = np.stack([_mean(one, (1, 2)) for one in both])
    pitch = index - np.mean(index, axis=1, keepdims=True)
    return Traces(np.mean(e, axis=(0, 2)), lead, pitch, np.mean(pitch, axis=0))


def _mean(values: FloatArray, axis: tuple[int, int]) -> FloatArray:
    if not values.size:
        return np.full([size for i, size in enumerate(values.shape) if i not in axis], np.nan)
    return np.asarray(np.mean(values, axis=axis))


def _inspected(key: str, title: str, flank: InspectedFlank) -> FlankState:
    return _state(key, title, "inspected", flank.fitted, COVERAGE * flank.rms_u_um)


def _right(tooth: ToothMaterial, key: str, title: str, flank: FlankMap, U: float | None) -> list[FlankState]:
    return [] if tooth.gear is None else [_state(key, title, "worked out", set_right(flank, tooth.gear), U)]


def _predicted(prediction: FlankPrediction) -> list[FlankState]:
    U = COVERAGE * prediction.rms_u_um
    found = _state("predicted", "with everything", "predicted", prediction.after, U)
    return [
        FlankState(
            key=found.key,
            title=found.title,
            source=found.source,
            map=found.map,
            rms=prediction.rms_um,
            largest=found.largest,
            U=U,
        )
    ]


def _state(key: str, title: str, source: Source, flank: FlankMap, U: float | None = None) -> FlankState:
    return FlankState(key=key, title=title, source=source, map=flank, rms=flank.rms_um, largest=flank.largest_um, U=U)
