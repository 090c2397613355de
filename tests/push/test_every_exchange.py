"""A push in which each send and each receive fails once, in every way, at every place: never wrong, never a false word.

The control's memory is the judge (`tests.push.judging`); after the push a fresh gateway leads home over a sound wire.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.clock import LoopClock, run_virtual
from gateway.push import push_table
from tests.attacks import judged
from tests.push.judging import Played, ended, judge, settle, watching
from tests.push.sockets import HALF, KINDS, LOST, RECEIVE, SEND, Exchange, failing_calls
from tests.push.uaworld import ua_change, ua_context, ua_world
from tests.push.world import Scene, change_of, context_for, world
from tests.sizes import few

pytestmark = pytest.mark.attack

FAMILY = "a send or a receive that fails once, at every place of a push"
WAYS = [(call, kind) for call, kinds in KINDS.items() for kind in kinds]
SHARDS = 40
PATIENCE_S = 12.0


def over_modbus(root: Path, exchange: Exchange) -> Played:
    """A push through the mailbox over TCP, one call of its gateway failing, and what became of it."""
    root.mkdir(parents=True)
    found = Played(exchange.nth, [f"{exchange.call} {exchange.nth}: {exchange.kind}"])

    async def main() -> None:
        clock = LoopClock()
        async with world(Scene(), clock, url="tcp://127.0.0.1:0") as at:
            device = watching(at.driver(), at.oracle)
            await device.open(5.0)
            base = await device.saved_tables("X1")
            said: list[str] = []

            def say(code: str, /, **fields: object) -> None:
                said.append(code)
                at.person.hear(code, fields)

            more = {"say": say, "start_timeout_s": PATIENCE_S, "stop_timeout_s": PATIENCE_S}
            context = context_for(Scene(), device, clock, root, await device.identify(), **more)
            exchange.armed = True
            found.outcome = await ended(push_table(change_of(Scene(), base), context))
            exchange.armed = False
            await device.close()
            judge(at.oracle, found, said, context)
            await clock.sleep(20.0)
            fresh = at.driver()
            await fresh.open(5.0)
            try:
                await settle(at.oracle, replace(context, controller=fresh), found, willing=True)
            finally:
                await fresh.close()

    with failing_calls(exchange):
        run_virtual(main)
    return found


def over_opcua(root: Path, exchange: Exchange, keys: Path) -> Played:
    """The same over OPC UA."""
    root.mkdir(parents=True)
    found = Played(exchange.nth, [f"{exchange.call} {exchange.nth}: {exchange.kind}"])

    async def main() -> None:
        clock = LoopClock()
        async with ua_world(clock, keys) as at:
            device = watching(at.driver(), at.oracle)
            await device.open(5.0)
            base = await at.base(device)
            at.oracle.writes = 0
            said: list[str] = []

            def say(code: str, /, **fields: object) -> None:
                said.append(code)
                at.oracle.backed_up = at.oracle.backed_up or fields.get("step") == "BACKUP"
                at.person.hear(code, fields)

            more = {"say": say, "start_timeout_s": PATIENCE_S, "stop_timeout_s": PATIENCE_S}
            context = ua_context(device, clock, root, await device.identify(), **more)
            exchange.armed = True
            found.outcome = await ended(push_table(ua_change(base, at.new), context))
            exchange.armed = False
            await device.close()
            judge(at.oracle, found, said, context)
            await clock.sleep(20.0)
            await at.ready()
            at.nck.channel_reset()
            await clock.sleep(2.0)
            await at.ready()
            fresh = at.driver()
            await fresh.open(5.0)
            try:
                again = replace(context, controller=fresh, start_timeout_s=60.0)
                await settle(at.oracle, again, found, willing=True)
            finally:
                await fresh.close()

    with failing_calls(exchange):
        run_virtual(main)
    return found


def tries(places: Exchange, shard: int, of: int) -> Iterator[Exchange]:
    """Every way at every place, dealt out to ``of`` shards."""
    count = {SEND: places.sends, RECEIVE: places.receives}
    every = [(call, kind, nth) for call, kind in WAYS for nth in range(1, count[call] + 1)]
    for call, kind, nth in every[shard::of]:
        yield Exchange(call, nth, kind)


@pytest.fixture(scope="module")
def on_modbus(tmp_path_factory: pytest.TempPathFactory) -> Exchange:
    """How many sends and receives a push through the mailbox makes that nothing disturbs."""
    exchange = Exchange()
    assert over_modbus(tmp_path_factory.mktemp("count") / "push", exchange).outcome == "committed"
    return exchange


@pytest.fixture(scope="module")
def on_opcua(tmp_path_factory: pytest.TempPathFactory, keys: Path) -> Exchange:
    """The same over OPC UA."""
    exchange = Exchange()
    assert over_opcua(tmp_path_factory.mktemp("count") / "push", exchange, keys).outcome == "committed"
    return exchange


def drawn(places: Exchange, seed: str, ways: list[tuple[str, str]]) -> list[Exchange]:
    """One place for each of these ways."""
    rng = random.Random(seed)
    return [
        Exchange(call, rng.randint(1, places.sends if call == SEND else places.receives), kind) for call, kind in ways
    ]


def check(road: str, found: list[Played], exchanges: list[Exchange]) -> None:
    """Count the tries, and hold that each met its fault and nothing was wrong."""
    judged(FAMILY, road, [one.wrong for one in found])
    assert [str(one) for one in found if one.wrong] == []
    assert all(one.hit for one in exchanges)


def test_calls_of_the_mailbox_fail_at_a_seeded_place_of_some_ways(tmp_path: Path, on_modbus: Exchange) -> None:
    exchanges = drawn(on_modbus, "mailbox", WAYS[::2])
    check("mailbox", [over_modbus(tmp_path / f"{n}", one) for n, one in enumerate(exchanges)], exchanges)


def test_calls_over_opcua_fail_at_a_seeded_place_of_some_ways(tmp_path: Path, keys: Path, on_opcua: Exchange) -> None:
    exchanges = drawn(on_opcua, "OPC UA", [(SEND, LOST), (RECEIVE, HALF)])
    check("OPC UA", [over_opcua(tmp_path / f"{n}", one, keys) for n, one in enumerate(exchanges)], exchanges)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("shard", few(range(SHARDS), 0, 2))
def test_every_call_of_the_mailbox_fails_once_in_every_way(tmp_path: Path, on_modbus: Exchange, shard: int) -> None:
    exchanges = list(tries(on_modbus, shard, SHARDS))
    check("mailbox", [over_modbus(tmp_path / f"{n}", one) for n, one in enumerate(exchanges)], exchanges)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("shard", few(range(SHARDS), 0, 1))
def test_every_call_over_opcua_fails_once_in_every_way(
    tmp_path: Path, keys: Path, on_opcua: Exchange, shard: int
) -> None:
    exchanges = list(tries(on_opcua, shard, SHARDS))
    check("OPC UA", [over_opcua(tmp_path / f"{n}", one, keys) for n, one in enumerate(exchanges)], exchanges)


def test_the_count_of_places_is_that_of_a_whole_push(on_modbus: Exchange, on_opcua: Exchange) -> None:
    """A sweep over a handful of calls would prove nothing."""
    assert min(on_modbus.sends, on_modbus.receives) > 500
    assert min(on_opcua.sends, on_opcua.receives) > 200
