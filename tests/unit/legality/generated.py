"""Short programs as they are sent: hosts for broken rules beside those written by hand."""

from __future__ import annotations

from drivers.sinumerik.ncprogram.backup import Memory
from drivers.sinumerik.ncprogram.disabling import disabling
from drivers.sinumerik.ncprogram.grinding import GrindSetting, grinding
from drivers.sinumerik.ncprogram.measuring import Setting, measuring
from drivers.sinumerik.ncprogram.pushing import pushing
from drivers.sinumerik.ncprogram.words import Words
from drivers.types.orders import DisableOrder, PushOrder
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from drivers.workpiece import GrindAxis, GrindPlan

SETTING = Setting(Words(), Memory(0, (), ("X1", "Z1")), modulo=False)
_PLAN = StopPlan("TFMEAS", "X1", "X", "mm", False, (Stop(5.0, 1),), 500.0, 2.0, 0.1, "TRUEFLANK SETUP EXX ON X")
_TABLE = CompensationTable("cross", "Z1", "X1", 0.0, 20.0, 10.0, (0.0, 1.0, 0.0), index=1)
_PART = GrindPlan(
    "TFGRIND_C1",
    "PART",
    GrindAxis("X1", "X", (-420.0, 20.0)),
    GrindAxis("Z1", "Z", (-10.0, 320.0)),
    GrindAxis("C1", "C"),
    None,
    4,
    160.0,
    150.0,
    10.0,
    59.7,
    62.3,
    0.25,
    save_tables=False,
)
GENERATED = (
    measuring(_PLAN, 123456, SETTING),
    pushing(
        [(PushOrder(7, _TABLE, "Z", False, True, 0.0, "sign-proof"), Setting(Words(), Memory(0, (0, 3)), modulo=False))]
    ),
    disabling(DisableOrder(7, "axis", "X1", 0), SETTING),
    grinding(_PART, 123456, GrindSetting(Words(), {})),
)
