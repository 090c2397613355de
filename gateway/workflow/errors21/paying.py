"""Which set-ups of a plan pay: those that answer most of what the proposal for the tooth may be wrong by; pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from gateway.config import SiteFile
from gateway.correct.outlook.flank_uncertainty import ALSO_SHOWN, OpenDoubt, ToothSpec, what_next
from gateway.evaluate.geometry.error_model import error_model
from gateway.workflow.errors21.components import grids
from gateway.workflow.errors21.setups import Planned, planned, spans

ENOUGH = 0.99
"""Of the mean square by which a proposal may be wrong before anything was measured."""


@dataclass(frozen=True, slots=True)
class Paying:
    """Set-ups of a plan by key, in its order, and what they are worth before anything is measured.

    ``of`` is how many the plan has, ``share`` (0 to 1) what part of the doubt about the proposal they answer,
    ``rest_um`` what the others could still change in it, RMS of the flank in um, at one standard uncertainty.
    """

    keys: tuple[str, ...]
    of: int
    share: float
    rest_um: float

    @property
    def told(self) -> dict[str, str]:
        """The figures for a text."""
        share = f"{100.0 * self.share:.1f}"
        return {"count": str(len(self.keys)), "of": str(self.of), "share": share, "rest": f"{self.rest_um:.1f}"}


def setups_that_pay(site: SiteFile, tooth: ToothSpec, share: float = ENOUGH) -> Paying:
    """The fewest set-ups of a site's plan that answer ``share`` of what is open, beside each axis' own positioning.

    The ranking is that of `what_next` with nothing measured: every error unknown within its assumed span. An axis' own
    positioning belongs to it whatever it is worth, for its table is judged on the axis. Raises what `what_next` raises.
    """
    plan = [one for one in planned(site) if one.measured]
    usual = site.assumed
    nothing = error_model((), spans(site), linear_um=usual.linear_um, angular_arcsec=usual.angular_arcsec)
    return paying(plan, what_next(nothing, tooth, grids(site)), share)


def paying(plan: Sequence[Planned], opened: Sequence[OpenDoubt], share: float = ENOUGH) -> Paying:
    """The same of a plan whose doubts are known: the error that answers most for each set-up comes first."""
    square = {one.name: one.change_um**2 for one in opened}
    total = sum(square.values())
    setups: dict[str, list[str]] = {}
    for one in plan:
        setups.setdefault(one.setup.name, []).append(one.key)
    taken = {one.setup.name for one in plan if one.positioning}
    while (left := _left(square, taken)) > (1.0 - share) * total:
        gains = {name: _each(name, setups, left, square, taken) for name in setups if name not in taken}
        best = max(gains, key=lambda name: gains[name], default="")
        if not best or gains[best] <= 0.0:
            break
        taken.add(best)
    keys = tuple(one.key for one in plan if one.setup.name in taken)
    left = _left(square, taken)
    return Paying(keys, len(plan), share=1.0 - left / total if total > 0.0 else 1.0, rest_um=float(left**0.5))


def _each(
    name: str, setups: Mapping[str, Sequence[str]], left: float, square: Mapping[str, float], taken: Collection[str]
) -> float:
    """What one more error takes from what is left, um squared for each of its set-ups."""
    return (left - _left(square, {*taken, name})) / len(setups[name])


def _left(square: Mapping[str, float], taken: Collection[str]) -> float:
    """The mean square (um squared) that is still open once these errors are measured."""
    shown = {*taken, *(other for name in taken for other in ALSO_SHOWN.get(name, ()))}
    return sum(size for name, size in square.items() if name not in shown)
