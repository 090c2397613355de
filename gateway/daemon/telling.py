"""What a served site tells other systems: its way out by MQTT where the site file names one, and a run's figures."""

from __future__ import annotations

import hashlib
from contextlib import AbstractAsyncContextManager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from gateway.config import SiteFile
from gateway.errors import StoreError
from gateway.index import figures_of, gateway_name
from gateway.mqtt import Publish, Publisher, Spool
from gateway.store import Store

MB = 1 << 20


def publisher_of(site: SiteFile, path: Path, store: Store, clock: Clock) -> Publisher | None:
    """The way out of a site; None where it names no server. Raises StoreError (E-MQTT-QUEUE)."""
    section = site.service.mqtt
    if section is None:
        return None
    from gateway.mqtt.connecting import connected  # noqa: PLC0415 - its library only where a site wants it

    name = site.site.name
    spool = Spool(store.root / "service" / f"mqtt-{name}", section.queue_mb * MB)
    ident = hashlib.sha256(gateway_name(store.root).encode("utf-8")).hexdigest()[:8]

    def connect() -> AbstractAsyncContextManager[Publish]:
        return connected(section, path.parent, f"trueflank-{name}-{ident}", will=found.will, clock=clock)

    found = Publisher(name, section.prefix, spool, clock=clock, connect=connect)
    return found


def figures_told(store: Store, run_id: str) -> dict[str, Any]:
    """E, R, B, A, M of each axis and the flank's, before and after, as a run that has ended holds them."""
    told: dict[str, Any] = {"run_id": run_id, "serial": "", "figures": []}
    try:
        folder = store.open(run_id)
        found, serial = [asdict(one) for one in figures_of("", folder)], folder.summary().machine
    except StoreError:
        return told  # the run's own pages say what is damaged
    wanted = ("subject", "phase", "parameter", "value", "expanded", "unit")
    figures = [{key: one[key] for key in wanted} for one in found]
    return told | {"serial": serial, "figures": figures}
