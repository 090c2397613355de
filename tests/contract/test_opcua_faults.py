"""Faults 46-68 of an OPC UA road, by number, as far as they concern session, values and wire; 55-57: see trust."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import random
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from asyncua.server import uaprocessor

from drivers.errors import DeadlineExceeded, DeviceRefused, LinkBroken, TransportError, TrueflankError
from drivers.sinumerik.opcua.session import connection, nodes
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.connection import Secrets
from drivers.types.stops import Stop
from simulators.opcua import SinumerikServer
from simulators.opcua.address_space import VariableSpace
from tests.contract.opcua_stage import Stage, on_stage, plan

R = [nodes.r_parameter(90 + place) for place in range(6)]
STATUS = nodes.in_channel("chanStatus")


async def refused(work: Any, *codes: str) -> TrueflankError:
    with pytest.raises(TrueflankError) as caught:
        await work
    assert caught.value.code in codes, caught.value
    assert "<" not in str(caught.value)
    return caught.value


async def session(on: Stage, url: str = "") -> UaSession:
    made = UaSession(url or on.server.url, on.clock, "test")
    await made.open(Secrets("trueflank", "trueflank"), 5.0)
    return made


class Wire:
    """A pump between client and server that can be cut after so many bytes, or swallow everything."""

    def __init__(self, url: str) -> None:
        self._port = int(url.rpartition(":")[2])
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._writers: list[asyncio.StreamWriter] = []
        self.url = ""
        self.swallow = False
        self.left: dict[str, int | None] = {"up": None, "down": None}
        self.passed = {"up": 0, "down": 0}

    async def start(self) -> None:
        self._server = await asyncio.start_server(self._joined, "127.0.0.1", 0)
        self.url = f"opc.tcp://127.0.0.1:{self._server.sockets[0].getsockname()[1]}"

    async def _joined(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, beyond = await asyncio.open_connection("127.0.0.1", self._port)
        self._writers += [writer, beyond]
        for way, source, sink in (("up", reader, beyond), ("down", there, writer)):
            task = asyncio.get_running_loop().create_task(self._pump(way, source, sink))
            self._tasks.add(task)

    async def _pump(self, way: str, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await source.read(65536):
                left = self.left[way]
                if left is not None:
                    data, self.left[way] = data[:left], left - len(data[:left])
                if not self.swallow:
                    sink.write(data)
                    self.passed[way] += len(data)
                if self.left[way] == 0:
                    break
        await self.cut()

    async def cut(self) -> None:
        for writer in self._writers:
            writer.transport.abort()

    async def stop(self) -> None:
        if self._server is not None:
            self._server.close()
            await self.cut()
            await asyncio.gather(*self._tasks, return_exceptions=True)
            await self._server.wait_closed()


@contextlib.asynccontextmanager
async def wire(on: Stage) -> AsyncIterator[Wire]:
    made = Wire(on.server.url)
    await made.start()
    try:
        yield made
    finally:
        await made.stop()


async def test_fault_46_renewing_the_channel_loses_and_doubles_no_write(
    keys: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection, "CHANNEL_S", 30.0)

    async with on_stage(folder=keys) as on:
        settings = {"security": "Basic256Sha256", "server_certificate": str(on.server.certificate)}
        device = on.driver(**settings, client_folder=str(tmp_path))
        await device.open(5.0)
        renewed = set()
        for number in range(120):
            await device._session.write([(R[0], float(number))], 5.0)
            assert on.nck.get("R[90]") == number
            renewed.add(device._session._renew_at)
            await on.clock.sleep(1.0)
        assert len(renewed) >= 6
        assert on.server.requests.written[R[0]] == 120
        await device.close()


async def test_fault_47_a_session_is_kept_alive_and_its_loss_is_told(keys: Path) -> None:
    async with on_stage(folder=keys, server={"session_timeout_s": 2.0}) as on:
        await on.clock.sleep(60.0)
        assert (await on.device.state()).mode == "AUTO"
        assert on.device._session._alive is not None
        on.device._session._alive.cancel()
        await on.clock.sleep(10.0)
        assert on.server.sessions == 0
        await refused(on.device.state(), "E-UA-LOST", "E-UA-CONNECT")
        await refused(on.device.state(), "E-UA-BROKEN")
        await on.device.open(5.0)
        assert (await on.device.state()).mode == "AUTO"


async def test_a_session_ends_by_the_loop_s_time_however_long_the_computer_took(
    keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In virtual time the wall's clock says how busy the computer is: asyncua's own watchdog must not judge by it."""
    late = itertools.count(1e9, 100.0)
    async with on_stage(folder=keys, server={"session_timeout_s": 20.0}) as on:
        monkeypatch.setattr(uaprocessor, "time", SimpleNamespace(monotonic=lambda: next(late)))
        for _ in range(10):
            await on.clock.sleep(3.0)
            assert (await on.device.state()).mode == "AUTO"


async def test_fault_48_49_a_restarted_server_with_another_name_space_index(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        port = int(on.server.url.rpartition(":")[2])
        await on.device.prepare_stops(plan((Stop(5.0, 1),)))
        await on.server.stop()
        await refused(on.device.abort_program(), "E-UA-CONNECT", "E-UA-LOST")
        on.server = SinumerikServer(on.nck, on.clock, {"folder": str(keys), "port": port, "name_space": 7})
        await on.server.start()
        await refused(on.device.abort_program(), "E-UA-BROKEN")
        assert on.server.requests.services["write"] == 0
        await on.device.open(5.0)
        assert on.device._session.name_space == 7
        await on.device.abort_program()
        assert on.nck.get("R[86]") == 1.0
        await on.device.close()
        await on.server.stop()


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("most", [1, 5, 100])
async def test_fault_50_no_more_nodes_in_one_request_than_the_server_takes(keys: Path, most: int, told: bool) -> None:
    async with on_stage(folder=keys) as on:
        on.server.quirks.most_read = on.server.quirks.most_write = most
        on.server.quirks.tells_limits = told
        device = on.driver()
        await device.open(5.0)
        assert len((await device.state()).axes) == 3
        values = [(path, float(place)) for place, path in enumerate(R)]
        refusals = on.server.requests.services["read"]
        await device._session.write(values, 5.0)  # what reads have found holds for writes
        assert [on.nck.get(f"R[{90 + place}]") for place in range(6)] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
        found = device._session.found_limit
        assert found is None if told or most == 100 else 1 <= found <= most
        await device.close()
        await device.open(5.0)
        begun = on.server.requests.services["read"]
        await device.state()
        again = on.server.requests.services["read"] - begun
        assert device._session.found_limit == found, "remembered over a new login"
        assert again <= refusals, "no size is tried a second time"
        await device.close()


async def test_a_write_that_no_read_has_found_a_limit_for_is_refused_whole_and_not_repeated(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        device = on.driver()
        await device.open(5.0)
        on.server.quirks.most_write, on.server.quirks.tells_limits = 5, False
        values = [(path, float(place)) for place, path in enumerate(R)]
        before = on.server.requests.services["write"]
        error = await refused(device._session.write(values, 5.0), "E-UA-LIMIT")
        assert error.fields["status"] == "BadTooManyOperations"
        assert on.server.requests.services["write"] == before + 1
        assert not on.server.requests.written
        await device.close()


@pytest.mark.parametrize("status", ["BadNotConnected", "BadCommunicationError", "BadOutOfService"])
async def test_fault_51_an_nck_that_does_not_answer_behind_its_server(keys: Path, status: str) -> None:
    async with on_stage(folder=keys) as on:
        on.server.quirks.read_status[STATUS] = status
        error = await refused(on.device.state(), "E-UA-NCK-DOWN")
        assert error.retryable
        on.server.quirks.read_status.clear()
        on.server.quirks.write_status[R[0]] = status
        error = await refused(on.device._session.write([(R[0], 1.0)], 5.0), "E-UA-NCK-DOWN")
        assert not error.retryable
        assert (await on.device.state()).mode == "AUTO"


async def test_fault_52_a_slow_server_meets_the_deadline_and_one_write_at_a_time(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        times: list[float] = []
        quirks = on.server.quirks
        quirks.on_request = lambda service: times.append(on.clock.now()) if service == "write" else None
        made = await session(on)
        quirks.answer_s = 0.5
        await asyncio.gather(*(made.write([(path, 1.0)], 5.0) for path in R[:3]))
        assert [after - before >= 0.5 for before, after in itertools.pairwise(times)] == [True, True]
        quirks.answer_s, quirks.late_write_s = 0.0, 20.0
        started = on.clock.now()
        with pytest.raises(DeadlineExceeded):
            await made.write([(R[4], 7.0)], 5.0)
        assert on.clock.now() - started == pytest.approx(5.0, abs=0.1)
        with pytest.raises(LinkBroken):
            await made.write([(R[4], 7.0)], 5.0)
        assert on.nck.get("R[94]") == 0.0
        await on.clock.sleep(30.0)
        quirks.late_write_s = 0.0
        fresh = await session(on)
        (found,) = await fresh.read([R[4]], 5.0)
        assert found.value == on.nck.get("R[94]")
        assert on.server.requests.written[R[4]] <= 1
        await fresh.close()


async def test_fault_53_alarm_events_that_never_come_cost_a_bounded_time_and_disturb_nothing(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        on.nck.core.alarms.raise_(700012, "coolant low", "cancel")
        reader = on.device._reader
        assert await reader.alarm_texts(1) == "700012 coolant low"
        on.server.quirks.mute_events = True
        started = on.clock.now()
        assert await reader.alarm_texts(1) == "coolant low"
        assert on.clock.now() - started < 12.0
        assert (await on.device.state()).alarms == (700012,)
        assert on.server.sessions == 1


@pytest.mark.parametrize("server", [{"alarm_events": False}, {"session_limit": 1}])
async def test_alarm_texts_without_events_come_from_variables(keys: Path, server: dict[str, Any]) -> None:
    async with on_stage(folder=keys, server=server) as on:
        on.nck.core.alarms.raise_(20124, "sum of compensation too high", "cancel")
        on.nck.core.alarms.raise_(10720, "software limit", "reset")
        assert await on.device._reader.alarm_texts(2) == "sum of compensation too high; software limit"


async def test_alarm_events_tell_the_gravest_first_and_what_is_gone_is_gone(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        on.nck.core.alarms.raise_(20124, "sum of compensation too high", "cancel")
        on.nck.core.alarms.raise_(10720, "software limit", "reset")
        assert await on.device._reader.alarm_texts(2) == "10720 software limit; 20124 sum of compensation too high"
        on.nck.channel_reset()
        told = await on.device._session.alarm_events(5.0)
        assert [(alarm.number, alarm.severity, alarm.standing) for alarm in told or ()] == [(20124, 500, True)]


async def test_fault_54_an_old_or_uncertain_value_is_no_state(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        quirks = on.server.quirks
        assert (await on.device.state()).mode == "AUTO"
        quirks.stale_s = 3.0
        error = await refused(on.device.state(), "E-UA-STALE")
        assert error.retryable
        lenient = on.driver(stale_s=0.0)
        await lenient.open(5.0)
        assert (await lenient.state()).mode == "AUTO"
        await lenient.close()
        quirks.stale_s = 0.0
        quirks.read_status[nodes.OPERATING_MODE] = "UncertainLastUsableValue"
        await refused(on.device.state(), "E-UA-STALE")
        quirks.read_status.clear()
        assert (await on.device.state()).mode == "AUTO"


@pytest.mark.parametrize("kind", ["Int64", "Int32", "Float", "String"])
async def test_fault_58_another_type_than_the_nodes_is_refused_and_said_so(
    keys: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    async with on_stage(folder=keys) as on:
        made = await session(on)
        with monkeypatch.context() as patch:
            patch.setattr(nodes, "kind_of", lambda _path: "Double")
            on.server._core.kind = lambda _path: kind  # type: ignore[method-assign]
            await refused(made.write([(R[0], 2.0)], 5.0), "E-UA-TYPE")
        assert on.nck.get("R[90]") == 0.0
        await made.close()


@pytest.mark.parametrize("change", [lambda values: values[:-1], lambda values: [*values, 0.0], lambda values: []])
async def test_fault_59_a_block_of_the_wrong_length_is_not_taken(
    keys: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[list[Any]], list[Any]]
) -> None:
    async with on_stage(folder=keys) as on:
        whole = VariableSpace._values

        def wrong(self: VariableSpace, address: Any) -> list[Any]:
            values = whole(self, address)
            return change(values) if address.name == "R" and address.last is not None else values

        monkeypatch.setattr(VariableSpace, "_values", wrong)
        await refused(on.device._dialogue.look(), "E-UA-VALUE", "E-UA-PROTOCOL")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
async def test_fault_60_what_is_no_number_is_never_sent(keys: Path, value: float) -> None:
    async with on_stage(folder=keys) as on:
        before = on.server.requests.services["write"]
        await refused(on.device._session.write([(R[0], 1.0), (R[1], value)], 5.0), "E-UA-NUMBER")
        assert on.server.requests.services["write"] == before
        assert on.nck.get("R[90]") == 0.0


@pytest.mark.parametrize("place", range(6))
async def test_fault_61_a_batch_of_which_one_is_refused_is_told_as_such(keys: Path, place: int) -> None:
    async with on_stage(folder=keys) as on:
        on.server.quirks.write_status[R[place]] = "BadUserAccessDenied"
        values = [(path, 5.0) for path in R]
        error = await refused(on.device._session.write(values, 5.0), "E-UA-PARTIAL")
        assert error.fields["written"] == 5
        assert str(error.fields["refused"]) == f"{R[place]} BadUserAccessDenied"
        on.server.quirks.write_status = dict.fromkeys(R, "BadUserAccessDenied")
        await refused(on.device._session.write(values, 5.0), "E-UA-RIGHTS")


@pytest.mark.parametrize("status", ["GoodCompletesAsynchronously", "GoodClamped", "UncertainNotAllNodesAvailable"])
async def test_fault_62_what_is_not_plainly_good_is_not_confirmed(keys: Path, status: str) -> None:
    async with on_stage(folder=keys) as on:
        on.server.quirks.write_status[R[0]] = status
        error = await refused(on.device._session.write([(R[0], 5.0)], 5.0), "E-UA-UNCONFIRMED")
        assert isinstance(error, TransportError)
        assert not error.retryable
        assert on.device._session.is_open


async def test_fault_65_the_right_to_write_is_seen_without_writing(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        made = await session(on)
        assert await made.user_may_write(R[0], 5.0) is True
        assert await made.user_may_write(STATUS, 5.0) is False
        assert await made.user_may_write("/NC/_N_AX_TEA_ACX/$MA_ENC_COMP_ENABLE[u1,1]", 5.0) is False
        assert await made.user_may_write("/Channel/State/nothing", 5.0) is None
        assert on.server.requests.services["write"] == 0
        await made.close()


@pytest.mark.parametrize("service", ["open", "read", "write", "call", "alarms"])
async def test_fault_66_a_black_hole_at_each_step_ends_at_the_deadline(keys: Path, service: str) -> None:
    async with on_stage(folder=keys) as on, wire(on) as between:
        made = UaSession(between.url, on.clock, "test")
        if service != "open":
            await made.open(Secrets("trueflank", "trueflank"), 5.0)
        between.swallow = True
        works = {
            "open": lambda: made.open(Secrets("trueflank", "trueflank"), 3.0),
            "read": lambda: made.read([STATUS], 3.0),
            "write": lambda: made.write([(R[0], 1.0)], 3.0),
            "call": lambda: made.call("GetMyAccessRights", [], 3.0),
            "alarms": lambda: made.alarm_events(3.0),
        }
        started = on.clock.now()
        await refused(works[service](), "E-LINK-DEADLINE")
        assert on.clock.now() - started == pytest.approx(3.0, abs=0.2)
        assert not made.is_open
        await made.close()
        assert on.nck.get("R[90]") == 0.0


@pytest.mark.parametrize("way", ["up", "down"])
async def test_fault_67_a_wire_cut_after_each_byte_of_a_write_leaves_old_or_new(keys: Path, way: str) -> None:
    async with on_stage(folder=keys) as on:
        async with wire(on) as between:
            made = await session(on, between.url)
            between.passed = {"up": 0, "down": 0}
            await made.write([(R[0], 1.0), (R[1], 1.0)], 5.0)
            length = between.passed[way]
            await made.close()
        old, outcomes = 1.0, set()
        for cut in sorted({0, 1, length - 1, *random.Random(67).sample(range(2, length - 1), 14)}):
            new = old + 1.0
            async with wire(on) as between:
                made = await session(on, between.url)
                between.left[way] = cut
                with pytest.raises(TransportError):
                    await made.write([(R[0], new), (R[1], new)], 5.0)
                assert not made.is_open
                await made.close()
            await on.clock.sleep(0.1)
            found = on.nck.get("R[90]"), on.nck.get("R[91]")
            assert found in ((old, old), (new, new)), cut
            outcomes.add(found[0] == new)
            old = float(found[0])
        assert outcomes == ({False} if way == "up" else {True})


async def test_fault_68_a_full_server_is_left_alone_and_gets_its_session_back(keys: Path) -> None:
    async with on_stage(folder=keys, server={"session_limit": 2}) as on:
        guest = await session(on)
        await refused(session(on), "E-UA-SESSIONS")
        assert on.server.sessions == 2
        assert (await on.device.state()).mode == "AUTO"
        await guest.close()
        assert on.server.sessions == 1
        again = await session(on)
        await again.close()


async def test_refusals_are_devices_and_lost_wires_are_transports(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        made = await session(on)
        error = await refused(made.write([(STATUS, 1)], 5.0), "E-UA-RIGHTS")
        assert isinstance(error, DeviceRefused)
        await on.server.drop_connections()
        error = await refused(made.read([STATUS], 5.0), "E-UA-CONNECT")
        assert isinstance(error, TransportError)
        await made.close()
