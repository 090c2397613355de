"""Which cross tables are worth loading together: all, or what is left when those that may do harm are taken out; pure.

One error that is hardly known would else take tables away that cure what is known well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gateway.correct.outlook.prediction import Outlook
from gateway.correct.plan.layers import LayeredCorrection
from gateway.correct.plan.plan import Plan

Worked = tuple[LayeredCorrection, Outlook]


@dataclass(frozen=True)
class Worthwhile:
    """What is proposed and its outlook; ``whole`` is the outlook of all the cross tables that the plan allowed.

    ``left_out`` names the tables (output first, as X(Z)) that were taken out because with them harm is too likely.
    """

    found: LayeredCorrection
    outlook: Outlook
    whole: Outlook
    left_out: tuple[str, ...] = ()

    @property
    def told(self) -> Outlook:
        """The outlook that says why cross tables are proposed, or why none is."""
        return self.outlook if self.found.optimum.tables else self.whole


def worthwhile(plan: Plan, work_out: Callable[[Plan], Worked]) -> Worthwhile:
    """The cross tables of the plan that are worth it together, one after the other taken out until they are.

    ``work_out`` gives correction and outlook of a plan. Of those that could go next, the one goes without which the
    rest is worth it and gains most; where none is so, the one without which harm is least likely.
    """
    found, outlook = work_out(plan)
    whole, cross = outlook, plan.cross
    while found.optimum.tables and not outlook.worth:
        acting = {table.grid.name for table in found.optimum.tables}
        rest = [tuple(one for one in cross if one != out) for out in cross if _name(out) in acting]
        tried = [(left, *work_out(replace(plan, cross=left))) for left in rest]
        cross, found, outlook = max(tried, key=lambda one: _rank(one[1], one[2]))
    gone = tuple(_name(one) for one in plan.cross if one not in cross)
    return Worthwhile(found, outlook, whole, gone if found.optimum.tables else ())


def _name(cross: tuple[str, str]) -> str:
    return f"{cross[0]}({cross[1]})"


def _rank(found: LayeredCorrection, outlook: Outlook) -> tuple[bool, float]:
    worth = bool(found.optimum.tables) and outlook.worth
    return worth, outlook.gain_um if worth else -outlook.worse
