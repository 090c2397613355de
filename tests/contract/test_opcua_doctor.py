"""`trueflank doctor`: every line right, wrong and not to be told, and not one write on the wire."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.checks import CheckLine, Wanted, WantedAxis
from drivers.sinumerik.opcua.doctor import UaDoctor
from simulators.nck import NckSpec
from tests.contract.opcua_stage import PLAIN, SPEC, Stage, on_stage

WANTED = Wanted(SPEC.serial, (WantedAxis("X1", "mm", 0, 73), WantedAxis("C1", "deg", 0, 73)))
PASSED = ";TRUEFLANK SELF 1 {axis}\n;AT 2026-3-9\n;PASSED 1 READ\n;TRUEFLANK END 1\nM17\n"
CHECKS = (
    *(
        "name",
        "port",
        "endpoint",
        "policy",
        "certificate",
        "own certificate",
        "login",
        "clock",
        "namespace",
        "option",
        "methods",
    ),
    *(
        "server version",
        "rights",
        "axes",
        "serial number",
        "identity",
        "variables",
        "units",
        "measuring system",
        "measuring system",
    ),
    *("table memory", "table memory", "cross tables"),
    *("written files", "free memory", "SD41300", "CEC limits", "CEC limits", "diameters", "temperature", "temperature"),
    *("key switch", "files", "self-test", "self-test", "left over", "R parameters", "alarms", "state"),
)


def doctor(on: Stage, wanted: Wanted = WANTED, url: str = "", **settings: Any) -> Any:
    own = {key: value for key, value in PLAIN.items() if key != "security"}
    secured = {"server_certificate": str(on.server.certificate)}
    return UaDoctor("840D", url or on.server.url, {**own, **secured, **settings}, on.clock).examine(wanted, 5.0)


async def lines_of(
    keys: Path, spec: NckSpec = SPEC, server: dict[str, Any] | None = None, wanted: Wanted = WANTED, **settings: Any
) -> list[CheckLine]:
    """What the doctor says of a control, having changed nothing on it and left nothing open."""
    async with on_stage(spec, folder=keys, server=server) as on:
        await on.device.close()
        for axis in ("X1", "C1"):
            on.nck.files.write(f"/_N_SPF_DIR/_N_TFSELF_{axis}_SPF", PASSED.format(axis=axis).encode())
        found = await doctor(on, wanted, **settings)
        assert on.server.requests.changing == 0
        assert on.server.requests.services["write"] == 0
        await on.clock.sleep(0.5)
        assert on.server.sessions == 0
    for line in found:
        assert "<" not in line.what + line.fix, line
        assert bool(line.fix) == (line.outcome != "ok"), line
    return found


def bad(lines: list[CheckLine]) -> list[tuple[str, str, str]]:
    return [(line.check, line.outcome, line.code) for line in lines if line.outcome != "ok"]


async def test_a_road_in_order(keys: Path) -> None:
    lines = await lines_of(keys)
    assert bad(lines) == []
    assert tuple(line.check for line in lines) == CHECKS


async def test_a_first_file_without_a_certificate_is_told_its_thumbprint(keys: Path) -> None:
    lines = await lines_of(keys, server_certificate="")
    assert [line.code for line in lines if line.outcome != "ok"] == ["E-DOC-NO-CERTIFICATE", "W-DOC-NOT-REACHED"]
    (told,) = [line for line in lines if line.code == "E-DOC-NO-CERTIFICATE"]
    assert "trueflank doctor certificate" in told.fix
    assert len(str(told.fields["sha256"]).replace(":", "")) == 64


RIGHTS = ("SinuReadAll", "StateWrite", "FsRead", "FsWrite", "ApWrite", "AlarmRead")
OLD_RIGHTS = ("SinuReadAll", "StateWrite", "FSRead", "FSWrite", "AlarmRead")
"""As the manual of 04/2018 prints them; ApWrite it does not know."""


def user(*rights: str) -> dict[str, Any]:
    return {"users": {"trueflank": {"password": "trueflank", "rights": list(rights)}}}


WRONG: list[tuple[str, NckSpec, dict[str, Any], dict[str, Any], tuple[str, str, str]]] = [
    ("password", SPEC, {}, {"password": "x"}, ("login", "wrong", "E-UA-LOGIN")),
    ("policy", SPEC, {"security": ["None"]}, {}, ("policy", "wrong", "E-UA-POLICY")),
    ("our certificate", SPEC, {"trusted": []}, {}, ("own certificate", "wrong", "E-UA-TRUST-US")),
    ("not pinned", SPEC, {}, {"server_certificate": "/nowhere/c.der"}, ("certificate", "wrong", "E-UA-UNPINNED")),
    ("no security", SPEC, {}, {"security": "None"}, ("policy", "wrong", "E-DOC-NO-SECURITY")),
    ("rights", SPEC, user("SinuReadAll", "StateWrite"), {}, ("rights", "wrong", "E-DOC-RIGHTS")),
    ("old server", SPEC, {"software_version": "1.2"}, {}, ("server version", "wrong", "E-DOC-SERVER-OLD")),
    ("no version", SPEC, {"software_version": ""}, {}, ("server version", "unknown", "W-DOC-SERVER-UNKNOWN")),
    ("ApWrite", SPEC, user(*OLD_RIGHTS), {}, ("rights", "wrong", "E-DOC-RIGHTS")),
    (
        "perhaps ApWrite",
        SPEC,
        {**user(*OLD_RIGHTS), "software_version": ""},
        {},
        ("rights", "unknown", "W-DOC-RIGHTS-LATER"),
    ),
    ("surplus", SPEC, user(*RIGHTS, "TeaWrite"), {}, ("rights", "wrong", "E-DOC-SURPLUS")),
    ("no rights told", SPEC, {"rights_method": False}, {}, ("rights", "unknown", "W-DOC-RIGHTS-UNKNOWN")),
    ("R not writable", replace(SPEC, r_writable=False), {}, {}, ("R parameters", "wrong", "E-DOC-R-RIGHT")),
    ("R out of range", SPEC, {}, {"r_first": 990}, ("R parameters", "wrong", "E-DOC-R-RANGE")),
    ("inch", replace(SPEC, unit_system="inch"), {}, {}, ("units", "wrong", "E-DOC-INCH")),
    ("key switch", replace(SPEC, access_level=4), {}, {}, ("key switch", "wrong", "E-DOC-LEVEL")),
    ("no events", SPEC, {"alarm_events": False}, {}, ("alarms", "unknown", "W-DOC-NO-EVENTS")),
    ("node path", SPEC, {}, {"serial_node": "/Nck/State/serial"}, ("serial number", "wrong", "E-UA-ABSENT")),
    ("another machine", replace(SPEC, serial="X"), {}, {}, ("serial number", "wrong", "E-DOC-SERIAL")),
    ("files too short", replace(SPEC, files_max_bytes=1024), {}, {}, ("written files", "wrong", "E-DOC-FILE-LIMIT")),
    ("sessions", SPEC, {"session_limit": 1}, {}, ("alarms", "unknown", "W-DOC-NO-EVENTS")),
]


@pytest.mark.parametrize(
    ("spec", "server", "settings", "line"), [case[1:] for case in WRONG], ids=[c[0] for c in WRONG]
)
async def test_what_is_wrong_has_its_line_and_its_fix(
    keys: Path, spec: NckSpec, server: dict[str, Any], settings: dict[str, Any], line: tuple[str, str, str]
) -> None:
    assert line in bad(await lines_of(keys, spec, server, **settings))


async def test_a_server_of_2018_spells_otherwise_and_asks_no_right_to_select(keys: Path) -> None:
    server = {**user(*OLD_RIGHTS), "software_version": "V02.00.01.00 SP1", "select_right": ""}
    assert bad(await lines_of(keys, SPEC, server)) == []


async def test_what_the_site_wants_and_the_control_has_not(keys: Path) -> None:
    axes = (WantedAxis("X1", "deg", 0, 73), WantedAxis("Z1", "mm", 0, 73), WantedAxis("Q1", "mm", 0, 3))
    lines = bad(await lines_of(keys, wanted=Wanted(SPEC.serial, axes)))
    assert ("axes", "wrong", "E-DOC-AXIS-UNIT") in lines
    assert ("axes", "wrong", "E-NC-AXIS") in lines
    assert ("table memory", "wrong", "E-DOC-MEMORY") in lines


async def test_settings_of_the_control_that_tables_and_files_need(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        for name, value in (
            ("$MN_PROTOCOL_FILE_MODE", 1),
            ("$MA_CEC_MAX_SUM[X1]", 0.01),
            ("$MA_TEMP_COMP_TYPE[C1]", 1),
            ("$SA_TEMP_COMP_SLOPE[C1]", 0.25),
        ):
            on.nck.set(name, value, 0)
        on.nck.core.data.store("$MN_PROG_SD_RESET_SAVE_TAB", (0,), 0)
        on.nck.core.data.store("$MN_INFO_FREE_MEM_STATIC", (), 0)
        found = await doctor(on)
        told = {(line.check, line.code, line.fields.get("axis")) for line in found}
        assert ("written files", "E-DOC-FILE-LATE", None) in told
        assert ("SD41300", "E-DOC-NOT-KEPT", None) in told
        assert ("free memory", "E-DOC-FREE", None) in told
        assert ("CEC limits", "E-DOC-CEC", "X1") in told
        assert ("temperature", "W-DOC-WARMTH", "C1") in told
        assert any("0.25" in line.what for line in found if line.check == "temperature")
        on.server.quirks.read_status["/NC/_N_NC_TEA_ACX/$MN_LEN_PROTOCOL_FILE"] = "BadUserAccessDenied"
        unread = await doctor(on)
        assert ("written files", "unknown", "W-DOC-FILE-LIMIT-UNKNOWN") in bad(unread)


async def test_the_last_self_test_is_told_with_its_date(keys: Path) -> None:
    told = [line for line in await lines_of(keys) if line.check == "self-test"]
    assert [(line.outcome, line.fields["date"]) for line in told] == [("ok", "2026-03-09")] * 2

    async with on_stage(folder=keys) as on:
        bad_one = PASSED.format(axis="X1").replace(";PASSED", ";NOT PASSED")
        on.nck.files.write("/_N_SPF_DIR/_N_TFSELF_X1_SPF", bad_one.encode())
        found = bad(await doctor(on))
        assert ("self-test", "wrong", "E-DOC-SELF-TEST") in found
        assert ("self-test", "unknown", "W-DOC-NO-SELF-TEST") in found


async def test_a_machine_with_a_diameter_axis_is_told_so(keys: Path) -> None:
    lines = await lines_of(keys, replace(SPEC, diameter_axis="X"))
    assert [line.what[:1] for line in lines if line.check == "diameters"] == ["X"]


async def test_live_conditions_and_the_end_of_the_road(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        on.nck.set("R[83]", 1.5, 7)
        on.server.quirks.stale_s = 30.0
        on.server.quirks.read_status["/Channel/ProgramInfo/msg"] = "BadUserAccessDenied"
        found = await doctor(on)
        assert ("R parameters", "unknown", "W-DOC-R-USED") in bad(found)
        assert ("variables", "wrong", "E-DOC-NODE") in bad(found)
        on.server.quirks.read_status.clear()
        assert bad(await doctor(on))[-1] == ("state", "wrong", "E-UA-STALE")
        assert bad(await doctor(on, url="opc.tcp://nowhere.invalid:4840"))[0] == ("name", "wrong", "E-DOC-NAME")
        silent = await asyncio.start_server(lambda _r, w: w.close(), "127.0.0.1", 0)
        port = silent.sockets[0].getsockname()[1]
        found = await doctor(on, url=f"opc.tcp://127.0.0.1:{port}")
        assert bad(found)[0][:2] == ("endpoint", "unknown")
        assert bad(found)[-1] == ("rest", "unknown", "W-DOC-NOT-REACHED")
        silent.close()
        await silent.wait_closed()
        found = await doctor(on, url=f"opc.tcp://127.0.0.1:{port}")
        assert bad(found)[0] == ("port", "wrong", "E-DOC-PORT")
        assert on.server.requests.changing == 0


async def test_a_file_that_may_not_be_written_is_known_without_writing(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        on.nck.files.write("/_N_MPF_DIR/_N_TFMEAS_X1_MPF", b"M30\n")
        assert ("W-DOC-FILES", "ok") in [(line.code, line.outcome) for line in await doctor(on)]
        on.nck.set_access_level(7)
        assert ("files", "wrong", "E-UA-LEVEL") in bad(await doctor(on))


@pytest.mark.parametrize("told", [True, False])
async def test_a_size_of_requests_that_the_server_does_not_state_is_found_and_told(keys: Path, told: bool) -> None:
    async with on_stage(folder=keys) as on:
        on.server.quirks.most_read, on.server.quirks.tells_limits = 10, told
        lines = await doctor(on)
        found = [one.fields["most"] for one in lines if one.code == "W-DOC-REQUEST-SIZE"]
        assert found == [] if told else 1 <= int(found[0]) <= 10
