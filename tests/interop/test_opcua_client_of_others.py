"""Clients of other stacks against our double of the control's server."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.sinumerik.opcua.session.certificates import own_key_pair
from simulators.nck import Nck
from simulators.opcua import SinumerikServer
from tests.contract.opcua_stage import SPEC
from tests.interop.peers import HERE, node_opcua, open62541

pytestmark = pytest.mark.interop
URI = "urn:interop:client"
CLIENTS = {"node-opcua": (node_opcua, "uaclient.js"), "open62541": (open62541, "open62541_client.py")}


async def conversation(stack: str, folder: Path, *, trusted: bool, name_space: int = 2) -> tuple[dict[str, Any], Nck]:
    """What the client saw, and the control afterwards."""
    runner, script = CLIENTS[stack]
    runs = runner()
    clock = LoopClock()
    nck = Nck(SPEC, clock)
    await nck.start()
    nck.core.alarms.raise_(700000, "oil level low", "cancel")
    pair = own_key_pair(folder / "client", "client", URI, "127.0.0.1")
    other = own_key_pair(folder / "other", "other", URI, "127.0.0.1")
    allowed = pair if trusted else other
    settings = {"security": ["Basic256Sha256", "None"], "trusted": [str(allowed.certificate)], "name_space": name_space}
    server = SinumerikServer(nck, clock, {**settings, "users": {"trueflank": "secret"}})
    await server.start()
    pem = folder / "client.pem"
    pem.write_bytes(_pem(pair.certificate))
    config = {"url": server.url, "user": "trueflank", "password": "secret", "certificate": str(pem)}
    config |= {"key": str(pair.key), "uri": URI, "folder": str(folder / "pki"), "name": "Probe.mpf"}
    config |= {"denied": not trusted, "server": str(server.certificate)}
    try:
        process = await asyncio.create_subprocess_exec(
            runs, str(HERE / script), json.dumps(config), stdout=-1, cwd=HERE
        )
        try:
            async with LoopClock().deadline(60.0, stack):
                out, _ = await process.communicate()
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
        assert process.returncode == 0
        return json.loads(out), nck
    finally:
        await server.stop()
        await nck.stop()


def _pem(path: Path) -> bytes:
    from cryptography.hazmat.primitives.serialization import Encoding

    from drivers.sinumerik.opcua.session.certificates import load_certificate

    return load_certificate(path.read_bytes()).public_bytes(Encoding.PEM)


@pytest.mark.parametrize("stack", CLIENTS)
def test_a_secure_session_reads_writes_copies_selects_and_sees_alarms(stack: str, tmp_path: Path) -> None:
    seen, nck = asyncio.run(conversation(stack, tmp_path, trusted=True, name_space=4))
    assert "BadUserAccessDenied" in seen["wrongPassword"]
    assert seen["index"] == 4
    assert seen["status"] == ["Good", 0]
    assert seen["axis"] == ["Good", "C1"]
    assert seen["absent"][0] == "BadAttributeIdInvalid"
    assert (seen["written"], seen["wrongType"], seen["notWritable"]) == ("Good", "BadTypeMismatch", "BadNotWritable")
    assert nck.get("R[90]") == 12.5
    assert seen["block"] == ["Good", [0.0, 0.0, 12.5, 0.0]]
    assert "R[u1,1]" in seen["browsed"]
    assert not [name for name in seen["browsed"] if name.startswith("R[u1,2")]
    assert (seen["copied"][0], seen["copiedAgain"][0], seen["same"]) == ("Good", "BadInvalidArgument", True)
    assert (seen["selected"], seen["otherChannel"]) == (["Good", 0], ["Good", 1])
    assert nck.selected == "/_N_MPF_DIR/_N_PROBE_MPF"
    assert (seen["part"], seen["closed"][0]) == ("a line", "Good")
    assert "FsWrite" in seen["rights"]
    assert seen["refresh"] == "Good"
    assert ["oil level low", 500, "700000"] in seen["events"]


@pytest.mark.parametrize("stack", CLIENTS)
def test_an_unknown_client_certificate_is_refused(stack: str, tmp_path: Path) -> None:
    seen, _ = asyncio.run(conversation(stack, tmp_path, trusted=False))
    assert seen["denied"]
    assert seen["wrongPassword"]
