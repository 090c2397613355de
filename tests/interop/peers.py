"""Programs nobody here wrote, as children of a test: found or asked for, started on loopback, ended by their id."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import importlib.util
import json
import os
import shutil
import socket
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from drivers.clock import LoopClock
from drivers.errors import DeadlineExceeded
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.certificates import load_certificate, own_key_pair
from simulators.nck import Nck
from simulators.opcua.address_space import ANONYMOUS, StatusRefused, VariableSpace, make_accounts
from simulators.opcua.methods import SIGNATURES, Methods

HERE = Path(__file__).parent
URI = "urn:interop:server"
R_FIRST, R_COUNT = 80, 24


def needed(there: bool, what: str) -> None:
    """Skip visibly when a peer is not installed; fail where everything must run (TRUEFLANK_INTEROP=all)."""
    if there:
        return
    text = f"NOT RUN: {what} is not installed here; `make interop` installs it"
    if os.environ.get("TRUEFLANK_INTEROP") == "all":
        pytest.fail(text)
    pytest.skip(text)


def node_opcua() -> str:
    """The path of node, when node-opcua is installed beside this file."""
    found = shutil.which("node")
    needed(found is not None and (HERE / "node_modules" / "node-opcua").is_dir(), "node-opcua")
    return str(found)


def open62541() -> str:
    """The path of this Python, when o6 is installed in it, which brings open62541."""
    needed(importlib.util.find_spec("o6") is not None, "open62541 (Python package o6)")
    return sys.executable


SERVERS = {"node-opcua": (node_opcua, "uaserver.js"), "open62541": (open62541, "open62541_server.py")}
"""Stacks nobody here wrote: what runs each, and its server."""


def program(name: str, package: str) -> str:
    """The path of a program from a Debian package."""
    found = shutil.which(name)
    needed(found is not None, f"{name} ({package})")
    return str(found)


def free_port() -> int:
    """A port that nobody listens on just now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def ended(process: asyncio.subprocess.Process) -> None:
    """End a child: by closing its input, else by its id."""
    if process.stdin is not None:
        process.stdin.close()
    try:
        async with LoopClock().deadline(5.0, "a peer's end"):
            await process.wait()
    except DeadlineExceeded:
        process.kill()
        await process.wait()
    transport = process._transport  # type: ignore[attr-defined]
    transport.close()


def variables(axes: int, tables: int) -> dict[str, dict[str, Any]]:
    """Every variable the driver reads or writes, as a peer is to offer it."""
    numbers = range(1, axes + 1)
    paths = [nodes.axis_name(place) for place in range(1, 32)]
    paths += [nodes.SERIAL_NUMBER, nodes.NCK_VERSION, nodes.BASIC_LENGTH_UNIT, nodes.ACCESS_LEVEL]
    paths += [nodes.OPERATING_MODE, nodes.ALARM_COUNT]
    paths += [nodes.in_channel(name) for name in ("chanStatus", "progStatus")]
    paths += [nodes.in_channel(name, 1, "ProgramInfo") for name in ("msg", "progName")]
    paths += [nodes.alarm_number(place) for place in range(1, 9)] + [nodes.alarm_text(place) for place in range(1, 9)]
    items = ("actToolBasePos", "aaRef", "aaStat", "vaEnc1CompVal", "vaCecCompVal")
    paths += [nodes.of_axis(item, number) for item in items for number in numbers]
    paths += [nodes.r_parameter(R_FIRST + place) for place in range(R_COUNT)]
    names = [f"AX{number}" for number in numbers]
    data = ["$MA_IS_ROT_AX[{}]", "$MA_ROT_IS_MODULO[{}]", "$MA_MM_ENC_COMP_MAX_POINTS[0,{}]"]
    data += ["$MA_ENC_COMP_ENABLE[0,{}]", "$MA_CEC_ENABLE[{}]", "$MA_MM_ENC_COMP_MAX_POINTS[1,{}]"]
    found = [nodes.to_path(datum.format(name), names) for datum in data for name in names]
    found += [nodes.to_path(f"$MN_MM_CEC_MAX_POINTS[{table}]", names) for table in range(tables)]
    found += [nodes.to_path(f"$SN_CEC_TABLE_ENABLE[{table}]", names) for table in range(tables)]
    made = {path: {"kind": nodes.kind_of(path), "array": False} for path in [*paths, *filter(None, found)]}
    for first in range(R_FIRST, R_FIRST + 4):
        for count in (16, 18, 20, 22, 24):
            made[nodes.r_block(first, count)] = {"kind": "Double", "array": True}
    return made


class PeerServer:
    """A server of another stack; what its nodes hold is asked of the control double in this process."""

    def __init__(self, stack: str, nck: Nck, users: dict[str, str]) -> None:
        self._stack = stack
        self._space, self._methods = VariableSpace(nck), Methods(nck, 4)
        self._accounts = make_accounts(users)
        self._users = users
        self._nck = nck
        self.url = ""
        self.certificate = Path()
        self.writes: list[str] = []
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None

    async def start(
        self, folder: Path, trusted: list[Path], *, fillers: int = 0, most: int = 0, strict: bool = False
    ) -> None:
        """Start it; `url` and `certificate` are known afterwards."""
        runner, script = SERVERS[self._stack]
        runs = runner()
        pair = own_key_pair(folder, "peer", URI, "127.0.0.1", server=True)
        pem = folder / "peer.pem"
        pem.write_bytes(load_certificate(pair.certificate.read_bytes()).public_bytes(Encoding.PEM))
        port = free_port()
        config = {
            "port": port,
            "folder": str(folder / "pki"),
            "certificate": str(pem),
            "key": str(pair.key),
            "trusted": [str(path) for path in trusted],
            "users": self._users,
            "uri": URI,
            "fillers": fillers,
            "most": most,
            "strict": strict,
            "variables": variables(len(self._nck.spec.axes), 2 * len(self._nck.spec.axes)),
            "methods": {
                one.name: {
                    "path": f"/Methods/{one.name}",
                    "inputs": one.arguments,
                    "outputs": [["Result", one.result]] if one.result else [],
                }
                for one in SIGNATURES
            },
        }
        self._process = await asyncio.create_subprocess_exec(
            runs, str(HERE / script), stdin=-1, stdout=-1, cwd=HERE, limit=64 * 2**20
        )
        self._say(config)
        ready = await self._hear()
        assert ready == {"ready": True}, ready
        self._task = asyncio.get_running_loop().create_task(self._serve())
        self.url, self.certificate = f"opc.tcp://127.0.0.1:{port}", pair.certificate

    def _say(self, message: dict[str, Any]) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(message).encode() + b"\n")

    async def _hear(self) -> dict[str, Any] | None:
        assert self._process is not None
        assert self._process.stdout is not None
        line = await self._process.stdout.readline()
        return json.loads(line) if line else None

    async def _serve(self) -> None:
        while (question := await self._hear()) is not None:
            answer: dict[str, Any] = {"id": question["id"], "status": "", "value": None}
            account = self._accounts.get(question["user"], ANONYMOUS)
            try:
                answer["value"] = self._answer(question, account)
            except StatusRefused as refused:
                answer["status"] = refused.status
            self._say(answer)

    def _answer(self, question: dict[str, Any], account: Any) -> Any:
        if question["op"] == "read":
            return self._space.read(question["path"], account)[1]
        if question["op"] == "write":
            value = question["value"]
            self.writes.append(question["path"])
            self._space.write(question["path"], value if isinstance(value, list) else [value], account)
            return None
        values = [
            base64.b64decode(value or "") if kind == "ByteString" else value
            for value, kind in zip(question["values"], question["types"], strict=True)
        ]
        result = self._methods.call(question["name"], values, question["types"], account)
        return [base64.b64encode(result).decode() if isinstance(result, bytes) else result]

    async def stop(self) -> None:
        """End the child."""
        if self._process is not None:
            await ended(self._process)
        if self._task is not None:
            await self._task


@contextlib.asynccontextmanager
async def peer_server(
    stack: str, nck: Nck, folder: Path, trusted: list[Path], users: dict[str, str], **options: Any
) -> AsyncIterator[PeerServer]:
    """A server for the length of a block."""
    made = PeerServer(stack, nck, users)
    try:
        await made.start(folder, trusted, **options)
        yield made
    finally:
        await made.stop()
