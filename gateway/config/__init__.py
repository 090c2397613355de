"""Site file -> validated tree: the one place where configuration is read, judged, and described.

Everybody above may call `load_site`. Nothing here opens a device or a file other than the site file itself. Inside,
`loading` asks `site_rules` > `axis_rules` > `connections` > `rules` > `model_faults` > `faults`; `sections` are the
models, and `reference` describes them and writes a site file for people.
"""

from __future__ import annotations

from gateway.config.connections import (
    address_of,
    by_files,
    excused_certificate,
    files_only,
    one_start,
    plans_together,
    typed_rotary,
    unprotected_connection,
)
from gateway.config.faults import Fault, SiteFaults, place_name, value_at
from gateway.config.loading import SiteReading, load_site, read_site, with_absolute_paths, with_positions
from gateway.config.model_faults import broken_rule
from gateway.config.reference import page, schema, site_text, toml_value
from gateway.config.rules import bounds, unchecked_feed
from gateway.config.sections import (
    AxisSection,
    CaptureConditionsSection,
    ControllerSection,
    EquipmentSection,
    GearToleranceSection,
    InstrumentSection,
    MeasureSection,
    MqttSection,
    ServiceSection,
    Site,
    SiteFile,
    TableSection,
    ToleranceSection,
)
from gateway.config.site_rules import R_PARAMETER
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
    "R_PARAMETER",
    "AssumedSection",
    "AxisSection",
    "CaptureConditionsSection",
    "ControllerSection",
    "DayTimes",
    "EquipmentSection",
    "Fault",
    "GearToleranceSection",
    "GuardSection",
    "InstrumentSection",
    "MeasureSection",
    "MqttSection",
    "OperatorTimes",
    "ServiceSection",
    "SetupSection",
    "Site",
    "SiteFaults",
    "SiteFile",
    "SiteReading",
    "TableSection",
    "Targets",
    "ToleranceSection",
    "WorkSection",
    "WorkingWindow",
    "address_of",
    "bounds",
    "broken_rule",
    "by_files",
    "excused_certificate",
    "files_only",
    "load_site",
    "one_start",
    "page",
    "place_name",
    "plans_together",
    "read_site",
    "schema",
    "site_text",
    "toml_value",
    "typed_rotary",
    "unchecked_feed",
    "unprotected_connection",
    "value_at",
    "with_absolute_paths",
    "with_positions",
]
