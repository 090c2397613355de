"""The report as plain data: what the page shows and every number behind it, ready for JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from math import isfinite
from pathlib import PurePath

import numpy as np

from gateway.report.material import AxisMaterial, ReportMaterial
from gateway.report.parameters import parameter_rows
from gateway.report.tooth.data import summary, tooth_data

SCHEMA = "trueflank.report/1"


def as_json(material: ReportMaterial) -> dict[str, object]:
    """Whole report: ``schema``, ``summary``, the run, per axis parameters and records, ``tooth``; NaN becomes None."""
    own = ("axes", "tooth")
    run = {item.name: plain(getattr(material, item.name)) for item in fields(material) if item.name not in own}
    return {
        "schema": SCHEMA,
        "summary": plain(summary(material)),
        **run,
        "sign_convention": "deviation = measured - target",
        "axes": [_axis(axis) for axis in material.axes],
        "tooth": plain(tooth_data(material)),
    }


def _axis(axis: AxisMaterial) -> dict[str, object]:
    record = {item.name: plain(getattr(axis, item.name)) for item in fields(axis)}
    rows = parameter_rows(axis.axis, axis.before, axis.after)
    return {
        **record,
        "deviation_unit": axis.deviation_unit,
        "component": axis.component,
        "parameters": {row.parameter: plain(row) for row in rows},
    }


def plain(value: object) -> object:
    """Records, arrays and mappings as dicts, lists, numbers and text; what is not finite becomes None."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and np.isfinite(value).all():
        return value.tolist()  # most arrays: nothing in them needs a second look
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    return _scalar(value)


def _scalar(value: object) -> object:
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, Enum):
        return _scalar(value.value)
    return str(value) if isinstance(value, PurePath) else repr(value)
