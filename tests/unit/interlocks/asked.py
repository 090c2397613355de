"""Who asks for a push, without a machine to push to; and facts with anything of them changed by its plain name."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from drivers.limits import ACCESS_LEVEL
from drivers.programs import SelfTested
from drivers.sinumerik.tablefile.tables import HELD_KINDS
from drivers.types.abilities import Capabilities
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from drivers.types.uptime import Uptime
from gateway.axes import AxisRecord
from gateway.domain.captures import Capture
from gateway.domain.proposals import Approval
from gateway.interlocks.facts import MarkerCheck, PushFacts

CAN = Capabilities(stops=True, tables=HELD_KINDS, switched="at-stop", marker=True, consent="start")
MARKS = {"marker_ours": "ours", "behind": "behind", "mark_lost": "lost", "stranger": "stranger"}


@dataclass(frozen=True, slots=True)
class Asked:
    """A request as the rules see it."""

    machine: MachineIdentity
    input_axis: AxisRecord
    typed_name: str = "mill"
    site_name: str = "mill"
    proof: SignProof | None = None
    capture: Capture | None = None
    self_test: SelfTested | None = None
    ambient_now: Ambient | None = None
    modes: tuple[str, ...] = ("AUTO",)
    harmless_alarms: tuple[int, ...] = ()
    access_level_needed: int = ACCESS_LEVEL
    actor: str = ""
    approvals: tuple[Approval, ...] = ()
    approvals_needed: int | None = None
    audit_broken: str = ""
    is_proposed: bool = True
    used_approvals: tuple[Approval, ...] = ()
    unrecorded_approvals: tuple[Approval, ...] = ()
    unsigned_approvals: tuple[Approval, ...] = ()
    run_id: str = ""
    overtaken_approvals: tuple[Approval, ...] = ()
    consent_utc: datetime | None = None
    consent_uptime: Uptime | None = None
    alarms: tuple[str, ...] = ()
    risk_taken: bool = False


def replace(one: Any, /, **values: Any) -> Any:
    """As `dataclasses.replace`; of facts also what their request and mark hold."""
    if not isinstance(one, PushFacts):
        return dataclasses.replace(one, **values)
    marks = {MARKS[name]: values.pop(name) for name in tuple(values) if name in MARKS}
    known = {item.name for item in dataclasses.fields(Asked)}
    asked = {name: values.pop(name) for name in tuple(values) if name in known}
    if "reference" in values:
        asked["input_axis"] = dataclasses.replace(one.request.input_axis, reference=values.pop("reference"))
    if "expected" in values:
        asked["machine"] = values.pop("expected")
    if "marker_kept" in values:
        values["can"] = dataclasses.replace(one.can, marker=values.pop("marker_kept"))
    if "unprotected" in values:
        values["can"] = dataclasses.replace(one.can, unprotected=values.pop("unprotected"))
    if "self_tests" in values:
        values["can"] = dataclasses.replace(one.can, self_test=values.pop("self_tests"))
    request: Any = one.request
    mark: MarkerCheck = dataclasses.replace(one.mark, **marks)
    return dataclasses.replace(one, request=dataclasses.replace(request, **asked), mark=mark, **values)
