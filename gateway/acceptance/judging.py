"""Runs one check within an allowance and says how it ended."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.errors import TrueflankError
from drivers.probes import Allowance, allows
from gateway.acceptance.checks import CHECKS, AcceptanceCheck
from gateway.acceptance.results import CheckResult, Outcome, seen
from gateway.acceptance.working import NotHere, SiteDesk
from gateway.config import SiteFile


def cases(site: SiteFile) -> Iterator[tuple[AcceptanceCheck, str]]:
    """Every check with the axis it is made for ("" for the site as a whole), in order."""
    for check in CHECKS:
        for axis in (axis.name for axis in site.axes) if check.each else ("",):
            yield check, axis


def case_name(check: AcceptanceCheck, axis: str) -> str:
    """As people read it: "limits X1"."""
    return f"{check.name} {axis}".strip()


async def run_check(check: AcceptanceCheck, axis: str, desk: SiteDesk, allow: Allowance) -> CheckResult:
    """One check; what lies above the allowance is skipped and said. Only our own errors are results."""
    outcome: Outcome = "passed"
    if not allows(allow, check.allow):
        outcome, line = "skipped", seen("above", needed=check.allow, given=allow)
    else:
        try:
            line = await check.work(desk, axis)
        except NotHere as reason:
            outcome, line = "skipped", reason.why
        except TrueflankError as error:
            outcome, line = "failed", seen("wrong", error=str(error))
    return CheckResult(check.name, axis, check.allow, outcome=outcome, seen=line)
