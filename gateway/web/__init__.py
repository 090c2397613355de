"""The service's routes: who may, what is read, what is commanded, the live stream, and a plain status page."""

from __future__ import annotations

from gateway.web.app import API_VERSION, create_app
from gateway.web.ports import Doorkeeping, Making, ServedSite, Service, SiteMaking, Work

__all__ = [
    "API_VERSION",
    "Doorkeeping",
    "Making",
    "ServedSite",
    "Service",
    "SiteMaking",
    "Work",
    "create_app",
]
