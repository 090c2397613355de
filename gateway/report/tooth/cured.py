"""What was cured by what: the flank's mean square by pattern, and how much of each the correction takes; pure.

Any move of the infeed X shows alike on both flanks of a space (n_x), any turn of C oppositely (h). So the even part of
a map over the profile is what X can touch and the odd part what C and the dressing can; what depends on the height
alone belongs to a table over Z, on the space alone to one over C, constants to the set-up values. The parts are
orthogonal: their mean squares add up to that of the flank.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.message import words
from drivers.terms import spoken
from drivers.types.values import FloatArray
from gateway.tooth import FlankPrediction

EVEN, ODD = "even", "odd"
CONSTANT = ("set-up values: x zero", "set-up values: dressing offset")
SAME = 1e-9  # rad: how symmetric the profile's points must lie


@dataclass(frozen=True, slots=True)
class Share:
    """One cure: part of the flank's mean square that it takes, in percent (negative: it adds), and what is left.

    ``of_right_pct`` is what it takes of the flank with its set-up values right: they take none of that themselves.
    """

    by: str
    taken_pct: float
    left_pct: float | None = None
    of_right_pct: float | None = None


def shares(prediction: FlankPrediction) -> tuple[Share, ...]:
    """What axis tables, set-up values and each cross table take; all in percent of the flank before, and all together.

    Constants are the set-up values' affair, also where axis tables move them; by pattern cross tables take what those
    leave. ``left_pct`` is what stays of the pattern. The last row is what no table over one axis can touch. Nothing
    where the flank before is zero; without symmetric points only axis tables against the rest.
    """
    whole = _square(prediction.before.deviation_um)
    if whole <= 0.0:
        return ()
    left, after = prediction.with_own.deviation_um, prediction.after.deviation_um
    theta = prediction.before.theta_rad
    if not np.allclose(theta, -theta[::-1], rtol=0.0, atol=SAME):
        rest = _square(left), _square(after)
        own = Share(own_layer(), 100.0 * (whole - rest[0]) / whole)
        return own, Share(
            words("S-CURED-CROSS-SETUP", cross=spoken().cross),
            100.0 * (rest[0] - rest[1]) / whole,
            100.0 * rest[1] / whole,
        )
    start, middle, end = (patterns(one) for one in (prediction.before.deviation_um, left, after))
    moved = sum(start[name] - middle[name] for name in start if name not in CONSTANT)
    right = whole - sum(start[name] for name in CONSTANT)
    found = [Share(own_layer(), 100.0 * moved / whole, of_right_pct=_percent(moved, right))]
    for name in start:
        first = start[name] if name in CONSTANT else middle[name]
        of_right = None if name in CONSTANT else _percent(first - end[name], right)
        found.append(Share(name, 100.0 * (first - end[name]) / whole, 100.0 * end[name] / whole, of_right))
    return tuple(found)


def _percent(part: float, whole: float) -> float | None:
    return 100.0 * part / whole if whole > 0.0 else None


def own_layer() -> str:
    """Who takes the axes' own deviations, in words."""
    return words("S-CURED-OWN", own=spoken().own)


def patterns(deviation_um: FloatArray) -> dict[str, float]:
    """Mean square (um2) of each pattern of a map (K, T, Z) whose T points lie symmetric about the space's bottom."""
    mirrored = deviation_um[:, ::-1, :]
    found = {key: _by_place(0.5 * (deviation_um + sign * mirrored)) for key, sign in ((EVEN, 1.0), (ODD, -1.0))}
    return {
        CONSTANT[0]: found[EVEN]["constant"],
        CONSTANT[1]: found[ODD]["constant"],
        "table X(Z)": found[EVEN]["z"],
        "table X(C)": found[EVEN]["k"],
        "table C(Z)": found[ODD]["z"],
        "table C(C)": found[ODD]["k"],
        words("S-CURED-NO-TABLE"): found[EVEN]["rest"] + found[ODD]["rest"],
    }


def _by_place(e: FloatArray) -> dict[str, float]:
    """Mean squares of the profile's constant, and of what varies with z alone, with k alone, with both."""
    constant = np.mean(e, axis=(0, 2), keepdims=True)
    over_z = np.mean(e, axis=0, keepdims=True) - constant
    over_k = np.mean(e, axis=2, keepdims=True) - constant
    rest = e - constant - over_z - over_k
    parts = {"constant": constant, "z": over_z, "k": over_k, "rest": rest}
    return {key: _square(part) for key, part in parts.items()}


def _square(values: FloatArray) -> float:
    return float(np.mean(values**2))
