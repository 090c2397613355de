"""The bridge codec and its records against the worked exchange, cut and damaged in every way."""

from __future__ import annotations

import contextlib
import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bridge.codec import (
    LINE_BYTES,
    BridgeCodec,
    BridgeRefusal,
    Damaged,
    Message,
    Notification,
    Reply,
    Request,
)
from drivers.bridge.device import BridgeStream
from drivers.bridge.records import (
    BridgeIdentity,
    BridgeSamples,
    CalibratorStatus,
    Event,
    environment_as_object,
    read_environment,
    read_optics,
)
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.types.sensing import Ambient

ROOT = Path(__file__).parents[3]
EXCHANGE = (ROOT / "tests/golden/bridge/exchange.txt").read_text(encoding="utf-8").splitlines()
MEANING = json.loads((ROOT / "tests/golden/bridge/meaning.json").read_text(encoding="utf-8"))
CHANNELS = ("device_deg", "laser_deg")


def wire(direction: str) -> bytes:
    return "".join(line[2:] + "\n" for line in EXCHANGE if line[0] == direction).encode("utf-8")


def read(role: Any, pieces: list[bytes]) -> list[Message]:
    codec = BridgeCodec(role)
    return [message for piece in pieces for message in codec.receive(piece)]


def gist(message: Message) -> list[Any]:
    """A message in the words of meaning.json."""
    match message:
        case Request(number, method, params):
            return ["Request", number, method, params]
        case BridgeRefusal(number, code, text, _data):
            return ["Refusal", number, code, text]
        case _:
            return [type(message).__name__]


def test_the_transcript_is_the_one_in_the_specification() -> None:
    text = (ROOT / "docs/instrument-bridge.md").read_text(encoding="utf-8")
    assert "\n".join(EXCHANGE) in text


def test_bytes_to_messages() -> None:
    ends = {">": iter(read("server", [wire(">")])), "<": iter(read("client", [wire("<")]))}
    for line, wanted in zip(EXCHANGE, MEANING, strict=True):
        message = next(ends[line[0]])
        if isinstance(message, Reply):
            found = message.result if wanted[2] is None else message.result[wanted[2]]
            assert ["Reply", message.id, wanted[2], found] == wanted
        elif isinstance(message, Notification):
            assert ["Notification", message.method, wanted[2], message.params[wanted[2]]] == wanted
        else:
            assert gist(message) == wanted


@pytest.mark.parametrize(("direction", "reader", "writer"), [(">", "server", "client"), ("<", "client", "server")])
def test_messages_to_bytes(direction: str, reader: Any, writer: Any) -> None:
    codec = BridgeCodec(writer)
    assert b"".join(codec.send(message) for message in read(reader, [wire(direction)])) == wire(direction)


@pytest.mark.parametrize(("direction", "role"), [(">", "server"), ("<", "client")])
def test_every_cut_gives_the_same(direction: str, role: Any) -> None:
    data = wire(direction)
    whole = read(role, [data])
    for cut in range(len(data) + 1):
        assert read(role, [data[:cut], data[cut:]]) == whole
    assert read(role, [data[at : at + 1] for at in range(len(data))]) == whole
    assert read(role, [data.replace(b"\n", b"\r\n")]) == whole
    assert read(role, [data.replace(b"\n", b"\n\n")]) == whole


@pytest.mark.parametrize(
    "line",
    [
        b"hello",
        b"[]",
        b"{}",
        b'{"jsonrpc":"1.0","id":1,"result":1}',
        b'{"jsonrpc":"2.0","id":1}',
        b'{"jsonrpc":"2.0","id":1,"result":1,"error":{"code":1,"message":"x"}}',
        b'{"jsonrpc":"2.0","id":"1","result":1}',
        b'{"jsonrpc":"2.0","id":true,"result":1}',
        b'{"jsonrpc":"2.0","id":1.0,"result":1}',
        b'{"jsonrpc":"2.0","id":null,"result":1}',
        b'{"jsonrpc":"2.0","id":1,"result":NaN}',
        b'{"jsonrpc":"2.0","id":1,"result":Infinity}',
        b'{"jsonrpc":"2.0","id":1,"error":{"code":"x","message":"x"}}',
        b'{"jsonrpc":"2.0","id":1,"error":"x"}',
        b'{"jsonrpc":"2.0","method":"x","params":[1]}',
        b'{"jsonrpc":"2.0","method":7}',
        b'{"jsonrpc":"2.0","id":1,"result":"\xff"}',
        b'{"jsonrpc":"2.0","id":1,"method":"x"}',
        b"[" * 100_000,
        b"9" * 5000,
    ],
)
def test_what_is_no_message_for_a_client_comes_as_damaged(line: bytes) -> None:
    good = b'{"jsonrpc":"2.0","id":1,"result":{}}\n'
    first, middle, last = read("client", [good + line + b"\n" + good])
    assert first == last == Reply(1, {})
    assert isinstance(middle, Damaged)
    assert middle.why


def test_an_endless_line_is_bounded() -> None:
    codec = BridgeCodec("client")
    for _ in range(40):
        assert codec.receive(b"x" * 100_000) == ()
        assert codec._held < LINE_BYTES
    damaged, reply = codec.receive(b'\n{"jsonrpc":"2.0","id":1,"result":{}}\n')
    assert isinstance(damaged, Damaged)
    assert reply == Reply(1, {})


def test_each_role_says_only_what_is_its_own() -> None:
    with pytest.raises(LocalProtocolError, match="E-BRIDGE-ROLE"):
        BridgeCodec("client").send(Reply(1, {}))
    with pytest.raises(LocalProtocolError, match="E-BRIDGE-ROLE"):
        BridgeCodec("server").send(Request(1, "x"))
    for params in ({"a": float("nan")}, {"a": {1, 2}}, {"a": "x" * LINE_BYTES}):
        with pytest.raises(LocalProtocolError, match="E-BRIDGE-MESSAGE"):
            BridgeCodec("client").send(Request(1, "x", params))


def digest(message: Message) -> None:
    """Do with a message what the device does: read its content."""
    if isinstance(message, Notification):
        block = BridgeStream(CHANNELS, "x").take(BridgeSamples.read(message.params, CHANNELS, "x"))
        if block is not None:
            assert np.isfinite(block.values).all()
            assert block.values.shape == (len(block), 2)
            assert block.valid.shape == (len(block),)
    if isinstance(message, Reply):
        for reader in (BridgeIdentity.read, CalibratorStatus.read, read_environment, read_optics):
            with contextlib.suppress(RemoteProtocolError):
                reader(message.result, "x")


def test_fuzz_from_the_transcript() -> None:
    """Mutated lines are messages or damaged, their content is right or RemoteProtocolError: nothing else."""
    chance = random.Random(7)
    lines = wire("<").splitlines(keepends=True)
    outcomes = {"good": 0, "damaged": 0, "refused": 0}
    for _ in range(4000):
        line = bytearray(chance.choice(lines))
        for _ in range(chance.randrange(1, 4)):
            at = chance.randrange(len(line))
            match chance.randrange(4):
                case 0:
                    del line[at : at + chance.randrange(1, 9)]
                case 1:
                    line[at:at] = chance.choice([b"0", b"-", b"e999", b"null", b'"', b"[", b"}", b"1" * 400, b"\xc3"])
                case 2:
                    line[at] ^= 1 << chance.randrange(8)
                case _:
                    line[at:at] = line[at : at + 20]
            line = line or bytearray(b"\n")
        for message in read("client", [bytes(line) + b"\n"]):
            if isinstance(message, Damaged):
                outcomes["damaged"] += 1
                continue
            try:
                digest(message)
                outcomes["good"] += 1
            except RemoteProtocolError:
                outcomes["refused"] += 1
    assert all(count > 50 for count in outcomes.values()), outcomes


@given(st.binary(max_size=300))
@settings(max_examples=150, deadline=None)
def test_any_bytes_are_survived(data: bytes) -> None:
    for role in ("client", "server"):
        read(role, [data, b"\n"])


def test_records_survive_the_wire() -> None:
    identity = BridgeIdentity(
        "rotary_calibrator", "Example", "RC-1", "K1", "2", CHANNELS, 100.0, notices=("sees no drift",)
    )
    samples = BridgeSamples(
        7, 1.5, 0.01, {name: np.array([0.5, -1.0]) for name in CHANNELS}, np.array([True, False]), 3,
        (Event("beam_obstructed", 1.51),),
    )  # fmt: skip
    status = CalibratorStatus(True, False, 87.0)
    ambient = Ambient(20.1, None, 46.0, (20.0, 20.2), 3.5)
    for record, back in (
        (identity.as_object(), lambda found: BridgeIdentity.read(found, "x").as_object()),
        (samples.as_object(), lambda found: BridgeSamples.read(found, CHANNELS, "x").as_object()),
        (status.as_object(), lambda found: CalibratorStatus.read(found, "x").as_object()),
        (environment_as_object(ambient), lambda found: environment_as_object(read_environment(found, "x"))),
    ):
        assert back(json.loads(json.dumps(record))) == record


IDENTITY: dict[str, Any] = {
    "protocol": 1, "kind": "rotary_calibrator", "maker": "m", "model": "o", "serial": "s",
    "sample_rate_hz": 100, "compensated_for": "nothing", "channels": ["laser_deg", "device_deg"],
}  # fmt: skip


def test_channels_come_in_the_order_of_the_port_whatever_the_bridge_says() -> None:
    assert BridgeIdentity.read(IDENTITY, "x").channels == CHANNELS
    assert BridgeIdentity.read(IDENTITY | {"more": 1}, "x").firmware == ""


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "toaster"},
        {"channels": ["device_deg"]},
        {"channels": ["device_deg", "laser_deg", "laser_deg"]},
        {"kind": "angle", "channels": ["pitch"]},
        {"compensated_for": "everything"},
        {"sample_rate_hz": -1},
        {"sample_rate_hz": "100"},
        {"sample_rate_hz": 10**400},
        {"serial": None},
        {"notices": "none"},
        {"protocol": True},
    ],
)
def test_a_wrong_identity_names_its_member(change: dict[str, Any]) -> None:
    with pytest.raises(RemoteProtocolError) as caught:
        BridgeIdentity.read(IDENTITY | change, "x")
    assert caught.value.fields["field"] in {*change, "channels"}


SAMPLES: dict[str, Any] = {"sequence": 0, "t0_s": 1.0, "dt_s": 0.1, "values": {"device_deg": [1], "laser_deg": [2]}}


@pytest.mark.parametrize(
    "change",
    [
        {"values": {"device_deg": [1]}},
        {"values": {"device_deg": [1], "laser_deg": [2, 3]}},
        {"values": {"device_deg": [1], "laser_deg": ["2"]}},
        {"values": {"device_deg": [1], "laser_deg": [True]}},
        {"values": {"device_deg": [1], "laser_deg": [1e999]}},
        {"values": {"device_deg": [1], "laser_deg": [10**400]}},
        {"values": [[1], [2]]},
        {"dt_s": 0},
        {"t0_s": None},
        {"sequence": -1},
        {"sequence": 1.5},
        {"valid": [1]},
        {"valid": [True, True]},
        {"lost": -1},
        {"events": [{"kind": "x"}]},
        {"events": {"kind": "x", "at_s": 1}},
    ],
)
def test_wrong_samples_are_refused(change: dict[str, Any]) -> None:
    BridgeSamples.read(SAMPLES, CHANNELS, "x")
    with pytest.raises(RemoteProtocolError, match="E-BRIDGE-FIELD"):
        BridgeSamples.read(SAMPLES | change, CHANNELS, "x")


def block(sequence: int, count: int = 2, **more: Any) -> BridgeSamples:
    columns = {name: np.zeros(count) for name in CHANNELS}
    valid = more.pop("valid", np.ones(count, bool))
    return BridgeSamples(sequence, more.pop("t0_s", sequence * 0.1), 0.1, columns, valid, **more)


def test_fault_37_the_stream_counts_loss_and_drops_repeats() -> None:
    stream = BridgeStream(CHANNELS, "x")
    taken = [stream.take(block(number)) for number in (0, 2, 7, 7, 0, 9)]
    assert [None if found is None else found.lost for found in taken] == [0, 0, 3, None, None, 0]
    assert stream.repeats == 2


def test_fault_28_a_clock_that_runs_back_is_an_error() -> None:
    stream = BridgeStream(CHANNELS, "x")
    stream.take(block(5))
    with pytest.raises(RemoteProtocolError, match="E-BRIDGE-CLOCK"):
        stream.take(block(7, t0_s=0.55))


def test_fault_23_samples_after_a_break_are_invalid_until_the_datum() -> None:
    stream = BridgeStream(CHANNELS, "x")
    events = (Event("beam_obstructed", 0.15), Event("datum", 0.35))
    found = stream.take(block(0, 5, events=events))
    assert found is not None
    assert found.valid.tolist() == [True, True, False, False, True]
    assert [*map(str, found.events)] == ["beam_obstructed at 0.150000 s", "datum at 0.350000 s"]
