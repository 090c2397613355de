"""TwinCAT CNC and the ISG kernel: the compensation value list of an axis (TF5200, "Axis compensation").

Described on Beckhoff's pages 113419147 (kw.ssfk.*, leadscrew), 113439115 (its worked example), 113377675, 113382283,
113389963 (kw.crosscomp.*, cross). A key, spaces, a value; comments begin with #. Lengths 0.1 um, angles 0.0001 deg.

Leadscrew: the value is the absolute position error, actual - programmed: the example's 19866.7 um that became
19856.5 um stands as -102. So value = +deviation. Cross: no page says which way a correction acts; the file says so.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from drivers.errors import FileFormatError, TableError
from drivers.exchange.lines import comment, content, curves_of, number, own_table, rising
from drivers.message import Message
from drivers.types.exchange import ReadAs
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import AxisUnit, arcsec_to_deg, deg_to_arcsec, mm_to_um, um_to_mm

STEPS_PER_MM, STEPS_PER_DEG = 10_000.0, 10_000.0  # 0.1 um, 0.0001 deg
MOST_OWN, MOST_CROSS = 1500, 1001  # P-COMP-00059, P-COMP-00060: what a list may hold unless it is told otherwise
_POINT = re.compile(r"kw\.(ssfk|crosscomp)\.table\[(\d{1,5})\]\.(setpoint|pos|neg|correction)\Z", re.ASCII)
SIGN_COMMENT = "sign of cross corrections not settled in public: value = +deviation here; prove it on the machine"


class TwinCatList:
    """Axis lists (implements ports.TableExchange); form "whole" (integers, every build) or "real" (V3.1.3132 on)."""

    suffix = ".lis"
    forms = ("whole", "real")

    def text(self, tables: Sequence[CompensationTable], form: str, comments: Sequence[str]) -> str:
        """The list of one output axis: its own table, a cross table, or both.

        Raises TableError (E-EXCHANGE-ONE, E-EXCHANGE-ROWS, E-EXCHANGE-DIRECTION).
        """
        own = [table for table in tables if table.kind == "axis"]
        cross = [table for table in tables if table.kind == "cross"]
        axes = {table.output_axis for table in tables}
        if len(axes) != 1 or len(own) > 1 or len(cross) > 1:
            raise TableError("E-EXCHANGE-ONE", "twincat", found=", ".join(table.name for table in tables) or "nothing")
        said = ["compensation value list, TF5200; lengths 0.1 um, angles 0.0001 deg", *comments]
        said += ["leadscrew: value = +deviation (actual - programmed)"] * bool(own) + [SIGN_COMMENT] * bool(cross)
        lines = [*(f"# {comment(line)}" for line in said), f"kopf.log_achs_name {axes.pop()}"]
        for table in own:
            lines += _own_lines(table, form)
        for table in cross:
            lines += _cross_lines(table, form)
        return "\n".join(lines) + "\n"

    def read(self, text: str, where: str, known: ReadAs) -> tuple[CompensationTable, ...]:
        """The tables of a list. Raises FileFormatError (E-EXCHANGE-...), for increments too: they need the encoder."""
        head, points = _parsed(text, where)
        found = []
        if points["ssfk"]:
            found.append(_own(head, points["ssfk"], where, known))
        if points["crosscomp"]:
            found.append(_cross(head, points["crosscomp"], where, known))
        if not found:
            raise FileFormatError("E-EXCHANGE-COUNT", where, rows=0, least=2, most=MOST_OWN)
        return tuple(found)


Points = dict[int, dict[str, float]]


def _own_lines(table: CompensationTable, form: str) -> list[str]:
    at, forward, reverse = curves_of(table)
    _demand(at, MOST_OWN)
    key, lines = "kw.ssfk", []
    steps, values = _steps(at, table.input_unit), (_values(one, table.output_unit) for one in (forward, reverse))
    pos, neg = values
    head = {"unit": 1, "interval": 0, "kw_startpos": round(float(steps[0])), "kw_nr_max": at.size}
    head |= {"bilateral": int(bool(table.reverse)), "modulo": int(table.modulo)}
    lines += [f"{key}.{name} {value}" for name, value in head.items()]
    for place, (step, up, down) in enumerate(zip(steps, pos, neg, strict=True)):
        lines.append(f"{key}.table[{place}].setpoint {_shown(step, 'whole')}")
        lines.append(f"{key}.table[{place}].pos {_shown(up, form)}")
        lines += [f"{key}.table[{place}].neg {_shown(down, form)}"] * bool(table.reverse)
    return lines


def _cross_lines(table: CompensationTable, form: str) -> list[str]:
    if table.reverse or table.direction:
        raise TableError("E-EXCHANGE-DIRECTION", "twincat", table=table.name)
    at, values, _ = curves_of(table)
    _demand(at, MOST_CROSS)
    key = "kw.crosscomp"
    lines = [f"# over axis {table.input_axis}: enter its logical number", f"# {key}.master_ax_nr"]
    lines += [f"{key}.unit 1", f"{key}.last_index {at.size - 1}"]
    steps, corrections = _steps(at, table.input_unit), _values(values, table.output_unit)
    for place, (step, value) in enumerate(zip(steps, corrections, strict=True)):
        lines.append(f"{key}.table[{place}].setpoint {_shown(step, 'whole')}")
        lines.append(f"{key}.table[{place}].correction {_shown(value, form)}")
    return lines


def _demand(at: FloatArray, limit: int) -> None:
    if at.size > limit:
        raise TableError("E-EXCHANGE-ROWS", "twincat", rows=at.size, limit=limit)


def _steps(at: FloatArray, unit: AxisUnit) -> FloatArray:
    return at * (STEPS_PER_MM if unit == "mm" else STEPS_PER_DEG)


def _values(deviations: FloatArray, unit: AxisUnit) -> FloatArray:
    return um_to_mm(deviations) * STEPS_PER_MM if unit == "mm" else arcsec_to_deg(deviations) * STEPS_PER_DEG


def _deviations(values: FloatArray, unit: AxisUnit) -> FloatArray:
    return mm_to_um(values / STEPS_PER_MM) if unit == "mm" else deg_to_arcsec(values / STEPS_PER_DEG)


def _shown(value: float, form: str) -> str:
    return f"{value:.4f}" if form == "real" else str(round(value))


def _parsed(text: str, where: str) -> tuple[dict[str, float], dict[str, Points]]:
    """Head values by key, and points by table and index. Raises FileFormatError (E-EXCHANGE-KEY, -NUMBER, -TWICE)."""
    head: dict[str, float] = {}
    points: dict[str, Points] = {"ssfk": {}, "crosscomp": {}}
    for line, told in content(_uncommented(text), "#", where):
        words = told.split()
        if len(words) != 2 or not words[0].startswith(("kw.", "kopf.")):
            raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=told[:60])
        if words[0].startswith("kopf."):
            continue
        point = _POINT.match(words[0])
        target, key = (
            (points[point.group(1)].setdefault(int(point.group(2)), {}), point.group(3)) if point else (head, words[0])
        )
        if key in target:
            raise FileFormatError("E-EXCHANGE-TWICE", where, line=line, key=words[0])
        target[key] = number(words[1], where, line)
    return head, points


def _uncommented(text: str) -> str:
    """Block comments as empty lines, so that line numbers stay."""
    return re.sub(r"/\*.*?\*/", lambda found: "\n" * found.group().count("\n"), text, flags=re.DOTALL)


def _columns(points: Points, keys: Sequence[str], where: str) -> Mapping[str, FloatArray]:
    """Arrays of a table whose indices run from 0 without a gap. Raises FileFormatError (E-EXCHANGE-GAP)."""
    for place in range(len(points)):
        missing = [key for key in keys if key not in points.get(place, {})]
        if missing:
            raise FileFormatError("E-EXCHANGE-GAP", where, place=place, key=missing[0])
    return {key: np.asarray([points[place][key] for place in range(len(points))]) for key in keys}


def _own(head: Mapping[str, float], points: Points, where: str, known: ReadAs) -> CompensationTable:
    _metric(head, "kw.ssfk.unit", where)
    _stated(head.get("kw.ssfk.kw_nr_max"), len(points), where)
    both = bool(_said(head, "kw.ssfk.bilateral", where, needed=any("neg" in point for point in points.values())))
    interval = _said(head, "kw.ssfk.interval", where, needed=not all("setpoint" in point for point in points.values()))
    keys = (*(("setpoint",) if interval == 0.0 else ()), "pos", *(("neg",) if both else ()))
    found = _columns(points, keys, where)
    start = _said(head, "kw.ssfk.kw_startpos", where, needed=interval != 0.0)
    even: FloatArray = start + interval * np.arange(len(points), dtype=np.float64)
    steps = found["setpoint"] if interval == 0.0 else even
    at = steps / (STEPS_PER_MM if known.unit == "mm" else STEPS_PER_DEG)
    rising(at, where)
    forward, reverse = (np.round(_deviations(found[key], known.unit), 6) for key in ("pos", "neg" if both else "pos"))
    return own_table(known, at, forward, reverse, modulo=bool(head.get("kw.ssfk.modulo", 0.0)))


def _cross(head: Mapping[str, float], points: Points, where: str, known: ReadAs) -> CompensationTable:
    _metric(head, "kw.crosscomp.unit", where)
    last = head.get("kw.crosscomp.last_index")
    _stated(None if last is None else last + 1, len(points), where)
    found = _columns(points, ("setpoint", "correction"), where)
    at = found["setpoint"] / STEPS_PER_MM
    rising(at, where)
    values = np.round(_deviations(found["correction"], known.unit), 6)
    master = head.get("kw.crosscomp.master_ax_nr")
    return CompensationTable(
        kind="cross",
        input_axis="?" if master is None else f"AX{master:g}",
        output_axis=known.axis,
        minimum=float(at[0]),
        maximum=float(at[-1]),
        step=0.0,
        deviations=tuple(float(value) for value in values),
        output_unit=known.unit,
        places=tuple(float(value) for value in at),
    )


def _said(head: Mapping[str, float], key: str, where: str, *, needed: bool) -> float:
    """A value of the head, 0 where it is missing and nothing depends on it. Raises FileFormatError (E-FILE-LINE)."""
    if needed and key not in head:
        raise FileFormatError("E-FILE-LINE", where, line=1, why=Message.of("W-EXCHANGE-KEY-MISSING", key=key))
    return head.get(key, 0.0)


def _metric(head: Mapping[str, float], key: str, where: str) -> None:
    if head.get(key) != 1.0:
        raise FileFormatError("E-EXCHANGE-INCREMENTS", where, key=key)


def _stated(count: float | None, found: int, where: str) -> None:
    if count != found:
        raise FileFormatError("E-FILE-COUNT", where, stated="no points" if count is None else f"{count:g}", found=found)
