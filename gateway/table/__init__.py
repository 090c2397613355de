"""Compensation tables: a fitted deviation merged with the live table, put on the controller's grid, judged."""

from gateway.table.comparison import effective
from gateway.table.limits import check
from gateway.table.merging import Grid, project
from gateway.table.proposal import MeasuredMeans, propose

__all__ = [
    "Grid",
    "MeasuredMeans",
    "check",
    "effective",
    "project",
    "propose",
]
