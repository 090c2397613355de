"""The gateway as a service: devices opened and watched, pages and stream served, one command at a time a site."""

from __future__ import annotations

from gateway.daemon.job_runner import Devices, LazyDevices, RunStarter
from gateway.daemon.service import serve, serve_setup, service_of
from gateway.daemon.service_manager import JournalForm
from gateway.daemon.site_service import DailyComparison, ServiceParts, SiteService

__all__ = [
    "DailyComparison",
    "Devices",
    "JournalForm",
    "LazyDevices",
    "RunStarter",
    "ServiceParts",
    "SiteService",
    "serve",
    "serve_setup",
    "service_of",
]
