"""Site file -> validated tree: the one place where configuration is read, judged, and described.

Everybody above may call `load_site`. Nothing here opens a device or a file other than the site file itself.
"""

from __future__ import annotations

from gateway.config.faults import Fault, SiteFaults
from gateway.config.loading import SiteReading, load_site, read_site
from gateway.config.reaching import excused_certificate, files_only, one_start, open_road, plans_together
from gateway.config.reference import schema
from gateway.config.rules import unchecked_feed
from gateway.config.sections import (
    AxisSection,
    ControllerSection,
    InstrumentSection,
    MeasureSection,
    Site,
    SiteFile,
    TableSection,
)
from gateway.config.service import MqttSection
from gateway.siteplan import (
    AssumedSection,
    DayTimes,
    GuardSection,
    OperatorTimes,
    SetupSection,
    Targets,
    WorkingWindow,
    WorkSection,
)

__all__ = [
    "AssumedSection",
    "AxisSection",
    "ControllerSection",
    "DayTimes",
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
    "excused_certificate",
    "files_only",
    "load_site",
    "one_start",
    "open_road",
    "plans_together",
    "read_site",
    "schema",
    "unchecked_feed",
]
