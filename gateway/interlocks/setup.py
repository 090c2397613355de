"""Rules on handing set-up values to the builder's cycle: the right machine, at rest, with consent and an audit log."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from drivers.types.abilities import Capabilities
from drivers.types.identity import MachineIdentity
from drivers.types.machine import ChannelStatus, MachineState
from gateway.interlocks.facts import Refusal, refuse


class SetupRequest(Protocol):
    """Who hands over, and with whose consent, as far as the rules care."""

    @property
    def typed_name(self) -> str: ...
    @property
    def site_name(self) -> str: ...
    @property
    def machine(self) -> MachineIdentity: ...
    @property
    def audit_broken(self) -> str: ...
    @property
    def harmless_alarms(self) -> tuple[int, ...]: ...
    @property
    def risk_taken(self) -> bool: ...
    @property
    def approvals_needed(self) -> int | None: ...


def setup_refusals(
    request: SetupRequest, found: MachineIdentity, state: MachineState, can: Capabilities
) -> tuple[Refusal, ...]:
    """Every reason not to write numbers of the builder's cycle now, by catalogue code; pure."""
    return tuple(_rules(request, found, state, can))


def _rules(request: SetupRequest, found: MachineIdentity, state: MachineState, can: Capabilities) -> Iterator[Refusal]:
    if request.typed_name != request.site_name:
        yield from refuse("E-INT-NAME", typed=request.typed_name or "nothing", wanted=request.site_name)
    different = request.machine.differences(found)
    if different:
        wanted, told = (", ".join(str(getattr(one, name)) for name in different) for one in (request.machine, found))
        yield from refuse("E-INT-MACHINE", differ=", ".join(different), wanted=wanted, found=told)
    if found.unit_system != "metric":
        yield from refuse("E-INT-INCH", found=found.unit_system)
    if state.channel is not ChannelStatus.RESET:
        yield from refuse("E-INT-CHANNEL", found=state.channel.name.lower())
    active = [number for number in state.alarms if number not in request.harmless_alarms]
    if active:
        yield from refuse("E-INT-ALARM", alarms=", ".join(map(str, active)))
    if request.audit_broken:
        yield from refuse("E-INT-AUDIT-BROKEN", why=request.audit_broken)
    if can.unprotected and not request.risk_taken:
        yield from refuse("E-INT-RISK", road=can.unprotected)
    if (request.approvals_needed or 1) > 1:
        yield from refuse("E-HAND-PEOPLE", needed=request.approvals_needed)
