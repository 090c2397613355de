"""Who is there: the facts of the machine against those known, and the control's certificate; what a person accepts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from drivers import registry
from drivers.checks import TrustView
from drivers.clock import Clock
from drivers.errors import ConfigError, UnsupportedDevice
from drivers.ports.devices import Trust
from drivers.types.identity import FACTS, Likeness, MachineIdentity, likeness
from gateway import audit
from gateway.config import SiteFile, files_only
from gateway.domain.identity import KnownFact, KnownMachine
from gateway.store import Store
from gateway.store.machine_books import IdentityBook
from gateway.supervisor import Supervisor, refusal_of
from gateway.workflow.run.folder import known_of, store_of

ASKED = "E-SUP-IDENTITY"
"""The refusal that a person may answer: one fact is another, all others agree."""


class IdentityCheck:
    """A `gateway.supervisor.Recognise` that knows what was accepted, and keeps facts that are read first.

    ``first`` are those that were kept now, ``accepted`` the changes that were accepted before.
    """

    def __init__(self, site: SiteFile, path: Path, root: Path, clock: Clock, *, keeps: bool = True) -> None:
        self._site, self._path, self._root = site, path, root
        self._clock, self._keeps = clock, keeps
        self.first: tuple[KnownFact, ...] = ()
        self.accepted: tuple[KnownFact, ...] = ()

    def __call__(self, machine: MachineIdentity) -> None:
        """Refuse a machine that is not the one known. Raises as `refusal_of` and `known_of`, StoreError."""
        known = known_of(self._site, self._root)
        found = likeness(known.facts, machine)
        self.accepted = known.accepted
        if not found.is_known:
            raise refusal_of(found, str(self._path))
        if self._keeps:
            new = {fact: value for fact, value in machine.facts.items() if fact not in known.facts}
            self.first = store_identity(self._site, self._root, self._clock, new)


def store_identity(site: SiteFile, root: Path, clock: Clock, facts: Mapping[str, str]) -> tuple[KnownFact, ...]:
    """Facts that were read for the first time. Raises StoreError."""
    utc = _utc(clock)
    return tuple(_identity_book(site, root, fact=fact, value=value, utc=utc) for fact, value in facts.items())


def _identity_book(site: SiteFile, root: Path, **given: str) -> KnownFact:
    book, serial = IdentityBook(root), site.controller.serial
    number = 1 + max((one.number for one in book.all(serial)), default=0)
    told = KnownFact(number=number, serial=serial, **given)
    book.keep(told)
    return told


def _utc(clock: Clock) -> str:
    return clock.utc().isoformat(timespec="seconds")


async def read_identity(site: SiteFile, root: Path, clock: Clock) -> tuple[MachineIdentity, Likeness, KnownMachine]:
    """Open the control alone and read who it is; nothing is kept. Raises DevicesFailed, and as `known_of`."""
    supervisor = Supervisor(site, clock, only=())
    try:
        machine = await supervisor.identified()
    finally:
        await supervisor.close_all()
    known = known_of(site, root)
    return machine, likeness(known.facts, machine), known


async def accept_identity(
    site: SiteFile, path: Path, store: Store, texts: Sequence[str], *, who: str, clock: Clock
) -> KnownFact:
    """Accept that one fact is another now, as FACT=REASON says; kept and audited.

    Raises ConfigError (E-IDENTITY-ACCEPT: no such fact or no reason; E-IDENTITY-SAME: that fact is as it was),
    UnsupportedDevice (E-SUP-MACHINE: more than one is another), StoreError.
    """
    fact, reason = parse_answer(texts)
    audit.require_sound(store.root)
    _machine, found, _known = await read_identity(site, store.root, clock)
    change = next((one for one in found.changed if one.fact == fact), None)
    if change is None:
        raise ConfigError("E-IDENTITY-SAME", site.site.name, fact=fact, same=", ".join(found.same) or "-")
    if not found.is_asked:
        raise refusal_of(found, str(path))
    details = {"fact": fact, "was": change.was, "now": change.now, "reason": reason}
    audit.record(store.root, "identity-accept", clock=clock, actor=who, serial=site.controller.serial, details=details)
    told = {"fact": fact, "value": change.now, "was": change.was}
    return _identity_book(site, store.root, **told, who=who, reason=reason, utc=_utc(clock))


def parse_answer(texts: Sequence[str]) -> tuple[str, str]:
    """The fact and the reason of ``FACT=REASON``, once. Raises ConfigError (E-IDENTITY-ACCEPT)."""
    parted = [text.partition("=") for text in texts]
    found = [(fact.strip(), reason.strip()) for fact, _, reason in parted]
    if len(found) != 1 or found[0][0] not in FACTS or not found[0][1]:
        raise ConfigError("E-IDENTITY-ACCEPT", "--accept-identity", text=" ".join(texts), facts=", ".join(FACTS))
    return found[0]


def is_asked(error: BaseException) -> bool:
    """Whether a person may answer this refusal."""
    return isinstance(error, UnsupportedDevice) and error.code == ASKED


# Whose certificate a control shows, and pinning it by its thumbprint: for the commands, the page and `init`.


async def shown_certificate(site: SiteFile, clock: Clock) -> TrustView:
    """What the site's control shows now beside what is pinned. Raises as `Trust.show`, ConfigError (E-CFG-DRIVER)."""
    return await _trust(site, clock).show(site.controller.timeout_s)


async def accept_certificate(
    site: SiteFile, path: Path, thumbprint: str, *, who: str, clock: Clock, reason: str = ""
) -> TrustView:
    """Pin what the site's control shows now, if the typed thumbprint is its own. Raises as `Trust.accept`."""
    root, timeout_s = store_of(site, path).root, site.controller.timeout_s
    return await pin_certificate(
        _trust(site, clock), root, thumbprint, who, clock=clock, timeout_s=timeout_s, reason=reason
    )


async def pin_certificate(
    trust: Trust, root: Path, thumbprint: str, who: str, *, clock: Clock, timeout_s: float, reason: str = ""
) -> TrustView:
    """Pin by a thumbprint, with the reason for one that is not valid now; kept in the audit log at ``root``.

    Raises as `Trust.accept`, StoreError.
    """
    audit.require_sound(root)
    view = await trust.accept(thumbprint, who, timeout_s, reason)
    told = {"url": view.url, "sha256": view.shown.sha256, "subject": view.shown.subject}
    told |= {"reason": view.reason} if view.reason else {}
    audit.record(root, "trust-accept", clock=clock, actor=who, role="service", details=told)
    return view


def _trust(site: SiteFile, clock: Clock) -> Trust:
    control = site.controller
    if files_only(site):
        raise ConfigError("E-FILES-ONLY", site.site.name)
    made = registry.load(f"{control.driver}-trust", "trust")
    found: Trust = made(site.site.name, control.url, control.settings, clock)
    return found
