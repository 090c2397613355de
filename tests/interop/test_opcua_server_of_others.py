"""Our OPC UA driver against servers of other stacks, with the control double's memory behind their nodes."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.errors import DeviceRefused, TrueflankError
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.certificates import own_key_pair
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.connection import APPLICATION_URI, read_secrets
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.types.stops import Stop
from simulators.nck import Nck
from tests.contract.opcua_stage import ORDER, SPEC, Stage, plan
from tests.interop.peers import SERVERS, PeerServer, peer_server

pytestmark = pytest.mark.interop
USERS = {"trueflank": "secret"}
SPEED = 40.0


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Key pairs of both sides, made once."""
    folder = tmp_path_factory.mktemp("keys")
    own_key_pair(folder / "ours", "trueflank", APPLICATION_URI, "localhost")
    return folder


class Across(Stage):
    """A stage whose server is another stack's."""

    def settings(self, keys: Path, **more: Any) -> dict[str, Any]:
        certificate = str(self.server.certificate)
        given = {"user": "trueflank", "password": "secret", "server_certificate": certificate}
        return {**given, "client_folder": str(keys / "ours"), "poll_s": 0.1, "fast_poll_s": 0.01, **more}


@contextlib.asynccontextmanager
async def across(stack: str, keys: Path, trusted: bool = True, **options: Any) -> AsyncIterator[Across]:
    clock = LoopClock(SPEED)
    nck = Nck(SPEC, clock)
    await nck.start()
    own = [keys / "ours" / "trueflank.der"] if trusted else []
    operator: asyncio.Task[None] | None = None
    try:
        async with peer_server(stack, nck, keys / "peer", own, USERS, **options) as peer:
            made = Across(clock, nck, peer, None)  # type: ignore[arg-type]
            made.device = SinumerikOpcUa("840D", peer.url, made.settings(keys), LoopClock())
            operator = asyncio.get_running_loop().create_task(made.operate())
            await made.referenced()
            yield made
            await made.device.close()
    finally:
        if operator is not None:
            operator.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await operator
        await nck.stop()


def run(act: Callable[[Across], Coroutine[Any, Any, None]], stack: str, keys: Path, **options: Any) -> None:
    async def main() -> None:
        async with across(stack, keys, **options) as made:
            await act(made)

    asyncio.run(main())


async def refused(work: Any, code: str) -> TrueflankError:
    with pytest.raises(TrueflankError) as caught:
        await work
    assert caught.value.code == code, caught.value
    return caught.value


@pytest.mark.parametrize("stack", SERVERS)
def test_a_stop_program_and_a_whole_push_go_through(stack: str, keys: Path) -> None:
    async def act(on: Across) -> None:
        identity = await on.device.open(10.0)
        assert (identity.serial, identity.firmware) == (SPEC.serial, SPEC.nck_version)
        state = await on.device.state()
        assert (state.mode, tuple(state.axes)) == ("AUTO", ("X1", "Z1", "C1"))
        seen = await on.walk(plan((Stop(5.0, 1), Stop(10.0, 1))))
        assert [stop.target for stop in seen] == [5.0, 10.0]
        assert (await on.device.saved_tables("C1")).own.table.deviations == (0.0,)
        assert await on.push(ORDER)
        assert on.enabled
        await on.walk(plan((Stop(200.0, 1),)))
        live = await on.device.saved_tables("C1")
        assert live.own.enabled
        assert len(live.own.table.deviations) == len(ORDER.table.deviations)

    run(act, stack, keys)


@pytest.mark.parametrize("stack", SERVERS)
def test_another_name_space_index_and_a_small_batch_limit(stack: str, keys: Path) -> None:
    async def act(on: Across) -> None:
        await on.device.open(10.0)
        assert on.device._session.name_space == 6
        assert on.device._session._limits.read == {"node-opcua": 7, "open62541": 65535}[stack]  # it has no limit to set
        assert len((await on.device.state()).axes) == 3
        await on.device.prepare_stops(plan((Stop(5.0, 1),)))
        assert on.nck.selected.endswith("TFMEAS_C1_MPF")

    run(act, stack, keys, fillers=4, most=7, strict=True)


@pytest.mark.parametrize("stack", SERVERS)
def test_wrong_password_unknown_certificates_and_other_refusals(stack: str, keys: Path, tmp_path: Path) -> None:
    async def act(on: Across) -> None:
        def driver(**settings: Any) -> SinumerikOpcUa:
            return SinumerikOpcUa("840D", on.server.url, on.settings(keys, **settings), LoopClock())

        await refused(driver(password="wrong").open(10.0), "E-UA-LOGIN")
        await refused(driver(user="nobody").open(10.0), "E-UA-LOGIN")
        await refused(driver(client_folder=str(tmp_path / "new")).open(10.0), "E-UA-TRUST-US")
        other = own_key_pair(tmp_path, "other", "urn:interop:server", "127.0.0.1", server=True)
        await refused(driver(server_certificate=str(other.certificate)).open(10.0), "E-UA-TRUST")

        session = UaSession(on.server.url, LoopClock(), "peer")
        settings = UaSettings.read(on.settings(keys), "peer")
        await session.open(await asyncio.to_thread(read_secrets, settings, "peer"), 10.0)
        await session.write([(nodes.r_parameter(90), 1.25)], 5.0)
        (block,) = await session.read([nodes.r_block(80, 20)], 5.0)
        assert block.value[10] == 1.25
        for value in (True, "text"):
            wrong = replace_kind(session, nodes.r_parameter(90), value)
            await refused(wrong, "E-UA-TYPE")
        await refused(session.write([(nodes.in_channel("chanStatus"), 1)], 5.0), "E-UA-RIGHTS")
        absent = await session.read(["/Channel/State/none", nodes.ALARM_COUNT], 5.0)
        assert [one.status for one in absent] == ["BadNodeIdUnknown", ""]
        mixed = [(nodes.r_parameter(91), 2.0), ("/Channel/Parameter/R[u1,999]", 2.0)]
        error = await refused(session.write(mixed, 5.0), "E-UA-PARTIAL")
        assert error.fields["written"] == 1
        assert on.nck.get("R[91]") == 2.0
        await refused(session.call("Select", [("x", "String"), ("1", "String")], 5.0), "E-UA-TYPE")
        assert on.nck.get("R[90]") == 1.25
        await session.close()

    run(act, stack, keys)


async def replace_kind(session: UaSession, path: str, value: Any) -> None:
    """Write a value in its own type instead of the node's."""
    kind = "Boolean" if isinstance(value, bool) else "String"
    original = nodes.kind_of
    nodes.kind_of = lambda _path: kind  # type: ignore[assignment]
    try:
        await session.write([(path, value)], 5.0)
    finally:
        nodes.kind_of = original


@pytest.mark.parametrize("stack", SERVERS)
def test_a_server_that_ends_in_mid_conversation(stack: str, keys: Path) -> None:
    async def act(on: Across) -> None:
        await on.device.open(10.0)
        assert isinstance(on.server, PeerServer)
        await on.server.stop()
        with pytest.raises(TrueflankError) as caught:
            await on.device.state()
        assert not isinstance(caught.value, DeviceRefused)
        await refused(on.device.state(), "E-UA-BROKEN")

    run(act, stack, keys)
