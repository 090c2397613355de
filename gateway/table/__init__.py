"""Compensation tables: a fitted deviation merged with the live table, put on the controller's grid, judged."""

from gateway.table.comparison import agreeing_position, diff, effective
from gateway.table.limits import Limits, check
from gateway.table.projection import Grid, project
from gateway.table.proposal import Measured, TableAxis, propose

__all__ = [
    "Grid",
    "Limits",
    "Measured",
    "TableAxis",
    "agreeing_position",
    "check",
    "diff",
    "effective",
    "project",
    "propose",
]
