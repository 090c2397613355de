"""Files of the control through its file nodes, where copying methods are absent, refuse, or take less."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import DeviceRefused, TrueflankError
from drivers.sinumerik.ncprogram.checks import check_program
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.connection import Secrets
from drivers.types.stops import Stop
from tests.contract.opcua_stage import SPEC, Stage, on_stage, plan

FOLDER = "Sinumerik/FileSystem/Part Program"
MEASURE = "/_N_MPF_DIR/_N_TFMEAS_C1_MPF"
STOPS = plan((Stop(5.0, 1),))


async def refused(work: Any, code: str) -> TrueflankError:
    with pytest.raises(TrueflankError) as caught:
        await work
    assert caught.value.code == code, caught.value
    return caught.value


async def session(on: Stage) -> UaSession:
    made = UaSession(on.server.url, on.clock, "test")
    await made.open(Secrets("trueflank", "trueflank"), 5.0)
    return made


@pytest.mark.parametrize(
    "server",
    [
        {"copy_methods": False},
        {"copy_refusal": "BadRequestNotAllowed"},
        {"copy_refusal": "BadNotSupported"},
        {"largest_copy": 500},
        {"copy_methods": False, "name_space": 4, "method_folder": "/Methods"},
    ],
)
async def test_a_whole_run_through_file_nodes(keys: Path, server: dict[str, Any]) -> None:
    async with on_stage(folder=keys, server=server) as on:
        assert len(await on.walk(STOPS)) == 1
        assert (await on.device.saved_tables("C1")).own.table.deviations == (0.0,)
        assert len(await on.walk(STOPS)) == 1
        called = on.server.requests.called
        assert (called["Open"], called["Open/CreateFile"]) == (3, 1)
        assert on.server._core.files.handles == {}


async def test_polite_servers_are_asked_by_methods_only(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.walk(STOPS)
        assert on.server.requests.called["Open"] == 0


@pytest.mark.parametrize(
    ("refusal", "code"),
    [("BadNotSupported", "E-UA-LEVEL"), ("BadRequestNotAllowed", "E-UA-RIGHTS"), ("", "E-UA-ABSENT")],
)
async def test_without_either_way_the_first_refusal_is_told(keys: Path, refusal: str, code: str) -> None:
    async def act(on: Stage) -> None:
        await refused(on.device.prepare_stops(STOPS), code)
        assert on.nck.selected == ""
        assert not on.nck.files.exists(MEASURE)

    server = {"file_nodes": False, "copy_refusal": refusal, "copy_methods": bool(refusal)}
    async with on_stage(folder=keys, server=server) as on:
        await act(on)


@pytest.mark.parametrize("silent", [True, False])
async def test_a_level_too_low_is_refused_even_where_the_server_would_lose_the_write_in_silence(
    keys: Path, silent: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with on_stage(folder=keys, server={"copy_methods": False}) as on:
        on.server.quirks.silent_file_nodes = silent
        await on.walk(STOPS)
        text = on.nck.files.read(MEASURE)
        on.nck.set_access_level(7)
        await refused(on.device.prepare_stops(plan((Stop(6.0, 1),))), "E-UA-LEVEL")
        assert on.nck.files.read(MEASURE) == text

        async def says_nothing(*_: Any) -> None:
            return None

        monkeypatch.setattr(type(on.device._transfer._files), "writable", says_nothing)
        code = "E-NC-PROGRAM-CHANGED" if silent else "E-UA-LEVEL"
        await refused(on.device.prepare_stops(plan((Stop(6.0, 1),))), code)
        assert on.nck.files.read(MEASURE) == text


async def test_a_large_file_goes_through_in_pieces_and_comes_back_whole(keys: Path) -> None:
    async with on_stage(folder=keys, server={"largest_copy": 1000}) as on:
        transfer = on.device._transfer
        text = "; a line of a long program\n" * 12000 + "M30\n"
        await transfer.send(check_program(MEASURE, text, ()))
        assert on.server.requests.called["Open/Write"] == 5
        assert await transfer.fetch(MEASURE) == text


async def test_the_nodes_themselves(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        made, other = await session(on), await session(on)
        file = f"{FOLDER}/A.MPF"

        async def call(name: str, *arguments: tuple[Any, str], by: UaSession = made, of: str = file) -> list[Any]:
            return await by.invoke(of, name, arguments, 5.0)

        await refused(call("Open", (1, "Byte")), "E-UA-FILE")
        _, handle = await call("CreateFile", ("a.mpf", "String"), (True, "Boolean"), of=FOLDER)
        await refused(call("CreateFile", ("A.MPF", "String"), (False, "Boolean"), of=FOLDER), "E-UA-REFUSED")
        await refused(call("CreateFile", ("a.txt", "String"), (False, "Boolean"), of=FOLDER), "E-UA-REFUSED")
        await call("Write", (handle, "UInt32"), (b"0123456789", "ByteString"))
        assert on.nck.files.read("/_N_MPF_DIR/_N_A_MPF") == b""
        await refused(call("Write", (handle, "UInt32"), (b"x", "ByteString"), by=other), "E-UA-REFUSED")
        await refused(call("Open", (6, "Byte"), by=other), "E-UA-BUSY")
        await call("Close", (handle, "UInt32"))
        await refused(call("Close", (handle, "UInt32")), "E-UA-REFUSED")
        assert on.nck.files.read("/_N_MPF_DIR/_N_A_MPF") == b"0123456789"
        for mode in (0, 4, 5, 16):
            await refused(call("Open", (mode, "Byte")), "E-UA-REFUSED")
        (handle,) = await call("Open", (1, "Byte"))
        await call("SetPosition", (handle, "UInt32"), (7, "UInt64"))
        assert await call("Read", (handle, "UInt32"), (2, "Int32")) == [b"78"]
        assert await call("GetPosition", (handle, "UInt32")) == [9]
        await refused(call("Write", (handle, "UInt32"), (b"x", "ByteString")), "E-UA-BUSY")
        (size, writable, absent) = await made.read(
            [f"{file}.Size", f"{file}.UserWritable", f"{FOLDER}/B.MPF.Size"], 5.0
        )
        assert (size.value, writable.value, absent.status) == (10, True, "BadNodeIdUnknown")
        await refused(call("Open", (1, "Byte"), of=f"{FOLDER}/a.mpf"), "E-UA-ABSENT")
        await refused(call("Open", (1, "Int32")), "E-UA-REFUSED")
        await refused(call("Start"), "E-UA-ABSENT")
        await made.close()
        await on.clock.sleep(0.1)
        assert on.server._core.files.handles == {}
        await other.close()


async def test_a_file_left_open_by_a_lost_session_keeps_its_old_content(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        on.nck.files.write("/_N_MPF_DIR/_N_A_MPF", b"old\n")
        made = await session(on)
        (handle,) = await made.invoke(f"{FOLDER}/A.MPF", "Open", [(6, "Byte")], 5.0)
        await made.invoke(f"{FOLDER}/A.MPF", "Write", [(handle, "UInt32"), (b"ne", "ByteString")], 5.0)
        await on.server.drop_connections()
        await on.clock.sleep(0.1)
        assert on.nck.files.read("/_N_MPF_DIR/_N_A_MPF") == b"old\n"
        assert on.server._core.files.handles == {}
        await made.close()


async def test_a_control_whose_files_stay_too_short_gets_no_program(keys: Path) -> None:
    async with on_stage(replace(SPEC, files_max_bytes=1024), folder=keys) as on:
        with pytest.raises(DeviceRefused, match="E-NC-FILE-LIMIT") as caught:
            await on.device.prepare_stops(plan((Stop(6.0, 1),)))
        assert caught.value.fields["limit_kb"] == 1
        assert caught.value.fields["needed_kb"] == 4
        assert not on.nck.files.exists(MEASURE)
        assert on.server.requests.changing == 0


async def test_a_file_that_is_full_is_called_full(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.device.prepare_stops(plan((Stop(6.0, 1),)))
        on.nck.set("$MN_LEN_PROTOCOL_FILE", 1, 0)
        on.press()
        with pytest.raises(DeviceRefused, match="E-NC-FILE-FULL"):
            await on.device.wait_stop(0, 60.0)
