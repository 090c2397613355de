"""Servers that do it otherwise: null strings, axis numbers left out, no channel without security, named arguments."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.checks import CheckLine, Wanted, WantedAxis
from drivers.errors import TrueflankError
from drivers.sinumerik.opcua.doctor import UaDoctor, UaTrust
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.certificates import own_key_pair
from drivers.types.stops import Stop
from tests.contract.opcua_stage import AXES, ORDER, SPEC, Stage, on_stage, plan

X, Z, C = AXES
GAPS = replace(SPEC, axes=(X, replace(Z, number=4), replace(C, number=13)), cec_points=(0, 10))


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The server's key pair, made once."""
    return tmp_path_factory.mktemp("server-keys")


@pytest.mark.parametrize("null_strings", [False, True])
async def test_axes_keep_their_numbers_whatever_an_empty_name_is(null_strings: bool) -> None:
    async with on_stage(spec=GAPS, server={"null_strings": null_strings}) as on:
        names = [nodes.axis_name(place) for place in range(1, 32)]
        told = [one.value for one in await on.device._session.read(names, 5.0)]
        assert (told[0], told[3], told[12]) == ("X1", "Z1", "C1")
        assert [one for one in told if one not in ("X1", "Z1", "C1")] == [""] * 28
        state = await on.device.state()
        assert tuple(state.axes) == ("X1", "Z1", "C1")
        assert (state.message, state.program) == ("", "")
        assert state.axes["C1"].unit == "deg"
        memory = await on.device._reader.memory(on.device._configuration, "X1", 0)
        assert (memory.eec_points, memory.axes) == (81, ("X1", "Z1", "C1"))


async def test_a_push_and_a_walk_go_by_the_numbers_of_the_control() -> None:
    async with on_stage(spec=GAPS, server={"null_strings": True}) as on:
        assert await on.push(ORDER)
        assert on.enabled
        seen = await on.walk(plan((Stop(10.0, 1),)))
        assert [stop.target for stop in seen] == [10.0]
        live = await on.device.saved_tables("C1")
        assert live.own.enabled
        assert len(live.own.table.deviations) == len(ORDER.table.deviations)


async def test_the_doctor_counts_no_null_string_as_an_axis(keys: Path) -> None:
    told: list[CheckLine] = []

    async def act(on: Stage) -> None:
        settings = {"user": "trueflank", "password": "trueflank", "server_certificate": str(on.server.certificate)}
        wanted = Wanted(SPEC.serial, (WantedAxis("X1", "mm", 0, 73), WantedAxis("C1", "deg", 0, 73)))
        told.extend(await UaDoctor("840D", on.server.url, settings, on.clock).examine(wanted, 5.0))

    async with on_stage(spec=GAPS, server={"null_strings": True}, folder=keys) as on:
        await act(on)
    lines = {line.check: line for line in told}
    for check in ("axes", "variables", "units", "measuring system", "table memory", "state"):
        assert lines[check].outcome == "ok", lines[check]
    assert "X1, Z1, C1" in lines["axes"].what


@pytest.mark.parametrize("offered", ["Basic256Sha256", "Aes256_Sha256_RsaPss"])
async def test_a_server_that_shows_nothing_without_security_proves_the_pinned_certificate(
    keys: Path, tmp_path: Path, offered: str
) -> None:
    async with on_closed_stage(keys, offered) as on:
        pinned = {"security": "best", "server_certificate": str(on.server.certificate)}
        device = on.driver(**pinned, client_folder=str(tmp_path))
        assert (await device.open(5.0)).serial == SPEC.serial
        assert device._session.policy == offered
        await device.close()
        with pytest.raises(TrueflankError) as caught:
            await UaTrust("840D", on.server.url, pinned, on.clock).show(5.0)
        assert caught.value.code == "E-UA-NO-OFFER"


async def test_a_server_that_shows_nothing_and_has_another_certificate_is_refused(keys: Path, tmp_path: Path) -> None:
    other = own_key_pair(tmp_path, "other", "urn:other", "127.0.0.1", server=True)

    async with on_closed_stage(keys, "Basic256Sha256") as on:
        pinned = {"security": "best", "server_certificate": str(other.certificate)}
        device = on.driver(**pinned, client_folder=str(tmp_path))
        with pytest.raises(TrueflankError) as caught:
            await device.open(5.0)
        assert caught.value.code in ("E-UA-TRUST-US", "E-UA-CONNECT", "E-LINK-DEADLINE")
        assert on.server.sessions == 1  # that of the stage itself


def on_closed_stage(keys: Path, offered: str) -> contextlib.AbstractAsyncContextManager[Stage]:
    """A stage whose server has one policy, and none without security; its own driver logs in by the pinned one."""
    server = {"security": [offered], "discovery": False}
    settings = {"security": "best", "server_certificate": str(keys / "server.der"), "client_folder": str(keys)}
    return on_stage(server=server, settings=settings, folder=keys)


async def test_an_error_names_the_argument_that_the_server_refused() -> None:
    async with on_stage() as on:
        with pytest.raises(TrueflankError, match="argument 1: BadOutOfRange"):
            await on.device._session.call("CopyFileFromServer", [("Nowhere/A.MPF", "String")], 5.0)
        with pytest.raises(TrueflankError, match="argument 2: BadTypeMismatch") as caught:
            await on.device._session.call("Select", [("Nowhere/A.MPF", "String"), (1, "UInt16")], 5.0)
        assert "argument 1" not in caught.value.what
        assert caught.value.code == "E-UA-TYPE"


async def test_a_server_that_does_not_know_a_second_measuring_system() -> None:
    async with on_stage() as on:
        for number in (1, 2, 3):
            on.server.quirks.read_status[nodes.of_axis("vaEnc2CompVal", number, 1)] = "BadNodeIdUnknown"
        assert set((await on.device.state()).axes) == {"X1", "Z1", "C1"}
        on.server.quirks.read_status[nodes.of_axis("vaEnc1CompVal", 1, 1)] = "BadNodeIdUnknown"
        with pytest.raises(TrueflankError, match="vaEnc1CompVal"):
            await on.device.state()
