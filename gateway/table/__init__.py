"""Compensation tables: a fitted deviation merged with the live table, put on the controller's grid, judged."""

from gateway.table.comparison import diff, effective
from gateway.table.limits import check
from gateway.table.projection import Grid, project
from gateway.table.proposal import MeasuredMeans, propose

__all__ = [
    "Grid",
    "MeasuredMeans",
    "check",
    "diff",
    "effective",
    "project",
    "propose",
]
