"""Whose certificate a control shows, and pinning it by its thumbprint: for the commands, the page and `init`."""

from __future__ import annotations

from pathlib import Path

from drivers import registry
from drivers.checks import TrustView
from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.ports.devices import Trust
from gateway import audit
from gateway.config import SiteFile, files_only
from gateway.workflow.runsite import store_of


async def shown_by(site: SiteFile, clock: Clock) -> TrustView:
    """What the site's control shows now beside what is pinned. Raises as `Trust.show`, ConfigError (E-CFG-DRIVER)."""
    return await _trust(site, clock).show(site.controller.timeout_s)


async def accepted(
    site: SiteFile, path: Path, thumbprint: str, *, who: str, clock: Clock, reason: str = ""
) -> TrustView:
    """Pin what the site's control shows now, if the typed thumbprint is its own. Raises as `Trust.accept`."""
    root, timeout_s = store_of(site, path).root, site.controller.timeout_s
    return await accept(_trust(site, clock), root, thumbprint, who, clock=clock, timeout_s=timeout_s, reason=reason)


async def accept(
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
