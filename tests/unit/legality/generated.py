"""Short programs as they are sent: hosts for broken rules beside those written by hand."""

from __future__ import annotations

from drivers.sinumerik.ncprogram.backup import ReservedPoints
from drivers.sinumerik.ncprogram.grinding import GrindSetting, build_grinding_program
from drivers.sinumerik.ncprogram.measuring import MachineSetting, build_measuring_program
from drivers.sinumerik.ncprogram.pushing import build_push_program
from drivers.sinumerik.ncprogram.switching import build_disable_program
from drivers.sinumerik.ncprogram.words import Words
from drivers.types.orders import DisableOrder, PushOrder
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from drivers.workpiece import GrindAxis, GrindPlan

SETTING = MachineSetting(Words(), ReservedPoints(0, (), ("X1", "Z1")), modulo=False)
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
    build_measuring_program(_PLAN, 123456, SETTING),
    build_push_program(
        [
            (
                PushOrder(7, _TABLE, "Z", False, True, 0.0, "sign-proof"),
                MachineSetting(Words(), ReservedPoints(0, (0, 3)), modulo=False),
            )
        ]
    ),
    build_disable_program(DisableOrder(7, "axis", "X1", 0), SETTING),
    build_grinding_program(_PART, 123456, GrindSetting(Words(), {})),
)
