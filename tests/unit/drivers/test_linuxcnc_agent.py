"""The LinuxCNC agent before strangers, silent lines and questions that mean nothing."""

from __future__ import annotations

import contextlib
import hashlib
import json
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.linuxcnc.agent import protocol
from drivers.linuxcnc.agent.__main__ import LEAST_TOKEN, _token
from drivers.linuxcnc.agent.answering import Agent
from drivers.linuxcnc.agent.kernel import Kernel, KernelLife
from drivers.linuxcnc.agent.protocol import FIRST_S, MOST_FIRST, MOST_LINES, AgentReply, GatewayLines
from tests.contract.linuxcnc_double import Machine
from tests.contract.linuxcnc_stage import TOKEN, agent_of

HELLO = b"hello\n"


class Desk:
    """A listener with its lines; whoever says hello is trusted, and everything is said back in capitals."""

    def __init__(self, listener: socket.socket) -> None:
        self.address = listener.getsockname()
        self.lines = GatewayLines(listener, lambda data: AgentReply(data.upper() + b"\n", data == b"hello"))
        self.now = 0.0
        self._wires: list[socket.socket] = []

    def call(self, first: bytes = b"") -> socket.socket:
        wire = socket.create_connection(self.address)
        wire.settimeout(1.0)
        self._wires.append(wire)
        self.turn()
        if first:
            wire.sendall(first)
            self.turn()
        return wire

    def turn(self) -> None:
        self.lines.turn(0.1)

    def close(self) -> None:
        self.lines.close()
        for wire in self._wires:
            wire.close()


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Desk]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        made = Desk(listener)
        monkeypatch.setattr(protocol, "_now", lambda: made.now)
        yield made
        made.close()


def gone(wire: socket.socket) -> bool:
    """Whether the other end let go."""
    with contextlib.suppress(ConnectionError):
        while True:
            try:
                if not wire.recv(1 << 16):
                    return True
            except TimeoutError:
                return False
    return True


def test_who_says_nothing_keeps_nobody_out(desk: Desk) -> None:
    silent = desk.call()
    known = desk.call(HELLO)
    assert known.recv(99) == b"HELLO\n"
    desk.now = FIRST_S + 1.0
    desk.turn()
    assert gone(silent)
    known.sendall(b"a\nb\nc")
    desk.turn()
    assert known.recv(99) == b"A\nB\n"
    known.sendall(b"\n")
    desk.turn()
    assert known.recv(99) == b"C\n"


@pytest.mark.parametrize("first", [b"guess\n", b"x" * (MOST_FIRST + 1)])
def test_a_stranger_is_answered_once_and_let_go(desk: Desk, first: bytes) -> None:
    assert gone(desk.call(first))


def test_the_longest_silent_line_makes_room(desk: Desk) -> None:
    """A gateway whose cable was pulled never says that it has left."""
    left = desk.call(HELLO)
    others = []
    for _ in range(MOST_LINES):
        desk.now += 1.0
        others.append(desk.call(HELLO))
    assert left.recv(99) == b"HELLO\n"
    assert gone(left)
    assert [wire.recv(99) for wire in others] == [b"HELLO\n"] * MOST_LINES


@pytest.fixture
def agent(tmp_path: Path) -> Agent:
    machine = Machine(tmp_path)
    machine.restart()
    return agent_of(machine)


def asked(agent: Agent, **told: Any) -> dict[str, Any]:
    data, trusted = agent.line(json.dumps({"id": 7, "token": TOKEN, **told}).encode())
    assert trusted
    assert data.endswith(b"\n")
    return dict(json.loads(data))


WITHOUT_TOKEN = {
    "nothing": b"",
    "no JSON": b"GET / HTTP/1.1\r",
    "no text": bytes(range(128, 256)),
    "a number": b"7",
    "a list": b'["token"]',
    "deep": b"[" * 100_000,
    "no token": b'{"id": 1, "do": "state"}',
    "another token": b'{"id": 1, "do": "state", "token": "0123456789abcdeF"}',
    "a token that is a list": b'{"id": 1, "do": "state", "token": ["0123456789abcdef"]}',
    "half a character": b'{"id": 1, "do": "state", "token": "\\ud800"}',
    "a number of more than 4300 digits": b'{"id": ' + b"9" * 5000 + b"}",
}


@pytest.mark.parametrize("data", WITHOUT_TOKEN.values(), ids=WITHOUT_TOKEN)
def test_nothing_is_done_without_the_token(agent: Agent, data: bytes) -> None:
    answer = agent.line(data)
    assert not answer.trusted
    assert json.loads(answer.data)["code"] in ("E-LCNC-TOKEN", "E-LCNC-ASKED")


MEANT: dict[str, Callable[[], dict[str, Any]]] = {
    "nothing": dict,
    "unknown": lambda: {"do": "shutdown"},
    "a list": lambda: {"do": ["state"]},
    "no fields": lambda: {"do": "put"},
    "no number": lambda: {"do": "begin", "transaction": "1", "head": 0, "joints": [0]},
    "no such joint": lambda: {"do": "begin", "transaction": 1, "head": 0, "joints": [-1]},
    "a joint by name": lambda: {"do": "begin", "transaction": 1, "head": 0, "joints": ["../0"]},
    "no axis": lambda: {"do": "tables", "axis": "Q"},
    "an axis that is a table": lambda: {"do": "tables", "axis": {"X": 1}},
    "another state": lambda: {"do": "finish", "transaction": 0, "state": "half"},
    "a program outside": lambda: {"do": "program", "name": "../x", "text": "M2"},
    "a put of nothing": lambda: {"do": "put", "transaction": 9, "joint": 0, "text": ""},
    "a commit of nothing": lambda: {"do": "commit", "transaction": 9, "digests": {"0": "x"}},
    "infinity": lambda: {"do": "look", "axes": ["X"], "in": [float("inf")], "out": []},
}


@pytest.mark.parametrize("name", MEANT)
def test_a_question_that_means_nothing_changes_nothing(agent: Agent, tmp_path: Path, name: str) -> None:
    asked(agent, do="identify")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    told = asked(agent, **MEANT[name]())
    assert told["id"] == 7
    assert told["code"].startswith("E-LCNC-")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_kernel_that_ends_between_two_questions_is_told_as_down(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    machine.restart()
    life = machine.life
    agent = Agent(TOKEN, lambda: Kernel(machine, machine), lambda: life)
    assert "ok" in asked(agent, do="state")
    machine.stop()
    assert asked(agent, do="state")["code"] == "E-LCNC-DOWN"


@pytest.mark.parametrize("after", range(8))
def test_a_kernel_that_ends_within_an_answer_never_has_what_stands_acting(tmp_path: Path, after: int) -> None:
    """A file replaced in its life waits for the next start; once it ended, nobody knows what acts."""
    machine = Machine(tmp_path)
    machine.restart()
    looks = 0

    def life() -> KernelLife | None:
        nonlocal looks
        looks += 1
        return machine.life if looks <= after else None

    calm = Agent(TOKEN, lambda: Kernel(machine, machine), lambda: machine.life)
    told = asked(calm, do="tables", axis="X")
    assert "ok" in told, told
    empty = told["ok"]["standing"]
    for do in (
        {"do": "begin", "transaction": 7, "head": "", "joints": [0]},
        {"do": "put", "transaction": 7, "joint": 0, "text": (new := empty + "0 0.001 0.001\n10 0 0\n")},
        {"do": "commit", "transaction": 7, "digests": {"0": hashlib.sha256(new.encode()).hexdigest()}},
    ):
        told = asked(calm, **do)
        assert "ok" in told, told
    told = asked(Agent(TOKEN, lambda: Kernel(machine, machine), life), do="tables", axis="X")
    assert told.get("code") == "E-LCNC-DOWN" or told["ok"]["acting"] == empty != told["ok"]["standing"]


def test_the_agent_says_what_its_kernel_is_and_does(agent: Agent, tmp_path: Path) -> None:
    (tmp_path / "x.comp").write_text("0 0 0\n100 -0.01 -0.01\n# trims\n")
    assert agent.facts() == [
        f"LinuxCNC 2.9.0 runs with {tmp_path / 'mill.ini'}",
        f"joint 0: X in mm, BACKLASH 0, {tmp_path / 'x.comp'} with 2 rows, COMP_FILE_TYPE 1 (trims)",
        f"joint 1: Y in mm, BACKLASH 0.01, {tmp_path / 'y.comp'} with 0 rows, COMP_FILE_TYPE 0 (positions)",
        f"joint 2: A in deg, BACKLASH 0, {tmp_path / 'a.comp'} with 0 rows, COMP_FILE_TYPE 1 (trims)",
    ]


def test_a_token_is_made_once_and_is_the_owners_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "token.txt"
    made = _token(str(place))
    assert len(made) >= LEAST_TOKEN
    assert place.stat().st_mode & 0o077 == 0
    assert "Copy this file" in capsys.readouterr().out
    assert _token(str(place)) == made
    assert capsys.readouterr().out == ""
    place.chmod(0o644)
    with pytest.raises(SystemExit, match="chmod 600"):
        _token(str(place))
    place.chmod(0o600)
    place.write_text("short\n")
    with pytest.raises(SystemExit, match="at least 16"):
        _token(str(place))
