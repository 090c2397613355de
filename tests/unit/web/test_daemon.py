"""The daemon: one for a store, one run at a time, devices lent and taken back, ended in time."""

from __future__ import annotations

import asyncio
import os
import socket
import stat
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError, TransportError, TrueflankError
from drivers.leftover import NOTHING, LeftOver
from gateway.config import SiteFile
from gateway.daemon import RunStarter, serve, token_path
from gateway.daemon.desk import Desk, interrupt, unless
from gateway.daemon.lock import LOCK_FILE, locked
from gateway.daemon.stored import last_result, newest_runs, pushes_held, stored_report
from gateway.daemon.token import token_of
from gateway.domain.outcomes import AxisVerdict, Verdict
from gateway.errors import BusyError, StoreError
from gateway.push.records import journal
from gateway.say import Say
from gateway.stopping import current
from gateway.store import Store
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
    left: LeftOver = NOTHING
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
    body: Callable[[Desk, asyncio.Event], Awaitable[None]], devices: Devices, starter: RunStarter | None
) -> None:
    """Run `body` beside a working desk in virtual time; the desk must then end by itself."""

    async def main() -> None:
        desk, stop = Desk(devices, starter, LoopClock()), asyncio.Event()
        work = asyncio.create_task(desk.work(stop))
        await devices.watching.wait()
        await body(desk, stop)
        stop.set()
        await work
        assert asyncio.all_tasks() == {asyncio.current_task()}

    run_virtual(main)


def test_devices_are_opened_watched_and_closed() -> None:
    devices = Devices()

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
        assert [view.state for view in desk.devices()] == ["open"]

    at_desk(body, devices, None)
    assert devices.calls == ["open", "watch", "close"]


def test_a_run_borrows_the_devices_and_gives_them_back() -> None:
    devices, runs = Devices(), Runs()

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
        assert await desk.start() == "20260302T080000000Z-hall-3-ab12"
        assert desk.run is not None
        assert (desk.run.axis, desk.run.stage, desk.run.progress) == ("X1", "bidirectional", 0.25)
        assert desk.run.run_id == "20260302T080000000Z-hall-3-ab12"
        assert [view.state for view in desk.devices()] == ["lent"]
        runs.go_on.set()
        await devices.watching.wait()
        assert desk.run is None
        assert desk.failure is None
        assert [view.state for view in desk.devices()] == ["open"]

    at_desk(body, devices, runs)
    assert devices.calls == ["open", "watch", "close", "open", "watch", "close"]


def test_one_run_at_a_time_and_the_next_after_it() -> None:
    devices, runs = Devices(), Runs()

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
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

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
        answers = await asyncio.gather(desk.start(), desk.start(), return_exceptions=True)
        assert answers[0] == "20260302T080000000Z-hall-3-ab12"
        assert isinstance(answers[1], BusyError)

    at_desk(body, devices, runs)


def test_stopping_interrupts_a_run() -> None:
    devices, runs = Devices(), Runs()

    async def body(desk: Desk, stop: asyncio.Event) -> None:
        await desk.start()
        stop.set()

    at_desk(body, devices, runs)
    assert runs.cancelled


def test_a_run_that_is_stopped_leaves_its_machine_in_order() -> None:
    devices, runs = Devices(), Runs(leaving_s=18.0)

    async def body(desk: Desk, stop: asyncio.Event) -> None:
        await desk.start()
        stop.set()

    at_desk(body, devices, runs)
    assert runs.left


def test_what_is_left_in_the_control_is_shown_while_no_run_has_it() -> None:
    devices, runs = Devices(left=LeftOver("waiting", 123456, "TFMEAS_X1")), Runs()

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
        assert desk.left.kind == "waiting"
        await desk.start()
        assert desk.left.clear
        runs.go_on.set()

    at_desk(body, devices, runs)


async def test_after_the_stop_no_run_begins() -> None:
    desk, stop = Desk(Devices(), Runs(), LoopClock()), asyncio.Event()
    stop.set()
    await desk.work(stop)
    with pytest.raises(BusyError) as caught:
        await desk.start()
    assert caught.value.code == "E-WEB-STOPPING"


def test_a_run_that_cannot_begin_tells_its_caller_and_is_over() -> None:
    devices = Devices()
    runs = Runs(error=StoreError("E-STORE-DISK", "runs", why="full"), early=True)

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
        for _again in range(2):
            with pytest.raises(StoreError):
                await desk.start()
            await devices.watching.wait()
        assert desk.failure is not None
        assert desk.failure["code"] == "E-STORE-DISK"

    at_desk(body, devices, runs)


def test_a_run_that_fails_later_is_shown_and_the_devices_are_watched_again() -> None:
    devices, runs = Devices(), Runs(error=TransportError("E-LINK-DEADLINE", "laser", timeout_s=1))

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
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

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
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

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
        (view,) = desk.devices()
        assert view.state == "failed"
        assert view.error is not None
        assert desk.trouble is None

    at_desk(body, devices, None)
    assert devices.calls == ["open", "watch", "close"]


def test_the_wrong_machine_is_trouble_though_every_device_answers() -> None:
    devices = Devices(error=TransportError("E-SUP-MACHINE", "controller", found="B", wanted="A"), per_device=False)

    async def body(desk: Desk, _stop: asyncio.Event) -> None:
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
        await unless(broken(), LoopClock(), asyncio.Event())


# -- whole daemon on a loopback socket ---------------------------------------------------------------------


def served(
    folder: Path,
    body: Callable[[httpx.AsyncClient, asyncio.Event], Awaitable[None]],
    starter: RunStarter | None = None,
    devices: Devices | None = None,
) -> float:
    """Serve on a free port, do `body`, stop; returns how long the stop took in seconds."""

    async def main() -> float:
        loop = asyncio.get_running_loop()
        stop, url = asyncio.Event(), loop.create_future()
        daemon = asyncio.create_task(
            serve(
                SITE, lambda: devices or Devices(), starter, store=Store(folder), clock=LoopClock(),
                stop=stop, port=0, ready=url.set_result,
            )
        )  # fmt: skip
        await asyncio.wait((daemon, url), return_when=asyncio.FIRST_COMPLETED)
        if daemon.done():
            await daemon
        async with httpx.AsyncClient(base_url=url.result(), trust_env=False) as client:
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
        seen["page"] = (await client.get("/")).text
        seen["data"] = (await client.get("/api/status")).json()
        seen["foreign"] = (await client.get("/healthz", headers={"Host": "attack.example"})).status_code
        seen["headers"] = (await client.get("/healthz")).headers

    assert served(tmp_path, body) < 3.0
    assert seen["health"] == {"status": "ok"}
    assert "hall-3" in seen["page"]
    assert seen["data"]["state"] == "ready"
    assert seen["foreign"] == 400
    assert "server" not in seen["headers"]


def test_a_run_is_started_with_the_token_from_the_file_and_stops_with_the_daemon(tmp_path: Path) -> None:
    runs, codes = Runs(), list[int]()

    async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        bearer = {"Authorization": f"Bearer {token_path(tmp_path).read_text(encoding='ascii').strip()}"}
        codes.append((await client.post("/api/runs")).status_code)
        answer = await client.post("/api/runs", headers=bearer)
        codes.append(answer.status_code)
        assert answer.json() == {"run_id": "20260302T080000000Z-hall-3-ab12"}
        codes.append((await client.post("/api/runs", headers=bearer)).status_code)
        data = (await client.get("/api/status")).json()
        assert (data["state"], data["run"]["axis"], data["run"]["done"]) == ("running", "X1", 3)
        assert data["devices"][0]["state"] == "lent"

    assert served(tmp_path, body, runs) < 3.0
    assert codes == [401, 202, 409]
    assert runs.cancelled


def test_requests_that_never_end_do_not_hold_the_daemon(tmp_path: Path) -> None:
    with socket.socket() as half_body, socket.socket() as half_line:

        async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
            where = (client.base_url.host, client.base_url.port)
            for slow, text in (
                (half_body, b"POST /api/runs HTTP/1.1\r\nContent-Length: 9\r\n"),
                (half_line, b"GET /he"),
            ):
                slow.connect(where)
                slow.sendall(text)
            assert (await client.get("/healthz")).status_code == 200

        assert served(tmp_path, body) < 3.0


def test_a_caller_who_waits_for_a_run_is_told_that_the_daemon_stops(tmp_path: Path) -> None:
    async def silent(_say: Say) -> None:
        await asyncio.Event().wait()

    answers: list[asyncio.Task[httpx.Response]] = []

    async def body(client: httpx.AsyncClient, stop: asyncio.Event) -> None:
        bearer = {"Authorization": f"Bearer {token_of(tmp_path)}"}
        answers.append(asyncio.create_task(client.post("/api/runs", headers=bearer)))
        while (await client.get("/api/status")).json()["run"] is None:
            pass
        stop.set()
        answer = await answers[0]
        assert (answer.status_code, answer.json()["code"]) == (409, "E-WEB-STOPPING")

    assert served(tmp_path, body, silent) < 3.0


def test_a_second_daemon_on_the_same_store_is_refused_with_the_pid(tmp_path: Path) -> None:
    async def body(_client: httpx.AsyncClient, stop: asyncio.Event) -> None:
        with pytest.raises(BusyError) as caught:
            await serve(SITE, Devices, None, store=Store(tmp_path), clock=LoopClock(), stop=stop, port=0)
        assert caught.value.code == "E-WEB-LOCKED"
        assert caught.value.fields["pid"] == str(os.getpid())

    served(tmp_path, body)
    served(tmp_path, body)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "example.com", "::", ""])  # noqa: S104
def test_it_is_served_to_this_computer_only(tmp_path: Path, host: str) -> None:
    with pytest.raises(ConfigError) as caught:
        asyncio.run(
            serve(
                SITE, Devices, None, store=Store(tmp_path), clock=LoopClock(), stop=asyncio.Event(), host=host, port=0
            )
        )  # fmt: skip
    assert caught.value.code == "E-WEB-BIND"


def test_a_taken_port_is_a_message(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ConfigError) as caught:
            asyncio.run(
                serve(SITE, Devices, None, store=Store(tmp_path), clock=LoopClock(), stop=asyncio.Event(), port=port)
            )
    assert (caught.value.code, caught.value.fields["port"]) == ("E-WEB-PORT", port)


def test_a_watch_that_breaks_ends_the_daemon_with_its_error(tmp_path: Path) -> None:
    class Broken(Devices):
        async def watch(self, stop: asyncio.Event) -> None:
            raise RuntimeError("watch broke")

    with pytest.raises(RuntimeError, match="watch broke"):
        asyncio.run(serve(SITE, Broken, None, store=Store(tmp_path), clock=LoopClock(), stop=asyncio.Event(), port=0))


# -- lock and token ----------------------------------------------------------------------------------------


def test_lock_is_free_again_afterwards_and_survives_a_dead_holder(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).write_text("999999999", encoding="ascii")
    for _again in range(2):
        with locked(tmp_path), pytest.raises(BusyError), locked(tmp_path):
            pytest.fail("two holders")
    assert (tmp_path / LOCK_FILE).read_text(encoding="ascii") == str(os.getpid())


def test_a_store_that_cannot_be_made_is_a_message(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="ascii")
    with pytest.raises(StoreError) as caught, locked(tmp_path / "file"):
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
        Verdict((AxisVerdict("X1", "um", *(axis.verdict.before, axis.verdict.after), True, True, "b"),), "better"),
    )
    first.write_text("report.html", "<p>r</p>")
    (broken.path / "run.json").write_text("{", encoding="ascii")
    seen = {run.run_id: run for run in newest_runs(store)}
    assert list(seen) == sorted(seen, reverse=True)
    assert seen[first.run_id].report is True
    assert seen[second.run_id].report is False
    assert seen[broken.run_id].state == "unreadable"
    assert [row.parameter for row in last_result(store)] == ["E", "R", "B", "A", "M"]
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
