"""What must be said of a proposal for the tooth: what was left alone, what cannot be cured, which unknowns matter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from drivers.errors import words
from gateway.correct.outlook.next_setup import THRESHOLD_UM
from gateway.correct.outlook.prediction import Outlook
from gateway.correct.outlook.too_coarse import Dominant
from gateway.correct.outlook.worthwhile import Worthwhile
from gateway.correct.plan.layers import LayeredCorrection
from gateway.domain.values import COVERAGE
from gateway.model.known import ErrorModel
from gateway.tooth import CureRecord, DriveDoubt, DriveForecast, DriveProposal, ToothProposal, next_for_drive


def told(
    tooth: ToothProposal, model: ErrorModel, found: LayeredCorrection, gains: Outlook, left_alone: Sequence[str]
) -> tuple[str, ...]:
    """What people need, in words.

    ``gains`` is the outlook of the cross tables, proposed or not, ``left_alone`` what was said before.
    """
    return (*left_alone, *_gain(found, gains), *_mechanical(tooth), *_unknown(tooth, model), *_work(tooth))


def explained(tooth: ToothProposal, model: ErrorModel, found: LayeredCorrection) -> tuple[str, ...]:
    """What explains the proposal and asks nothing of anybody, in words."""
    said = [*found.said]
    if not _beyond(tooth):
        said.append(words("S-TOOTH-ALL-CURED", limit=f"{THRESHOLD_UM:g}"))
    said.append(words("S-TOOTH-B-LEFT", share=f"{100.0 * tooth.b_left:.0f}"))
    sizes = _sizes(tooth, model)
    if sizes and max(sizes.values()) <= THRESHOLD_UM:
        said.append(words("S-TOOTH-UNKNOWN-NONE", count=len(sizes), limit=f"{THRESHOLD_UM:g}"))
    return tuple(said)


def drive_told(drive: DriveProposal | None) -> tuple[str, ...]:
    """What drives the corrected machine will make, what each goal costs, and the verdicts on their limits, in words."""
    if drive is None:
        return ()
    figures = {
        "transmission": f"{drive.transmission_arcsec:.1f}",
        "u": f"{drive.transmission_u_arcsec:.1f}",
        "lost": f"{drive.lost_motion_arcsec:.0f}",
        "lost_u": f"{drive.lost_motion_u_arcsec:.0f}",
    }
    said = [words("S-TOOTH-DRIVE", name=drive.reducer, datum=drive.datum, **figures)]
    for row in drive.rows:
        sizes = {"flank": f"{row.flank_um:.2f}", "transmission": f"{row.transmission_arcsec:.1f}"}
        said.append(words("S-TOOTH-GOAL", name=row.name, lost=f"{row.lost_motion_arcsec:.0f}", **sizes))
    for one in drive.limits:
        value, limit = f"{one.value_arcsec:.1f} +- {one.U_arcsec:.1f}", f"{one.limit_arcsec:g}"
        said.append(words("S-TOOTH-DRIVE-LIMIT", name=one.name, value=value, limit=limit, verdict=one.verdict))
    return (*said, *measure_for_drive(drive.doubts))


def forecast_told(drive: DriveForecast | None) -> tuple[str, ...]:
    """What drives the machine makes before and after its tables, and what to measure for them, in words."""
    if drive is None:
        return ()
    said = [words("S-DAY-DRIVE", name=drive.reducer, datum=drive.datum)]
    for row in drive.rows:
        sizes = {"flank": f"{row.flank_um:.2f}", "transmission": f"{row.transmission_arcsec:.1f}"}
        said.append(words("S-TOOTH-GOAL", name=row.name, lost=f"{row.lost_motion_arcsec:.0f}", **sizes))
    return (*said, *measure_for_drive(drive.doubts))


def measure_for_drive(doubts: Sequence[DriveDoubt]) -> tuple[str, ...]:
    """The unmeasured error that costs most in the drive, in words; nothing where none is worth it."""
    one = next_for_drive(doubts)
    return () if one is None else (words("S-DRIVE-NEXT", name=one.error, cost=f"{one.cost_arcsec:.1f}"),)


def measure_better(worst: Dominant | None) -> tuple[str, ...]:
    """Which measured error makes most of the doubt, and where to measure it at which step; nothing where none does."""
    if worst is None:
        return ()
    sizes = {"name": worst.name, "part": f"{worst.part_um:.2f}", "u": f"{worst.u_um:.2f}"}
    if worst.window is None:
        return (words("S-TOOTH-DOMINANT", **sizes),)
    at = worst.window
    places = {"first": f"{at.first:.1f}", "last": f"{at.last:.1f}", "step": f"{at.step:.3g}", "unit": at.unit}
    return (words("S-TOOTH-COARSE", **sizes, **places, left=f"{at.left_um:.2f}"),)


def doubted(chosen: Worthwhile) -> tuple[str, ...]:
    """Which cross tables stay away because the flank may get worse with them, in words."""
    whole = chosen.whole
    figures = {"gain": f"{whole.gain_um:.2f}", "U": f"{COVERAGE * whole.gain_u_um:.2f}"}
    worse = f"{100.0 * whole.worse:.0f}"
    names = ", ".join(chosen.left_out)
    return (words("S-TOOTH-DOUBTED", names=names, worse=worse, **figures),) if names else ()


def _gain(found: LayeredCorrection, gains: Outlook) -> Iterator[str]:
    figures = {"gain": f"{gains.gain_um:.2f}", "U": f"{COVERAGE * gains.gain_u_um:.2f}"}
    if found.optimum.tables:
        yield words("S-TOOTH-GAIN", **figures)
    elif not gains.worth:
        yield words("S-TOOTH-NO-GAIN", **figures)


def _mechanical(tooth: ToothProposal) -> Iterator[str]:
    for one in _beyond(tooth):
        yield words("S-TOOTH-MECHANICAL", name=one.error, rms=f"{one.rms_um:.2f}", left=f"{one.floor_um:.2f}")


def _beyond(tooth: ToothProposal) -> list[CureRecord]:
    return [one for one in tooth.cures if one.floor_um > THRESHOLD_UM]


def _unknown(tooth: ToothProposal, model: ErrorModel) -> Iterator[str]:
    for name, size in sorted(_sizes(tooth, model).items(), key=lambda item: -item[1]):
        if size > THRESHOLD_UM:
            yield words("S-TOOTH-UNKNOWN", name=name, u=f"{size:.2f}")


def _sizes(tooth: ToothProposal, model: ErrorModel) -> dict[str, float]:
    """What each error that was not measured may do to the flank, um (RMS)."""
    return {one.name: tooth.prediction.parts_um.get(one.name, 0.0) for one in model.unknown}


def _work(tooth: ToothProposal) -> Iterator[str]:
    (x, y), (a, b) = tooth.eccentricity_um, tooth.tilt_arcsec
    if x or y or a or b:
        yield words("S-TOOTH-MOUNTING", x=f"{x:+.1f}", y=f"{y:+.1f}", a=f"{a:+.1f}", b=f"{b:+.1f}")
