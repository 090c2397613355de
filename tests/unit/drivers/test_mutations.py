"""A hundred thousand mutated inputs for each line parser: our damage with a reason, or exactly what was meant."""

from __future__ import annotations

import contextlib
import json
import random
import re
from pathlib import Path

import numpy as np
import pytest

from drivers.attocube.codec import AttocubeCodec, Result
from drivers.attocube.codec import DamagedReply as IdsDamaged
from drivers.bridge.codec import BridgeCodec, BridgeRefusal, Damaged, Notification, Reply
from drivers.bridge.records import BridgeIdentity, BridgeSamples, CalibratorStatus, read_environment, read_optics
from drivers.errors import RemoteProtocolError
from drivers.umd.codec import SEQUENCE, UmdCodec, encode_rows
from tests.sizes import few

GOLDEN = Path(__file__).parents[2] / "golden"
CHANNELS = ("device_deg", "laser_deg")
COUNT = 100_000
few_ways = pytest.mark.parametrize("count", few([COUNT // 10, COUNT]))
BYTES = [b"0", b"-", b" ", b"  ", b"\r", b"\n", b"1e9", b".5", b",", b"+", b"\0", b"\xff", b"9" * 30, b"x", b"\t"]
JSON_BYTES = [b"0", b"-", b"e999", b"null", b'"', b"[", b"}", b"1" * 400, b"\xc3", b"NaN", b"\n", b"\0", b",", b" "]


def mutated(chance: random.Random, data: bytes, pieces: list[bytes]) -> bytes:
    """One to three changes: a byte's bit, a piece put in, bytes cut out or doubled."""
    bent = bytearray(data)
    for _ in range(chance.randrange(1, 4)):
        at = int(chance.random() * len(bent))
        kind = int(chance.random() * 4)
        if kind == 0:
            del bent[at : at + int(chance.random() * 9)]
        elif kind == 1:
            bent[at:at] = pieces[int(chance.random() * len(pieces))]
        elif kind == 2:
            bent[at] ^= 1 << int(chance.random() * 8)
        else:
            bent[at:at] = bent[at : at + 20]
        bent = bent or bytearray(b"\n")
    return bytes(bent)


NUMBER = re.compile(rb"(?:0|-?[1-9][0-9]{0,17})\Z")


def lines_meant(data: bytes) -> list[list[int]]:
    """What a careful reader takes of counter lines, by this file's own rules."""
    found = []
    for line in re.split(rb"[\r\n]+", data):
        tokens = line.split()
        if len(tokens) == 8 and len(line) <= 4096 and all(map(NUMBER.match, tokens)):
            values = [int(token) for token in tokens]
            if max(abs(value) for at, value in enumerate(values) if at != SEQUENCE) < 1 << 32:
                found.append(values)
    return found


def counter_lines(count: int, seed: int) -> None:
    chance = random.Random(seed)
    rows = np.zeros((25, 8), np.int64)
    rows[:, 2] = np.linspace(-5_000_000, 5_000_000, 25).astype(np.int64)
    rows[:, 3], rows[:, SEQUENCE], rows[:, 6] = -17, 4_000_000_000 + np.arange(25), np.arange(25) % 3 * 10
    lines = encode_rows(rows).splitlines(keepends=True)
    head = lines[0]
    good = damaged = 0
    for _ in range(count // 20):
        chosen = [mutated(chance, line, BYTES) if at < 20 else line for at, line in enumerate(lines)]
        chance.shuffle(chosen)
        data = head + b"".join(chosen) + b"\r\n"
        codec = UmdCodec("client")
        messages = codec.receive(data)
        found = [row for message in messages for row in message.rows.tolist() if len(row) == 8]
        assert found == lines_meant(data)
        good += len(found)
        damaged += sum(message.damaged for message in messages)
    assert min(good, damaged) > count // 4


@few_ways
def test_mutated_counter_lines(count: int) -> None:
    counter_lines(count, 1)


def refused(message: object) -> bool:
    """Whether the device refuses what a message carries, naming the field."""
    if isinstance(message, Notification):
        try:
            BridgeSamples.read(message.params, CHANNELS, "x")
        except RemoteProtocolError as error:
            return bool(error.fields["field"])
    if isinstance(message, Reply):
        for reader in (BridgeIdentity.read, CalibratorStatus.read, read_environment, read_optics):
            with contextlib.suppress(RemoteProtocolError):
                reader(message.result, "x")
    return False


def bridge_lines(count: int, seed: int) -> None:
    """A message equals the parse of its canonical rewrite; the rest is damage that says why."""
    chance = random.Random(seed)
    transcript = [line[2:].encode() + b"\n" for line in TRANSCRIPT if line.startswith("< ")]
    client, again, server = BridgeCodec("client"), BridgeCodec("client"), BridgeCodec("server")
    outcomes = {"good": 0, "damaged": 0, "refused": 0}
    for _ in range(count):
        for message in client.receive(mutated(chance, chance.choice(transcript), JSON_BYTES) + b"\n"):
            if isinstance(message, Damaged):
                assert message.why
                outcomes["damaged"] += 1
                continue
            assert isinstance(message, Reply | BridgeRefusal | Notification)
            assert again.receive(server.send(message)) == (message,)
            outcomes["refused" if refused(message) else "good"] += 1
    assert all(number > count // 100 for number in outcomes.values()), outcomes


PAGE = (Path(__file__).parents[3] / "docs" / "instrument-bridge.md").read_text(encoding="utf-8")
TRANSCRIPT = [line for line in PAGE.splitlines() if line[:2] in ("< ", "> ")]


@few_ways
def test_mutated_bridge_lines(count: int) -> None:
    bridge_lines(count, 2)


IDS_LINES = [
    b'{"jsonrpc":"2.0","id":7,"result":[0,123456789,-5,77]}\r\n',
    b'{"jsonrpc":"2.0","id":8,"result":["1.8.2"]}\r\n',
    b'{"jsonrpc":"2.0","id":9,"error":{"code":-32601,"message":"no such method"}}\r\n',
]


def attocube_lines(count: int, seed: int) -> None:
    chance = random.Random(seed)
    codec, again = AttocubeCodec(), AttocubeCodec()
    outcomes = {"good": 0, "damaged": 0}
    for _ in range(count):
        for answer in codec.receive(mutated(chance, chance.choice(IDS_LINES), JSON_BYTES) + b"\n"):
            if isinstance(answer, IdsDamaged):
                assert answer.why
                outcomes["damaged"] += 1
                continue
            assert isinstance(answer, Result)
            rewrite = (
                {"id": answer.id, "error": answer.error} if answer.error else {"id": answer.id, "result": answer.items}
            )
            (same,) = again.receive(json.dumps(rewrite).encode() + b"\n")
            assert repr(same) == repr(answer)
            outcomes["good"] += 1
    assert all(number > count // 100 for number in outcomes.values()), outcomes


@few_ways
def test_mutated_attocube_answers(count: int) -> None:
    attocube_lines(count, 3)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(10, 20))
def test_mutated_lines_of_every_parser_ten_times(seed: int) -> None:
    for parser in (counter_lines, bridge_lines, attocube_lines):
        parser(COUNT, seed)
