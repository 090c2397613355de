"""The control's certificate is exchanged in the middle of a push: nobody talks on with whom nobody accepted.

The server is restarted with another key pair at one of its requests. The push may not go on with it; what the control
then holds is said truly, and once a person has accepted the new certificate a fresh gateway leads home.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import TrueflankError
from gateway.push import push_table
from simulators.opcua import SinumerikServer
from tests.attacks import judged
from tests.push.judging import Played, ended, judge, settle, watching
from tests.push.uaworld import UaWorld, ua_change, ua_context, ua_world
from tests.sizes import long

pytestmark = pytest.mark.attack
POLICY = ("Basic256Sha256",)


async def rotate(at: UaWorld, folder: Path) -> None:
    """Restart the server on its port with a key pair of its own."""
    port = int(at.server.url.rpartition(":")[2])
    await at.server.stop()
    at.server = SinumerikServer(at.nck, at.clock, {"folder": str(folder), "security": POLICY, "port": port})
    await at.server.start()


def rotated(root: Path, keys: Path, request: int) -> Played:
    """A push in which the certificate is exchanged at the server's request of this number."""
    root.mkdir(parents=True)
    found = Played(request, [f"certificate exchanged at request {request}"])
    pinned = root / "pinned.der"
    refused: list[str] = []

    async def main() -> None:
        clock = LoopClock()
        async with ua_world(clock, keys, security=POLICY) as at:
            shutil.copy(at.server.certificate, pinned)
            more: dict[str, Any] = {
                "security": "best", "server_certificate": str(pinned), "client_folder": str(root / "client"),
            }  # fmt: skip
            device = watching(at.driver(**more), at.oracle)
            await device.open(5.0)
            base = await at.base(device)
            at.oracle.writes = 0
            said: list[str] = []

            def say(code: str, /, **fields: object) -> None:
                said.append(code)
                at.oracle.backed_up = at.oracle.backed_up or fields.get("step") == "BACKUP"
                at.person.hear(code, fields)

            asked = [0]

            def counted(_service: str) -> None:
                asked[0] += 1
                if asked[0] == request:
                    at.server.quirks.on_request = lambda _service: None
                    at.spawn(rotate(at, root / "renewed"))

            at.server.quirks.on_request = counted
            context = ua_context(device, clock, root, await device.identify(), say=say, start_timeout_s=12.0)
            asked[0] = 0
            found.outcome = await ended(push_table(ua_change(base, at.new), context))
            await device.close()
            judge(at.oracle, found, said, context)
            await clock.sleep(20.0)
            stranger = at.driver(**more)
            try:
                await stranger.open(5.0)
            except TrueflankError as error:
                refused.append(error.code)
            await stranger.close()
            shutil.copy(at.server.certificate, pinned)  # a person has accepted it
            await at.ready()
            at.nck.channel_reset()
            await clock.sleep(2.0)
            await at.ready()
            fresh = at.driver(**more)
            await fresh.open(5.0)
            try:
                again = replace(context, controller=fresh, start_timeout_s=60.0)
                await settle(at.oracle, again, found, willing=True)
            finally:
                await fresh.close()

    run_virtual(main)
    found.wrong += [] if refused == ["E-UA-TRUST"] else [f"a server nobody accepted was answered with {refused}"]
    return found


@pytest.mark.parametrize("request_", [long(number) for number in (5, 40, 90, 140, 200, 260)])
def test_an_exchanged_certificate_ends_the_push_truly(tmp_path: Path, keys: Path, request_: int) -> None:
    found = rotated(tmp_path / "push", keys, request_)
    print("ENDS", request_, found.outcome, found.recovered)
    judged("the control's certificate exchanged in mid-push", "OPC UA", [found.wrong])
    assert found.wrong == []
