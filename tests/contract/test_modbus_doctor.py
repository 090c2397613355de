"""`trueflank doctor` on the Modbus road: the mailbox looked at, and not one register written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from drivers.checks import CheckLine, Wanted, WantedAxis
from drivers.clock import LoopClock, run_virtual
from drivers.sinumerik.mailbox.device import ModbusDoctor
from simulators.modbus import running_station
from simulators.nck import Nck, NckSpec
from tests.contract.opcua_stage import SPEC

WANTED = Wanted(SPEC.serial, (WantedAxis("X1", "mm", 0, 73), WantedAxis("C1", "deg", 0, 73)))


def lines_of(
    plc: dict[str, Any] | None = None,
    settings: dict[str, Any] | None = None,
    spec: NckSpec = SPEC,
    wanted: Wanted = WANTED,
    url: str = "tcp://127.0.0.1:0",
    prepare: str = "",
) -> list[CheckLine]:
    """What the doctor says, having written nothing."""
    found: list[CheckLine] = []

    async def main() -> None:
        clock = LoopClock()
        nck = Nck(spec, clock)
        await nck.start()
        async with running_station(nck, clock, plc or {}, url) as station:
            writes: list[Sequence[int]] = []
            station.plc.write = lambda _address, values: writes.append(values)  # type: ignore[method-assign]
            if prepare == "pulled":
                await station.pull()
            if prepare == "release":
                station.plc.release.give()
            if prepare == "session":
                station.plc.open_session(77)
            doctor = ModbusDoctor("840D", station.home, settings or {}, clock)
            found.extend(await doctor.examine(wanted, 5.0))
            assert writes == []
        await nck.stop()

    run_virtual(main)
    for line in found:
        assert "<" not in line.what + line.fix, line
        assert bool(line.fix) == (line.outcome != "ok"), line
    return found


def bad(lines: list[CheckLine]) -> list[tuple[str, str, str]]:
    return [(line.check, line.outcome, line.code) for line in lines if line.outcome != "ok"]


@pytest.mark.parametrize("url", ["tcp://127.0.0.1:0", "memory://doctor"])
def test_a_mailbox_in_order(url: str) -> None:
    lines = lines_of(url=url)
    plain = [("protection", "wrong", "E-DOC-PLAIN")] if url.startswith("tcp") else []
    assert bad(lines) == plain
    checks = [
        "mailbox",
        "map version",
        "word order",
        "heartbeat",
        "serial number",
        "identity",
        "axes",
        "units",
        "temperature",
        "release",
    ]
    road = ["protection", "name", "port"] if url.startswith("tcp") else []
    assert [line.check for line in lines] == [*road, *checks, "session", "state"]


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"plc": {"swap_words": True}}, ("word order", "wrong", "E-MBX-WORD-ORDER")),
        ({"settings": {"word_order": "low-first"}}, ("word order", "wrong", "E-MBX-WORD-ORDER")),
        ({"plc": {"map_version": 2}}, ("map version", "wrong", "E-MBX-OLD-MAP")),
        ({"plc": {"stale_heartbeat": True}}, ("heartbeat", "wrong", "E-MBX-STALLED")),
        ({"wanted": Wanted("other", ())}, ("serial number", "wrong", "E-DOC-SERIAL")),
        ({"wanted": replace(WANTED, axes=WANTED.axes * 2)}, ("axes", "wrong", "E-DOC-COUNTS")),
        ({"spec": replace(SPEC, unit_system="inch")}, ("units", "wrong", "E-DOC-INCH")),
        ({"prepare": "release"}, ("release", "unknown", "E-DOC-RELEASE")),
        ({"prepare": "session"}, ("session", "unknown", "W-DOC-SESSION")),
        ({"prepare": "pulled"}, ("port", "wrong", "E-DOC-PORT")),
        ({"settings": {"unit": 9}}, ("answer", "wrong", "E-MODBUS-GATEWAY")),
    ],
)
def test_what_is_wrong_has_its_line_and_its_fix(given: dict[str, Any], line: tuple[str, str, str]) -> None:
    assert line in bad(lines_of(**given))
