"""A client of open62541 that works through one conversation with a control and prints what it saw as JSON.

As `uaclient.js`. Argument: { url, user, password, certificate, key, uri, name, denied, server }.
"""

import asyncio
import json
import os
import sys
from typing import Any

# Standard output carries the result only; the package prints its name there when it is imported.
RESULT = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)

import o6  # noqa: E402
from o6.ns import ns0  # noqa: E402

CONFIG = json.loads(sys.argv[1])
REFRESHED = "i=2788"
FOLDER = "/Methods/Filehandling"


def named(status: o6.StatusCode) -> str:
    """BAD_TYPE_MISMATCH -> BadTypeMismatch."""
    return "".join(word.capitalize() for word in str(o6.StatusCode(status).name).split("_"))


def plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


def client(password: str) -> Any:
    return o6.Client(
        CONFIG["url"],
        certificate=CONFIG["certificate"],
        privateKey=CONFIG["key"],
        trustList=[CONFIG["server"]],
        securityMode=ns0.datatypes.MessageSecurityMode.SIGN_AND_ENCRYPT,
        securityPolicy="http://opcfoundation.org/UA/SecurityPolicy#Basic256Sha256",
        applicationUri=CONFIG["uri"],
        username=CONFIG["user"],
        password=password,
    )


async def failure(password: str) -> str:
    try:
        async with client(password):
            return ""
    except o6.StatusCodeError as error:
        return str(error.symbol)


class Talk:
    """One session and what it saw."""

    def __init__(self, it: Any, index: int) -> None:
        self._it, self._index = it, index
        self.seen: dict[str, Any] = {"index": index}

    def id(self, path: str) -> o6.NodeId:
        return o6.NodeId(f"ns={self._index};s={path}")

    async def value(self, path: str) -> list[Any]:
        got = await self._it.read(self.id(path), valueOnly=False)
        return [named(got.status or o6.StatusCode.GOOD), plain(got.value)]

    async def write(self, path: str, value: Any) -> str:
        return named(await self._it.write(self.id(path), value))

    async def call(self, owner: str, method: str, *given: Any) -> list[Any]:
        status, *outputs = await self._it.call(self.id(owner), self.id(method), list(given))
        return [named(status), *map(plain, outputs)]

    async def variables(self) -> None:
        seen = self.seen
        seen["status"] = await self.value("/Channel/State/chanStatus")
        seen["axis"] = await self.value("/NC/_N_NC_TEA_ACX/$MN_AXCONF_MACHAX_NAME_TAB[u1,3]")
        seen["absent"] = await self.value("/Channel/MachineAxis/aaStat[u1,9]")
        seen["written"] = await self.write("/Channel/Parameter/R[u1,90]", o6.Double(12.5))
        seen["wrongType"] = await self.write("/Channel/Parameter/R[u1,90]", o6.Int32(12))
        seen["notWritable"] = await self.write("/Channel/State/chanStatus", o6.UInt16(1))
        seen["block"] = await self.value("/Channel/Parameter/R[u1,88,#4]")
        browsed = await self._it.browse(self.id("Sinumerik"))
        seen["browsed"] = [one.browseName.name for one in browsed]

    async def files(self) -> None:
        seen, text = self.seen, b"; a line\nM30\n" * 2000
        file = f"Sinumerik/FileSystem/Part Program/{CONFIG['name']}"
        copy = f"{FOLDER}/CopyFileToServer"
        seen["copied"] = await self.call(FOLDER, copy, file, text, True)
        seen["copiedAgain"] = await self.call(FOLDER, copy, file, text, False)
        seen["same"] = await self.call(FOLDER, f"{FOLDER}/CopyFileFromServer", file) == ["Good", text]
        seen["selected"] = await self.call(FOLDER, f"{FOLDER}/Select", file, o6.Int32(1))
        seen["otherChannel"] = await self.call(FOLDER, f"{FOLDER}/Select", file, o6.Int32(2))
        node = file.replace(CONFIG["name"], CONFIG["name"].upper())
        opened = await self.call(node, f"{node}.Open", o6.Byte(1))
        handle = o6.UInt32(opened[1])
        await self.call(node, f"{node}.SetPosition", handle, o6.UInt64(2))
        seen["part"] = (await self.call(node, f"{node}.Read", handle, o6.Int32(6)))[1].decode()
        seen["closed"] = await self.call(node, f"{node}.Close", handle)
        seen["rights"] = (await self.call("/Methods", "/Methods/GetMyAccessRights"))[1]

    async def alarms(self) -> None:
        events: list[list[Any]] = []
        refreshed = asyncio.Event()

        def heard(event: dict[str, Any]) -> None:
            message = event["/Message"]
            text = getattr(message, "text", message)
            events.append([text, plain(event["/Severity"]), plain(event["/AlarmIdentifier"])])
            if str(event["/EventType"]).endswith(REFRESHED):
                refreshed.set()

        chosen = "SELECT /EventType, /Message, /Severity, /AlarmIdentifier"
        subscription = self._it.defaultSubscription
        await self._it.monitorEvent(self.id("Sinumerik"), heard, chosen, subscription=subscription)
        refresh = await self._it.call("i=2782", "i=3875", [o6.UInt32(subscription.id)])
        await refreshed.wait()
        self.seen |= {"refresh": named(refresh[0]), "events": events}


async def main() -> None:
    """The whole conversation."""
    seen: dict[str, Any] = {"wrongPassword": await failure("wrong")}
    if CONFIG["denied"]:
        seen["denied"] = await failure(CONFIG["password"])
    else:
        async with client(CONFIG["password"]) as it:
            spaces = list(await it.read("i=2255"))
            talk = Talk(it, spaces.index("SinumerikVarProvider"))
            await talk.variables()
            await talk.files()
            await talk.alarms()
            seen |= talk.seen
    RESULT.write(json.dumps(seen) + "\n")
    RESULT.flush()


if __name__ == "__main__":
    asyncio.run(main())
