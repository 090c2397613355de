"""Two accounts: a session begins as the one that reads, and the one that writes is taken for writing alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from drivers.checks import CheckLine
from drivers.errors import DeviceRefused
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.sinumerik.opcua.doctor import UaDoctor
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.types.stops import Stop
from tests.contract.opcua_stage import PLAIN, SPEC, Stage, on_stage, plan
from tests.contract.test_opcua_doctor import PASSED, WANTED

READS = ("SinuReadAll", "AlarmRead")
BOTH = {"user": "looker", "password": "sees", "writing_user": "trueflank", "writing_password_env": "TF_TEST_WRITING"}
STOPS = plan((Stop(0.0, 1), Stop(10.0, 1, 0, 1)), save_tables=True)


def users(*rights: str) -> dict[str, Any]:
    looker = {"password": "sees", "rights": list(rights)}
    return {"users": {"looker": looker, "trueflank": "trueflank"}}


@pytest.fixture(autouse=True)
def told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The writing account's password, where the site file says that it is."""
    monkeypatch.setenv("TF_TEST_WRITING", "trueflank")


async def rights_of(device: SinumerikOpcUa) -> set[str]:
    """What the server says of the user who is logged in now."""
    answer = await device._session.call("GetMyAccessRights", [], 5.0)
    return set(str(answer).split(";"))


def device(on: Stage, **settings: Any) -> SinumerikOpcUa:
    return SinumerikOpcUa("840D", on.server.url, {**PLAIN, **settings}, on.clock)


async def test_who_watches_never_takes_the_writing_account_and_who_writes_drops_it(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys, server=users(*READS)) as on:
        await on.device.close()
        made = device(on, **BOTH)
        await made.open(5.0)
        await made.state()
        await made.marker()
        assert await rights_of(made) == set(READS)
        assert on.server.requests.changing == 0
        await made.prepare_stops(STOPS)
        assert "FsWrite" in await rights_of(made)
        assert on.server.sessions == 1
        await made.close()
        assert on.server.sessions == 0
        await made.open(5.0)
        assert await rights_of(made) == set(READS)
        await made.close()


async def test_the_reading_account_alone_can_change_nothing(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys, server=users(*READS)) as on:
        await on.device.close()
        made, before = device(on, user="looker", password="sees"), on.nck.files.list("/_N_MPF_DIR")
        await made.open(5.0)
        with pytest.raises(DeviceRefused) as refused:
            await made.prepare_stops(STOPS)
        assert refused.value.code == "E-UA-RIGHTS"
        assert on.nck.files.list("/_N_MPF_DIR") == before
        await made.close()


async def test_a_wrong_password_of_the_writing_account_is_told_before_anything_is_written(
    keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TF_TEST_WRITING", "not this one")
    async with on_stage(SPEC, folder=keys, server=users(*READS)) as on:
        await on.device.close()
        made = device(on, **BOTH)
        await made.open(5.0)
        with pytest.raises(DeviceRefused) as refused:
            await made.prepare_stops(STOPS)
        assert refused.value.code == "E-UA-LOGIN"
        assert on.server.requests.changing == 0
        await made.close()
        await on.clock.sleep(0.5)
        assert on.server.sessions == 0


async def examined(keys: Path, *rights: str) -> list[tuple[str, str, str]]:
    async with on_stage(SPEC, folder=keys, server=users(*rights)) as on:
        await on.device.close()
        for axis in ("X1", "C1"):
            on.nck.files.write(f"/_N_SPF_DIR/_N_TFSELF_{axis}_SPF", PASSED.format(axis=axis).encode())
        secured = {key: value for key, value in PLAIN.items() if key != "security"}
        secured |= {"server_certificate": str(on.server.certificate), **BOTH}
        found: tuple[CheckLine, ...] = await UaDoctor("840D", on.server.url, secured, on.clock).examine(WANTED, 5.0)
        assert on.server.requests.changing == 0
        return [(line.check, line.outcome, line.code) for line in found]


async def test_the_doctor_shows_that_the_reading_account_cannot_write(keys: Path) -> None:
    found = await examined(keys, *READS)
    assert ("reading user", "ok", "W-DOC-READER") in found
    assert [check for check, _, _ in found].count("login") == 2
    assert [line for line in found if line[1] != "ok"] == []
    assert ("reading user", "wrong", "E-DOC-READER-WRITES") in await examined(keys, *READS, "FsWrite")
    assert ("reading user", "wrong", "E-DOC-RIGHTS") in await examined(keys, "StateRead")


@pytest.mark.parametrize(
    "settings",
    [
        {"user": "a", "writing_user": "a", "writing_password_env": "B"},
        {"user": "a", "writing_user": "b"},
        {"user": "a", "writing_user": "b", "writing_password_env": "B", "writing_password_file": "c"},
        {"user": "a", "writing_password_env": "B"},
    ],
)
def test_half_an_account_is_refused(settings: dict[str, str]) -> None:
    faults = UaSettings.faults({**settings, "password_env": "A", "security": "None"})
    assert [fault.key for fault in faults] == ["writing_user"]
