"""The daemon: one for a store, one run at a time, devices lent and taken back, ended in time."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import ssl
import stat
import subprocess
import sys
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import httpx
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError, TransportError, TrueflankError
from drivers.stale_programs import NOTHING, StaleProgram
from drivers.types.machine import MachineState
from gateway import audit
from gateway.broker import (
    Broker,
    BrokerNotice,
    Lease,
    borrow_devices,
    borrowing,
    notice_of,
    take_from_hung_gateway,
    token_path,
)
from gateway.broker.lending import leave_notice, object_line, read_object
from gateway.broker.state_folder import LOCK_FILE, hold_folder_lock, token_of
from gateway.config import SiteFile
from gateway.config.sections import ServiceSection
from gateway.daemon import RunStarter, ServiceParts, serve
from gateway.daemon.job_runner import JobRunner, interrupt, run_until_signal
from gateway.domain.outcomes import AxisVerdict, Verdict
from gateway.errors import BusyError, StoreError
from gateway.push import journal
from gateway.say import Say
from gateway.stopping import StopAsked, Stopped, current, obey
from gateway.store import Store
from gateway.store.log_book import lines_of
from gateway.users import UserAccounts, first_token_path
from gateway.users.passwords import Hasher
from gateway.views.runs import last_result, newest_runs, pushes_held, stored_report
from gateway.web import works
from tests.unit.report.synthetic import axis_material
from tests.unit.web.pictures import Seen

SITE = SiteFile.model_validate(
    {
        "site": {"name": "hall-3"},
        "controller": {"url": "opc.tcp://127.0.0.1:4840", "serial": "S"},
        "instruments": [{"name": "laser", "driver": "umd", "url": "tcp://127.0.0.1:9"}],
        "axes": [
            {
                "name": "X1", "letter": "X", "kind": "linear", "travel": [0, 100],
                "measure": {
                    "instrument": "laser", "component": "EXX", "feed": 1000, "stable": 1,
                    "targets": {"first": 0, "last": 100, "count": 11},
                },
                "table": {"minimum": 0, "maximum": 100, "step": 10},
            }
        ],
    }
)  # fmt: skip


@dataclass
class Devices:
    """A supervisor that notes what is asked of it."""

    error: TrueflankError | None = None
    per_device: bool = True
    calls: list[str] = field(default_factory=list)
    state: str = "closed"
    left: StaleProgram = NOTHING
    seen: MachineState | None = None
    watching: asyncio.Event = field(default_factory=asyncio.Event)

    async def open_all(self) -> None:
        self.calls.append("open")
        self.state = "open"
        if self.error is not None:
            self.state = "failed" if self.per_device else "open"
            raise self.error

    def picture(self) -> tuple[Seen, ...]:
        shown = self.error if self.per_device and self.state == "failed" else None
        return (Seen("laser", "umd", self.state, error=shown),)

    async def watch(self, stop: asyncio.Event) -> None:
        self.calls.append("watch")
        self.watching.set()
        try:
            await stop.wait()
        finally:
            self.watching.clear()

    async def close_all(self) -> None:
        self.calls.append("close")
        self.state = "closed" if self.state == "open" else self.state


@dataclass
class Runs:
    """A run that goes as far as it is let."""

    go_on: asyncio.Event = field(default_factory=asyncio.Event)
    error: Exception | None = None
    early: bool = False
    cancelled: bool = False
    leaving_s: float = 0.0
    left: bool = False

    async def __call__(self, say: Say) -> None:
        if self.early and self.error is not None:
            raise self.error
        say("P-RUN", folder="/somewhere/20260302T080000000Z-hall-3-ab12")
        say("P-STOP", axis="X1", program="bidirectional", done=3, total=12)
        try:
            await self.go_on.wait()
        except asyncio.CancelledError:
            self.cancelled = True
            with current().leaving():
                await LoopClock().sleep(self.leaving_s)
            self.left = True
            raise
        if self.error is not None:
            raise self.error


def at_desk(
    body: Callable[[JobRunner, asyncio.Event], Awaitable[None]], devices: Devices, starter: RunStarter | None
) -> None:
    """Run `body` beside a working desk in virtual time; the desk must then end by itself."""

    async def main() -> None:
        desk, stop = JobRunner(devices, starter, LoopClock()), asyncio.Event()
        work = asyncio.create_task(desk.work(stop))
        await devices.watching.wait()
        await body(desk, stop)
        stop.set()
        await work
        assert asyncio.all_tasks() == {asyncio.current_task()}

    run_virtual(main)


def test_devices_are_opened_watched_and_closed() -> None:
    devices = Devices()

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        assert [view.state for view in desk.devices()] == ["open"]

    at_desk(body, devices, None)
    assert devices.calls == ["open", "watch", "close"]


def test_a_run_borrows_the_devices_and_gives_them_back() -> None:
    devices, runs = Devices(), Runs()

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        assert await desk.start() == "20260302T080000000Z-hall-3-ab12"
        assert desk.run is not None
        assert (desk.run.axis, desk.run.stage, desk.run.progress) == ("X1", "bidirectional", 0.25)
        assert desk.run.run_id == "20260302T080000000Z-hall-3-ab12"
        assert [view.state for view in desk.devices()] == ["in use"]
        runs.go_on.set()
        await devices.watching.wait()
        assert desk.run is None
        assert desk.failure is None
        assert [view.state for view in desk.devices()] == ["open"]

    at_desk(body, devices, runs)
    assert devices.calls == ["open", "watch", "close", "open", "watch", "close"]


def test_one_run_at_a_time_and_the_next_after_it() -> None:
    devices, runs = Devices(), Runs()

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        await desk.start()
        with pytest.raises(BusyError) as caught:
            await desk.start()
        assert (caught.value.code, caught.value.fields["run"]) == ("E-WEB-BUSY", "20260302T080000000Z-hall-3-ab12")
        runs.go_on.set()
        await devices.watching.wait()
        await desk.start()

    at_desk(body, devices, runs)
    assert devices.calls.count("open") == 2 + 0


def test_a_second_start_in_the_same_breath_is_busy() -> None:
    devices, runs = Devices(), Runs()

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        answers = await asyncio.gather(desk.start(), desk.start(), return_exceptions=True)
        assert answers[0] == "20260302T080000000Z-hall-3-ab12"
        assert isinstance(answers[1], BusyError)

    at_desk(body, devices, runs)


def test_stopping_interrupts_a_run() -> None:
    devices, runs = Devices(), Runs()

    async def body(desk: JobRunner, stop: asyncio.Event) -> None:
        await desk.start()
        stop.set()

    at_desk(body, devices, runs)
    assert runs.cancelled


def test_a_run_that_is_stopped_leaves_its_machine_in_order() -> None:
    devices, runs = Devices(), Runs(leaving_s=18.0)

    async def body(desk: JobRunner, stop: asyncio.Event) -> None:
        await desk.start()
        stop.set()

    at_desk(body, devices, runs)
    assert runs.left


def test_what_is_left_in_the_control_is_shown_while_no_run_has_it() -> None:
    devices, runs = Devices(left=StaleProgram("waiting", 123456, "TFMEAS_X1")), Runs()

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        assert desk.left.kind == "waiting"
        await desk.start()
        assert desk.left.clear
        runs.go_on.set()

    at_desk(body, devices, runs)


async def test_after_the_stop_no_run_begins() -> None:
    desk, stop = JobRunner(Devices(), Runs(), LoopClock()), asyncio.Event()
    stop.set()
    await desk.work(stop)
    with pytest.raises(BusyError) as caught:
        await desk.start()
    assert caught.value.code == "E-WEB-STOPPING"


def test_a_run_that_cannot_begin_tells_its_caller_and_is_over() -> None:
    devices = Devices()
    runs = Runs(error=StoreError("E-STORE-DISK", "runs", why="full"), early=True)

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        for _again in range(2):
            with pytest.raises(StoreError):
                await desk.start()
            await devices.watching.wait()
        assert desk.failure is not None
        assert desk.failure["code"] == "E-STORE-DISK"

    at_desk(body, devices, runs)


def test_a_run_that_fails_later_is_shown_and_the_devices_are_watched_again() -> None:
    devices, runs = Devices(), Runs(error=TransportError("E-LINK-DEADLINE", "laser", timeout_s=1))

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        await desk.start()
        runs.go_on.set()
        await devices.watching.wait()
        assert desk.failure is not None
        assert desk.failure["code"] == "E-LINK-DEADLINE"
        runs.error = None
        await desk.start()
        assert desk.failure is None

    at_desk(body, devices, runs)


def test_a_fault_in_a_run_does_not_end_the_daemon(caplog: pytest.LogCaptureFixture) -> None:
    devices, runs = Devices(), Runs(error=ZeroDivisionError("oops"))

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        await desk.start()
        runs.go_on.set()
        await devices.watching.wait()
        assert desk.failure is not None
        assert desk.failure["code"] == "E-WEB-FAULT"
        assert "ZeroDivisionError: oops" in str(desk.failure["what"])

    at_desk(body, devices, runs)
    assert "ZeroDivisionError" in caplog.text


def test_devices_that_do_not_open_are_watched_all_the_same() -> None:
    devices = Devices(error=TransportError("E-LINK-DEADLINE", "laser", timeout_s=1))

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        (view,) = desk.devices()
        assert view.state == "failed"
        assert view.error is not None
        assert desk.trouble is None

    at_desk(body, devices, None)
    assert devices.calls == ["open", "watch", "close"]


def test_the_wrong_machine_is_trouble_though_every_device_answers() -> None:
    devices = Devices(error=TransportError("E-SUP-MACHINE", "controller", found="B", wanted="A"), per_device=False)

    async def body(desk: JobRunner, _stop: asyncio.Event) -> None:
        assert desk.trouble is not None
        assert desk.trouble["code"] == "E-SUP-MACHINE"

    at_desk(body, devices, None)


async def test_a_task_that_swallows_a_cancel_is_cancelled_again() -> None:
    async def stubborn(times: int) -> None:
        while times:
            try:
                await asyncio.Event().wait()
            except asyncio.CancelledError:
                times -= 1

    task = asyncio.create_task(stubborn(3))
    await LoopClock().sleep(0)
    await interrupt(task, LoopClock())
    assert task.done()


async def test_work_that_ends_by_itself_passes_its_error_on() -> None:
    async def broken() -> None:
        raise StoreError("E-STORE-DISK", "runs", why="full")

    with pytest.raises(StoreError):
        await run_until_signal(broken(), LoopClock(), asyncio.Event())


# -- whole daemon on a loopback socket ---------------------------------------------------------------------


async def nothing_wrong(_say: Say) -> object:
    return None


def serving(folder: Path, devices: Callable[[], Devices] = Devices, site: SiteFile = SITE) -> ServiceParts:
    return ServiceParts(site, folder / "site.toml", Store(folder), devices, nothing_wrong)


def served(
    folder: Path,
    body: Callable[[httpx.AsyncClient, asyncio.Event], Awaitable[None]],
    devices: Devices | None = None,
    site: SiteFile = SITE,
    trust: ssl.SSLContext | bool = True,
) -> float:
    """Serve on a free port, do `body`, stop; returns how long the stop took in seconds."""

    async def main() -> float:
        loop = asyncio.get_running_loop()
        stop, url = asyncio.Event(), loop.create_future()
        one = serving(folder, lambda: devices or Devices(), site)
        daemon = asyncio.create_task(serve([one], clock=LoopClock(), stop=stop, port=0, ready=url.set_result))
        await asyncio.wait((daemon, url), return_when=asyncio.FIRST_COMPLETED)
        if daemon.done():
            await daemon
        bearer = {"Authorization": f"Bearer {token_path(folder).read_text(encoding='ascii').strip()}"}
        async with httpx.AsyncClient(base_url=url.result(), trust_env=False, headers=bearer, verify=trust) as client:
            await body(client, stop)
            begun = loop.time()
            stop.set()
            await daemon
            took = loop.time() - begun
        assert asyncio.all_tasks() == {asyncio.current_task()}
        return took

    return asyncio.run(main())


def test_serves_the_page_and_stops_in_time(tmp_path: Path) -> None:
    seen: dict[str, Any] = {}

    async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        seen["health"] = (await client.get("/healthz")).json()
        seen["page"] = (await client.get("/status")).text
        seen["data"] = (await client.get("/api/v1/sites/hall-3/status")).json()
        seen["url"] = str(client.base_url)
        seen["foreign"] = (await client.get("/healthz", headers={"Host": "attack.example"})).status_code
        seen["headers"] = (await client.get("/healthz")).headers

    assert served(tmp_path, body) < 3.0
    assert seen["health"] == {"status": "ok", "first_start": True}
    assert "hall-3" in seen["page"]
    assert seen["data"]["state"] == "ready"
    assert seen["foreign"] == 400
    assert "server" not in seen["headers"]
    begun, ended = (one for one in lines_of(tmp_path) if one["fields"].get("source") == "service")
    assert f"serves hall-3 at {seen['url']}" in begun["words"]
    assert "ended" in ended["words"]


RUN = "/api/v1/sites/hall-3/commands/run"


def test_a_run_is_started_with_the_token_from_the_file_and_stops_with_the_daemon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs, codes = Runs(), list[int]()
    monkeypatch.setattr(works, "run", lambda _at, _clock: runs)

    async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        codes.append((await client.post(RUN, json={}, headers={"Authorization": "Bearer x"})).status_code)
        answers = await asyncio.gather(
            *(client.post(RUN, json={}, headers={"Idempotency-Key": "k-1"}) for _again in range(20))
        )
        assert {(one.status_code, one.json()["job"]) for one in answers} == {(202, 1)}
        codes.append((await client.post(RUN, json={})).status_code)
        while (data := (await client.get("/api/v1/sites/hall-3/status")).json())["state"] != "running":
            pass
        while (data := (await client.get("/api/v1/sites/hall-3/status")).json())["run"]["done"] != 3:
            pass
        assert (data["run"]["axis"], data["devices"][0]["state"]) == ("X1", "in use")

    assert served(tmp_path, body) < 3.0
    assert codes == [401, 409]
    assert runs.cancelled


def test_a_run_is_stopped_at_the_page_and_its_end_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = Runs()
    monkeypatch.setattr(works, "run", lambda _at, _clock: runs)

    async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        at = "/api/v1/sites/hall-3"
        assert (await client.post(f"{at}/stop", json={})).json() == {"asked": False}
        await client.post(RUN, json={})
        while (await client.get(f"{at}/jobs/1")).json()["run_id"] == "":
            pass
        assert (await client.post(f"{at}/stop", json={})).json() == {"asked": True}
        while (job := (await client.get(f"{at}/jobs/1")).json())["state"] == "running":
            pass
        assert (job["state"], job["error"]["code"]) == ("stopped", "E-STOPPED")
        assert "at the page" in job["error"]["what"]

    served(tmp_path, body)
    assert runs.cancelled


def test_eight_streams_get_the_picture_first_then_every_word_and_end_with_the_daemon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs, heard = Runs(), list[list[str]]()
    monkeypatch.setattr(works, "run", lambda _at, _clock: runs)

    async def listen(client: httpx.AsyncClient, joined: asyncio.Semaphore) -> None:
        kinds: list[str] = []
        heard.append(kinds)
        async with client.stream("GET", "/api/v1/sites/hall-3/stream", timeout=None) as answer:
            async for text in answer.aiter_lines():
                if text.startswith("event: "):
                    kinds.append(text.removeprefix("event: "))
                    if len(kinds) == 1:
                        joined.release()

    async def body(client: httpx.AsyncClient, stop: asyncio.Event) -> None:
        joined = asyncio.Semaphore(0)
        pages = [asyncio.create_task(listen(client, joined)) for _page in range(8)]
        for _page in range(8):
            await joined.acquire()
        await client.post(RUN, json={})
        while any(kinds.count("said") < 2 for kinds in heard):
            await LoopClock().sleep(0)
        stop.set()
        await asyncio.gather(*pages)

    assert served(tmp_path, body) < 5.0
    assert {kinds[0] for kinds in heard} == {"picture"}


def test_a_second_daemon_on_the_same_store_is_refused_with_the_pid(tmp_path: Path) -> None:
    async def body(_client: httpx.AsyncClient, stop: asyncio.Event) -> None:
        with pytest.raises(BusyError) as caught:
            await serve([serving(tmp_path)], clock=LoopClock(), stop=stop, port=0)
        assert caught.value.code == "E-WEB-LOCKED"
        assert caught.value.fields["pid"] == str(os.getpid())

    served(tmp_path, body)
    served(tmp_path, body)


SECURE = SITE.model_copy(
    update={"service": ServiceSection(certificate=Path("gateway.pem"), key=Path("key.pem"), hosts=("gateway.hall",))}
)


def certificate(folder: Path) -> ssl.SSLContext:
    """A certificate of 127.0.0.1 and its key in a folder; who trusts it alone."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "gateway")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number(), now, now + timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))]), critical=False)
        .sign(key, hashes.SHA256())
    )
    plain = serialization.NoEncryption()
    form = serialization.PrivateFormat.PKCS8
    (folder / "key.pem").write_bytes(key.private_bytes(serialization.Encoding.PEM, form, plain))
    (folder / "gateway.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    return ssl.create_default_context(cafile=str(folder / "gateway.pem"))


def test_with_a_certificate_it_is_served_over_tls_alone_and_its_cookie_is_secure(tmp_path: Path) -> None:
    trust = certificate(tmp_path)
    secure = SECURE

    async def main() -> None:
        loop = asyncio.get_running_loop()
        stop, url = asyncio.Event(), loop.create_future()
        one = ServiceParts(secure, tmp_path / "site.toml", Store(tmp_path), Devices, nothing_wrong)
        told = {"clock": LoopClock(), "stop": stop, "port": 0, "ready": url.set_result}
        told |= {"host": "0.0.0.0", "accounts": UserAccounts(tmp_path, Hasher(1, 8))}  # noqa: S104
        daemon = asyncio.create_task(serve([one], **told))  # type: ignore[arg-type]
        await asyncio.wait((daemon, url), return_when=asyncio.FIRST_COMPLETED)
        assert url.result().startswith("https://gateway.hall:"), "0.0.0.0 is no address to open"
        port = url.result().rpartition(":")[2].rstrip("/")
        async with httpx.AsyncClient(base_url=f"https://127.0.0.1:{port}", trust_env=False, verify=trust) as client:
            body = {
                "token": first_token_path(tmp_path).read_text().strip(),
                "name": "anna",
                "password": "a long sentence",
            }
            answer = await client.post("/api/v1/first-start", json=body)
            assert answer.status_code == 200
            assert "Secure" in answer.headers["set-cookie"]
            assert "strict-transport-security" in answer.headers
            assert (await client.get("/healthz", headers={"Host": "gateway.hall"})).status_code == 200
            with pytest.raises(httpx.HTTPError):
                await client.get(f"http://127.0.0.1:{port}/healthz")
        stop.set()
        await daemon

    asyncio.run(main())


async def test_a_certificate_that_cannot_be_used_is_a_message(tmp_path: Path) -> None:
    (tmp_path / "gateway.pem").write_text("none", encoding="ascii")
    secure = SITE.model_copy(
        update={"service": ServiceSection(certificate=Path("gateway.pem"), key=Path("gateway.pem"))}
    )
    one = ServiceParts(secure, tmp_path / "site.toml", Store(tmp_path), Devices, nothing_wrong)
    with pytest.raises(ConfigError) as caught:
        await serve([one], clock=LoopClock(), stop=asyncio.Event(), port=0)
    assert caught.value.code == "E-WEB-FILES"


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "example.com", "::", ""])  # noqa: S104
def test_without_a_certificate_it_is_served_to_this_computer_only(tmp_path: Path, host: str) -> None:
    with pytest.raises(ConfigError) as caught:
        asyncio.run(serve([serving(tmp_path)], clock=LoopClock(), stop=asyncio.Event(), host=host, port=0))
    assert caught.value.code == "E-WEB-BIND"


def test_a_taken_port_is_a_message(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ConfigError) as caught:
            asyncio.run(serve([serving(tmp_path)], clock=LoopClock(), stop=asyncio.Event(), port=port))
    assert (caught.value.code, caught.value.fields["port"]) == ("E-WEB-PORT", port)


def test_a_watch_that_breaks_ends_the_daemon_with_its_error(tmp_path: Path) -> None:
    class Broken(Devices):
        async def watch(self, stop: asyncio.Event) -> None:
            raise RuntimeError("watch broke")

    with pytest.raises(RuntimeError, match="watch broke"):
        asyncio.run(serve([serving(tmp_path, Broken)], clock=LoopClock(), stop=asyncio.Event(), port=0))


# -- devices lent to commands at a terminal ----------------------------------------------------------------


def test_a_command_borrows_the_devices_is_heard_and_gives_them_back(tmp_path: Path) -> None:
    devices = Devices()

    async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        await devices.watching.wait()
        said: list[str] = []
        async with borrow_devices(tmp_path, "r-7", LoopClock(), lambda code, **_f: said.append(code)) as say:
            assert devices.state == "closed"
            say("P-STOP", axis="X1", program="bidirectional", done=5, total=12)
            while (run := (await client.get("/api/v1/sites/hall-3/status")).json()["run"])["done"] != 5:
                pass
            assert (run["run_id"], run["kind"]) == ("r-7", "terminal")
            with pytest.raises(BusyError) as caught:
                async with borrow_devices(tmp_path, "r-8", LoopClock()):
                    pytest.fail("two have the devices")
            assert caught.value.code == "E-BROKER-BUSY"
            assert "r-7" in str(caught.value.fields["why"])
            assert (await client.post(RUN, json={})).status_code == 409
        await devices.watching.wait()
        assert said == ["P-STOP"]
        assert (await client.get("/api/v1/sites/hall-3/jobs/1")).json()["state"] == "ended"

    served(tmp_path, body, devices)
    assert devices.calls == ["open", "watch", "close", "open", "watch", "close"]


def test_a_borrower_that_dies_gives_the_devices_back(tmp_path: Path) -> None:
    devices = Devices()

    async def body(_client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        await devices.watching.wait()
        notice = notice_of(tmp_path)
        assert notice is not None
        reader, writer = await asyncio.open_connection("127.0.0.1", notice.port)
        writer.write(object_line({"token": notice.token, "root": str(tmp_path), "run": "r", "who": "w"}))
        assert await read_object(reader) == {"granted": True}
        assert devices.state == "closed"
        writer.transport.abort()
        await devices.watching.wait()

    served(tmp_path, body, devices)


@pytest.mark.parametrize("asked", [b"", b"nonsense\n", b'{"token": "x", "root": "r"}\n', b"[1]\n", b'{"a":' * 9000])
def test_nobody_borrows_without_the_token(tmp_path: Path, asked: bytes) -> None:
    devices = Devices()

    async def body(_client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        notice = notice_of(tmp_path)
        assert notice is not None
        reader, writer = await asyncio.open_connection("127.0.0.1", notice.port)
        writer.write(asked)
        writer.write_eof()
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b""
        writer.close()

    served(tmp_path, body, devices)
    assert devices.calls.count("open") <= 1


def test_a_stop_at_the_page_reaches_the_terminal(tmp_path: Path) -> None:
    async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        asked = StopAsked()

        async def work() -> None:
            async with borrow_devices(tmp_path, "r-9", LoopClock()):
                await client.post("/api/v1/sites/hall-3/stop", json={})
                await asyncio.Event().wait()

        with pytest.raises(Stopped) as caught:
            await obey(work(), asked, LoopClock())
        assert "at the page" in str(caught.value)

    served(tmp_path, body)


async def test_a_notice_that_a_dead_daemon_left_holds_nobody_up(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with leave_notice(tmp_path, BrokerNotice(1, port, "t")):
        if os.name == "posix":
            assert stat.S_IMODE((tmp_path / "broker.json").stat().st_mode) == 0o600
        async with borrow_devices(tmp_path, "r", LoopClock()):
            pass
    assert notice_of(tmp_path) is None


async def test_devices_are_not_taken_from_a_daemon_that_answers(tmp_path: Path) -> None:
    async def lend(_lease: Lease) -> None:
        pytest.fail("nobody asked for them")

    async with Broker(lend, LoopClock()).open((tmp_path,)):
        with take_from_hung_gateway("it hangs"), pytest.raises(BusyError) as caught:
            async with borrow_devices(tmp_path, "r", LoopClock()):
                pytest.fail("taken")
    assert caught.value.code == "E-BROKER-ANSWERS"


HANGING = """
import os, socket, sys, time
from pathlib import Path
from gateway.broker.state_folder import hold_folder_lock
from gateway.broker.lending import BrokerNotice, leave_notice
root = Path(sys.argv[1])
with socket.create_server(("127.0.0.1", 0)) as server, hold_folder_lock(root):
    with leave_notice(root, BrokerNotice(os.getpid(), server.getsockname()[1], "t")):
        print("hangs", flush=True)
        time.sleep(600)
"""


@pytest.mark.wall_time
async def test_devices_of_a_daemon_that_hangs_are_taken_with_a_reason_and_its_lock_is_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(borrowing, "ANSWER_S", 0.3)
    monkeypatch.setattr(borrowing, "ALIVE_S", 0.3)
    with subprocess.Popen([sys.executable, "-c", HANGING, str(tmp_path)], stdout=subprocess.PIPE, text=True) as hung:  # noqa: ASYNC220
        assert hung.stdout is not None
        assert hung.stdout.readline() == "hangs\n"
        with pytest.raises(TransportError) as caught:
            async with borrow_devices(tmp_path, "r", LoopClock()):
                pytest.fail("it does not answer")
        assert (caught.value.code, caught.value.fields["pid"]) == ("E-BROKER-SILENT", hung.pid)
        with take_from_hung_gateway("the page does not answer"):
            async with borrow_devices(tmp_path, "r", LoopClock()):
                assert hung.wait() != 0
                with pytest.raises(BusyError), hold_folder_lock(tmp_path):
                    pytest.fail("a new daemon came between")
    (entry,) = audit.read_entries(tmp_path)
    assert (entry["action"], entry["details"]["why"]) == ("devices-taken", "the page does not answer")


# -- lock and token ----------------------------------------------------------------------------------------


def test_lock_is_free_again_afterwards_and_survives_a_dead_holder(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).write_text("999999999", encoding="ascii")
    for _again in range(2):
        with hold_folder_lock(tmp_path), pytest.raises(BusyError), hold_folder_lock(tmp_path):
            pytest.fail("two holders")
    assert (tmp_path / LOCK_FILE).read_text(encoding="ascii") == str(os.getpid())


def test_a_store_that_cannot_be_made_is_a_message(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="ascii")
    with pytest.raises(StoreError) as caught, hold_folder_lock(tmp_path / "file"):
        pytest.fail("locked a file")
    assert caught.value.code == "E-WEB-STATE"
    with pytest.raises(StoreError):
        token_of(tmp_path / "gone")


def test_token_is_made_once_kept_and_private(tmp_path: Path) -> None:
    token = token_of(tmp_path)
    assert len(token) >= 43
    assert token_of(tmp_path) == token
    if os.name == "posix":
        assert stat.S_IMODE(token_path(tmp_path).stat().st_mode) == 0o600


@pytest.mark.parametrize("text", ["", "short", "x" * 20, "with space " * 8, "\u00e4" * 50])
def test_a_spoilt_token_is_replaced(tmp_path: Path, text: str) -> None:
    path = token_path(tmp_path)
    path.touch(0o600)
    path.write_text(text, encoding="utf-8")
    assert token_of(tmp_path) != text.strip()
    assert token_of(tmp_path) == path.read_text(encoding="ascii").strip()


@pytest.mark.skipif(os.name != "posix", reason="mode bits say nothing there")
def test_a_token_others_could_read_is_replaced(tmp_path: Path) -> None:
    token = token_of(tmp_path)
    token_path(tmp_path).chmod(0o644)
    assert token_of(tmp_path) != token
    assert stat.S_IMODE(token_path(tmp_path).stat().st_mode) == 0o600


# -- stored runs -------------------------------------------------------------------------------------------


def test_stored_runs_newest_first_with_result_and_report(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert newest_runs(store) == ()
    first, second, broken = (store.create(name) for name in ("one", "two", "three"))
    axis = axis_material("X1", "mm")
    assert axis.verdict is not None
    first.put(
        "verdict",
        Verdict((AxisVerdict("X1", "um", *(axis.verdict.before, axis.verdict.after), True, True, ()),), "better"),
    )
    first.write_text("report.html", "<p>r</p>")
    (broken.path / "run.json").write_text("{", encoding="ascii")
    seen = {run.run_id: run for run in newest_runs(store)}
    assert list(seen) == sorted(seen, reverse=True)
    assert seen[first.run_id].report is True
    assert seen[second.run_id].report is False
    assert seen[broken.run_id].state == "unreadable"
    assert [row.parameter for row in last_result(store)] == ["E", "R", "B", "A", "M", "M_travel"]
    assert stored_report(store, first.run_id) == "<p>r</p>"
    assert stored_report(store, second.run_id) is None
    assert stored_report(store, "gone") is None


def test_pushes_that_did_not_end_are_shown_by_what_their_journals_prove(tmp_path: Path) -> None:
    store = Store(tmp_path / "runs")
    assert pushes_held(store) == ()
    for number, (kind, on) in enumerate((("HELD", False), ("HELD", True), ("ENABLE", None), ("SNAPSHOT", None)), 7):
        folder = journal.machine_folder(store.root / "journal", "SN-1")
        folder.mkdir(parents=True, exist_ok=True)
        kept = journal.Journal.create(folder, number)
        kept.append("LEASED", axis="X1")
        kept.append("DISABLE") if kind != "SNAPSHOT" else None
        kept.append(kind, on=on)
        kept.close()
    told = [(one.words.split(":")[0], one.loud) for one in pushes_held(store)]
    assert told == [("R-HELD-ON", True), ("R-HELD-UNKNOWN", True), ("R-HELD-OFF", False), ("R-HELD-BEFORE", False)]
    (folder / "tx-000007.jnl").write_bytes(b"7|0|nonsense\nmore\n")
    assert sum(one.loud for one in pushes_held(store)) == 3
