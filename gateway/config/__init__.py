"""Site file -> validated tree: the one place where configuration is read, judged, and described.

Everybody above may call `load_site`. Nothing here opens a device or a file other than the site file itself.
"""

from __future__ import annotations

from gateway.config.faults import Fault, SiteFaults
from gateway.config.loading import SiteReading, load_site, read_site
from gateway.config.reaching import open_road
from gateway.config.reference import schema
from gateway.config.sections import (
    AxisSection,
    ControllerSection,
    InstrumentSection,
    MeasureSection,
    OperatorTimes,
    Site,
    SiteFile,
    TableSection,
)
from gateway.config.service import MqttSection
from gateway.siteplan import AssumedSection, GuardSection, SetupSection, Targets, WorkingWindow, WorkSection

__all__ = [
    "AssumedSection",
    "AxisSection",
    "ControllerSection",
    "Fault",
    "GuardSection",
    "InstrumentSection",
    "MeasureSection",
    "MqttSection",
    "OperatorTimes",
    "SetupSection",
    "Site",
    "SiteFaults",
    "SiteFile",
    "SiteReading",
    "TableSection",
    "Targets",
    "WorkSection",
    "WorkingWindow",
    "load_site",
    "open_road",
    "read_site",
    "schema",
]
