"""A server of open62541 in front of whatever answers on standard input and output, one JSON object a line.

As `uaserver.js`: first line in { port, certificate, key, trusted, users, uri, fillers, strict, variables, methods },
first line out { ready: true }; then questions out { id, op, ... } and answers in { id, status, value }.
"""

import asyncio
import base64
import itertools
import json
import os
import re
import sys
from typing import Any

# Standard output carries answers only; the package prints its name there when it is imported.
ANSWERS = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)

import o6  # noqa: E402
from o6.ns import ns0  # noqa: E402

KINDS = {"Boolean": 1, "SByte": 2, "Byte": 3, "Int16": 4, "UInt16": 5, "Int32": 6, "UInt32": 7, "Int64": 8, "UInt64": 9}
KINDS |= {"Float": 10, "Double": 11, "String": 12, "ByteString": 15}


def status(name: str) -> o6.StatusCode:
    """BadNodeIdUnknown -> BAD_NODE_ID_UNKNOWN."""
    return o6.StatusCode[re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name or "Good").upper()]


def value_of(kind: str, value: Any, array: bool = False) -> Any:
    if value is None or kind in ("String", "Boolean"):
        return value
    if kind == "ByteString":
        return base64.b64decode(value)
    made = getattr(o6, kind)
    return [made(one) for one in value] if array else made(value)


def plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value.tolist() if hasattr(value, "tolist") else value


class Users(o6.AccessControl):
    """Names and passwords."""

    def __init__(self, known: dict[str, str]) -> None:
        super().__init__(anonymous=False, username=True)
        self._known = known

    def activateSession(self, endpoint: Any, remoteCertificate: bytes, session: Any, userIdentityToken: Any) -> str:
        del endpoint, remoteCertificate, session
        name = str(getattr(userIdentityToken, "userName", ""))
        given = getattr(userIdentityToken, "password", b"")
        if self._known.get(name) != (given.decode() if isinstance(given, bytes) else given):
            raise o6.StatusCodeError(o6.StatusCode.BAD_USER_ACCESS_DENIED)
        return name


class Desk:
    """Questions to the other side of standard output."""

    def __init__(self) -> None:
        self._count = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[dict[str, Any]]] = {}

    async def ask(self, **question: Any) -> dict[str, Any]:
        number = next(self._count)
        self._waiting[number] = asyncio.get_running_loop().create_future()
        say({"id": number, **question})
        try:
            return await self._waiting[number]
        finally:
            del self._waiting[number]

    def answered(self, answer: dict[str, Any]) -> None:
        waiting = self._waiting.get(answer["id"])
        if waiting is not None and not waiting.done():  # else the client has given up
            waiting.set_result(answer)


def say(message: dict[str, Any]) -> None:
    ANSWERS.write(json.dumps(message) + "\n")
    ANSWERS.flush()


class Space:
    """The nodes of one server."""

    def __init__(self, server: Any, desk: Desk, index: int) -> None:
        self._server, self._desk, self._index = server, desk, index

    def id(self, text: str) -> o6.NodeId:
        return o6.NodeId(f"ns={self._index};s={text}")

    async def variable(self, parent: Any, path: str, kind: str, array: bool) -> None:
        async def read(_node: Any, **asked: Any) -> tuple[Any, ...]:
            got = await self._desk.ask(op="read", path=path, user=user(asked["session"]))
            told = status(got["status"])
            return (told,) if got["status"] else (told, value_of(kind, got["value"], array))

        async def write(_node: Any, value: Any, **asked: Any) -> tuple[Any]:
            if value.sourceTimestamp or value.serverTimestamp:
                return (o6.StatusCode.BAD_WRITE_NOT_SUPPORTED,)
            who = user(asked["session"])
            got = await self._desk.ask(op="write", path=path, value=plain(value.value), user=who)
            return (status(got["status"]),)

        first = value_of(kind, [0.0] if array else "" if kind == "String" else False if kind == "Boolean" else 0, array)
        name, data_type = path.rsplit("/", maxsplit=1)[-1], o6.NodeId(f"i={KINDS[kind]}")
        told = {"nodeId": self.id(path), "dataType": data_type, "ns": self._index}
        node = await self._server.addVariable(name, parent, first, **told)
        self._server.implement(node, read=read, write=write)

    async def method(self, parent: Any, name: str, spec: dict[str, Any]) -> None:
        async def call(_node: Any, *given: Any) -> tuple[Any, ...]:
            types = [kind for _, kind in spec["inputs"]]
            values = [plain(one) for one in given]
            # Which session asks is not told to a method: there is one user here.
            got = await self._desk.ask(op="call", name=name, values=values, types=types, user=Space.caller)
            kinds = [kind for _, kind in spec["outputs"]]
            return (status(got["status"]), *([] if got["status"] else map(value_of, kinds, got["value"])))

        def named(given: list[list[str]]) -> list[Any]:
            made = ns0.datatypes.Argument
            return [made(name=one, dataType=o6.NodeId(f"i={KINDS[kind]}"), valueRank=-1) for one, kind in given]

        arguments = {"inputArgs": named(spec["inputs"]), "outputArgs": named(spec["outputs"])}
        await self._server.addMethod(name, parent, call, **arguments, nodeId=self.id(spec["path"]), ns=self._index)

    caller = ""


def user(session: Any) -> str:
    return str(session.context) if session is not None and session.context else ""


async def serve(config: dict[str, Any], desk: Desk) -> Any:
    server = o6.Server(
        port=config["port"],
        certificate=config["certificate"],
        privateKey=config["key"],
        trustList=config["trusted"],
        secureOnly=config["strict"],
        applicationUri=config["uri"],
        accessControl=Users(config["users"]),
    )
    Space.caller = next(iter(config["users"]))
    for number in range(config["fillers"]):
        server._add_namespace(f"urn:filler:{number}", 40 + number)
    index = server._add_namespace("SinumerikVarProvider", 90)
    space = Space(server, desk, index)
    root = await server.addObject("Sinumerik", server.objectsNode, nodeId=space.id("Sinumerik"), ns=index)
    for path, spec in config["variables"].items():
        await space.variable(root, path, spec["kind"], spec["array"])
    folders = {"": root}
    for name, spec in config["methods"].items():
        parts = spec["path"].split("/")[1:-1]
        for depth in range(1, len(parts) + 1):
            path = "/" + "/".join(parts[:depth])
            if path not in folders:
                under = folders[path.rpartition("/")[0]]
                folders[path] = await server.addObject(parts[depth - 1], under, nodeId=space.id(path), ns=index)
        await space.method(folders["/" + "/".join(parts)], name, spec)
    server.start()
    await server.waitReady()
    return server


async def main() -> None:
    """Serve until standard input ends."""
    reader = asyncio.StreamReader(limit=64 * 2**20)
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    desk = Desk()
    server = await serve(json.loads(await reader.readline()), desk)
    say({"ready": True})
    while line := await reader.readline():
        desk.answered(json.loads(line))
    ending = server.stop()
    if ending is not None:
        await ending


if __name__ == "__main__":
    asyncio.run(main())
