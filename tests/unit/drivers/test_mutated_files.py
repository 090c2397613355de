"""Files damaged in 10 000 ways or more: our error with line and reason, or what the canonical rewrite also says."""

from __future__ import annotations

import random
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from drivers.errors import FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.csvmap import parse_csv
from drivers.files.csvtext import table_text
from drivers.files.gde import GdeNames, read_gde
from drivers.files.gear import GearColumns, read_gear_table
from drivers.files.pos import parse_pos
from drivers.files.rtl import measured_set
from drivers.files.rtltext import RtlText, parse, render
from drivers.files.rtx import RtxHead, read_head
from drivers.local.textfile import decode_text
from drivers.types.gears import GearInspection
from drivers.types.results import MeasuredSet
from tests.sizes import long, soak
from tests.unit.drivers.mutations import Score, run

COUNT = 100_000
SLOW = {"gear table": 5, "csv": 3, "csv by columns": 3}

RTL = b"""HEADER::
File type  : rtl
TARGET DATA::
Target-count: 2
Targets :
 -50.000000  1.5
Flags: 0 0 2 0
RUNS::
Run-count:2
DEVIATIONS::
Run Target Data:
1    1    0.250
1    2    1.250
2    2    2.875
2    1    0.500
ENVIRONMENT::
Air temp   : 20.1 20.2 0
EOF::
"""
CSV = [
    b"Target [mm];Run 1 fwd [um];Run 1 rev [um];Run 2 fwd [um]\n0;0.5;1.25;0.75\n10;-1.5;0.25;\n",
    b"UNIT=mm\nTGT_DATA[1]=0\nTGT_DATA[2]=10\nREF_DATA_FWD[1,1]=0.0005\nREF_DATA_BWD[2,1]=9.9985\n",
    b"target_mm,direction,repetition,deviation_um\n0,+,1,0.5\n10,+,1,1.25\n10,-,1,-1.5\n0,-,1,0.25\n",
    b"target_mm;direction;run;position_mm\n0;up;1;0,0015\n10;up;1;10,25\n10;down;1;9,5\n",
    b"target_deg\tdirection\tcycle\tdeviation_arcsec\n0\tforward\t1\t0.5\n90\tbackward\t2\t-1\n",
]
MAPPED = b"No;Soll;Ist;Lauf\n1;-10,0;-9,9990;1\n2;0,0;0,0010;1\n3;0,0;0,0005;2\n4;-10,0;-9,9985;2\n"
MAP = ColumnMap(
    target=2,
    measured=3,
    run=4,
    direction="runs",
    separator=";",
    decimal_comma=True,
    target_unit="mm",
    reading_unit="mm",
)
POS = (
    b"API\nPosition \tForward Directional Avg Error\n0\t0.001\n10\t0.002\n\n"
    b"Position\tBackward Directional Avg Error\n0\t0\n10\t-0.1\n"
)
RTX = (
    b"HEADER::\r\nFile type: rtx\r\nSample rate: 50000\r\nSample no: 3\r\nTrigger point: 1\r\n"
    b"Actual sample rate: 50000\r\nUSER-TEXT::\r\nAxis: X\r\nData:\r\n" + np.arange(3.0).tobytes() + b"\r\nEOF::\r\n"
)
GDE = (
    b'<gde version="3.4"><gear_data datum_face="top"><flank side="left" no="3">'
    b'<p x="30.1" y="0.5" z="-2" d="1.5"/>\n<p x="30.2" y="0.6" z="2" d="-1"/></flank></gear_data></gde>'
)
NAMES = GdeNames(point="p", x="@x", y="@y", z="@z", space="@no", flank="@side", deviation="@d")
GEAR = b"space;flank;x;y;z;dev\n1;left;30,1;0,5;-2;1,5\n1;right;30,1;-0,5;-2;-0,5\n"
GEAR_MAP = GearColumns(x=3, y=4, z=5, deviation=6, decimal_comma=True)


def told(name: str, score: Score, count: int) -> None:
    refused = ", ".join(f"{code} {number}" for code, number in sorted(score.refused.items()))
    print(f"{name}: {count} mutations, {score.accepted} accepted; refused: {refused}")
    assert score.accepted > 0
    assert sum(score.refused.values()) > 0


def sound(found: MeasuredSet) -> None:
    """What every accepted set is: targets rising, finite numbers, one reading at least, shapes that fit."""
    count, _repetitions, ways = found.deviations.shape
    assert found.targets.shape == (count,)
    assert ways == 2
    targets = found.targets.tolist()
    assert all(after > before for before, after in pairwise(targets))
    assert np.isfinite(found.targets).all()
    known = found.deviations[~np.isnan(found.deviations)]
    assert known.size
    assert np.isfinite(known).all()


def same(one: MeasuredSet, other: MeasuredSet) -> None:
    assert one.axis_unit == other.axis_unit
    assert np.array_equal(one.targets, other.targets)
    ours, theirs = one.deviations, other.deviations
    # A repetition in which nothing was read leaves no row behind.
    kept = ours[:, ~np.isnan(ours).all(axis=(0, 2)), :]
    assert np.array_equal(kept, theirs, equal_nan=True)


def read_rtl(data: bytes) -> tuple[RtlText, MeasuredSet]:
    content = parse(decode_text(data, "cp1252", "x"), "x")
    return content, measured_set(content, "mm", lambda value: value, "x")


def check_rtl(_data: bytes, found: Any) -> None:
    content, measured = found
    sound(measured)
    again = parse(render(content), "x")
    assert (again.targets, again.rows, again.run_count) == (content.targets, content.rows, content.run_count)
    assert np.array_equal(read_rtl(render(content).encode())[1].deviations, measured.deviations, equal_nan=True)


def check_table(data: bytes, found: Any) -> None:
    sound(found)
    assert data.endswith((b"\n", b"\r")) or any("whole" in warning for warning in map(str, found.warnings))
    same(found, parse_csv(table_text(found), ColumnMap(confirmed=True), "x"))


def check_pos(data: bytes, found: Any) -> None:
    sound(found)
    assert found.deviations.shape[1] == 1
    assert data.endswith((b"\n", b"\r")) or any("whole" in warning for warning in map(str, found.warnings))


def read_rtx(data: bytes) -> RtxHead:
    return read_head(data[:8192], len(data), "cp1252", "x")


def check_rtx(data: bytes, found: Any) -> None:
    assert 1 <= found.count <= found.stated
    assert found.start + 8 * found.count <= len(data)
    assert 0.0 < found.rate_hz <= 1e9
    assert found.trigger is None or 0 <= found.trigger < found.count
    head = f"HEADER::\r\nSample no: {found.stated}\r\nActual sample rate: {found.rate_hz!r}\r\nData:\r\n".encode()
    again = read_head(head, len(head) + 8 * found.count, "cp1252", "x")
    assert (again.count, again.stated, again.rate_hz) == (found.count, found.stated, found.rate_hz)


def check_gear(_data: bytes, found: Any) -> None:
    inspection: GearInspection = found
    count = len(inspection)
    assert count >= 1
    assert inspection.points_mm.shape == (count, 3)
    assert np.isfinite(inspection.points_mm).all()
    assert inspection.space.shape == inspection.flank.shape == (count,)
    assert set(inspection.flank.tolist()) <= {1, -1}
    assert inspection.deviation_um is None or np.isfinite(inspection.deviation_um).all()


PARSERS: dict[str, tuple[list[bytes], Callable[[bytes], object], Callable[[bytes, Any], None]]] = {
    "rtl": ([RTL], read_rtl, check_rtl),
    "csv": (CSV, lambda data: parse_csv(decode_text(data, "cp1252", "x"), ColumnMap(), "x"), check_table),
    "csv by columns": ([MAPPED], lambda data: parse_csv(decode_text(data, "cp1252", "x"), MAP, "x"), check_table),
    "pos": ([POS], lambda data: parse_pos(decode_text(data, "cp1252", "x"), "x"), check_pos),
    "rtx header": ([RTX], read_rtx, check_rtx),
    "gde": ([GDE], lambda data: read_gde(data, NAMES, "x"), check_gear),
    "gear table": ([GEAR], lambda data: read_gear_table(decode_text(data, "cp1252", "x"), GEAR_MAP, "x"), check_gear),
}


@pytest.mark.parametrize("count", [COUNT // 50, long(COUNT // 10), soak(COUNT)])
@pytest.mark.parametrize("name", sorted(PARSERS))
def test_a_damaged_file_is_refused_or_means_what_its_rewrite_means(name: str, count: int) -> None:
    bases, read, check = PARSERS[name]
    for base in bases:
        check(base, read(base))
    count //= SLOW.get(name, 1)
    told(name, run(bases, read, check, count, seed=20), count)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("name", sorted(PARSERS))
def test_damaged_files_for_longer(name: str, seed: int) -> None:
    bases, read, check = PARSERS[name]
    told(name, run(bases, read, check, COUNT, seed=1000 + seed), COUNT)


@pytest.mark.parametrize("name", ["csv", "csv by columns"])
def test_a_number_that_no_measurement_holds_is_refused_at_its_line(name: str) -> None:
    """A position of 101e95 mm was read, and its deviation then too long for a table of deviations."""
    bases, read, _check = PARSERS[name]
    huge = bases[-2 if name == "csv" else 0].replace(b"10,25", b"101e95").replace(b"0,0010", b"101e95")
    with pytest.raises(FileFormatError) as caught:
        read(huge)
    assert caught.value.code == "E-FILE-LINE"
    assert (caught.value.fields["line"], "not a measurement" in str(caught.value)) == (3, True)


def test_the_same_seed_gives_the_same_damage() -> None:
    first, second = (run([RTL], read_rtl, check_rtl, 200, seed=5) for _ in range(2))
    assert first == second
    assert random.Random(5).random() != random.Random(6).random()
