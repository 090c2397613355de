"""Pinned trust: shown, accepted by a typed thumbprint only, refused when it changes; certificates and their time."""

from __future__ import annotations

import asyncio
import json
import os
import struct
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from typer.testing import CliRunner

from drivers.clock import LoopClock
from drivers.errors import ConfigError, TrueflankError
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.sinumerik.opcua.doctor import UaDoctor, UaTrust
from drivers.sinumerik.opcua.session import connection
from drivers.sinumerik.opcua.session.certificates import own_key_pair, record_path
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.connection import read_secrets
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.types.identity import MachineIdentity
from gateway.cli import app
from gateway.config.loading import load_site
from gateway.store.machine_books import SelfTestBook
from gateway.workflow.run.folder import store_of
from simulators.nck import Nck
from simulators.opcua import SinumerikServer
from simulators.opcua.server import APPLICATION_URI
from tests.contract.opcua_stage import SPEC, Stage, on_stage
from tests.contract.test_opcua_doctor import WANTED
from tests.selftested import passed

USER = {"user": "trueflank", "password": "trueflank"}


async def refused(work: Any, code: str) -> TrueflankError:
    with pytest.raises(TrueflankError) as caught:
        await work
    assert caught.value.code == code, caught.value
    return caught.value


def settings(folder: Path) -> dict[str, Any]:
    return {**USER, "server_certificate": str(folder / "pinned" / "control.der")}


async def test_nothing_is_trusted_until_a_person_types_the_thumbprint(keys: Path, tmp_path: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.device.close()
        trust = UaTrust("840D", on.server.url, settings(tmp_path), on.clock)
        device = SinumerikOpcUa("840D", on.server.url, settings(tmp_path), on.clock)
        place = Path(settings(tmp_path)["server_certificate"])
        await refused(device.open(5.0), "E-UA-UNPINNED")
        view = await trust.show(5.0)
        assert (view.pinned, view.equal, view.shown.subject) == (None, False, "CN=server")
        for typed in ("", "00", view.shown.sha256[:-3], view.own.sha256 if view.own else "", "*"):
            await refused(trust.accept(typed, "anna", 5.0), "E-TRUST-OTHER")
        assert not (await asyncio.to_thread(place.exists))
        assert on.server.sessions == 0
        typed = view.shown.sha1.replace(":", " ").lower()
        view = await trust.accept(typed, "anna", 5.0)
        assert (view.equal, view.accepted_by) == (True, "anna")
        await device.open(5.0)
        await device.close()


@pytest.mark.parametrize("name", ["test_fault_55"])
async def test_fault_55_a_changed_certificate_is_refused_until_it_is_accepted(
    keys: Path, tmp_path: Path, name: str
) -> None:
    async def act(on: Stage) -> None:
        trust = UaTrust("840D", on.server.url, settings(tmp_path), on.clock)
        first = await trust.accept((await trust.show(5.0)).shown.sha256, "anna", 5.0)
        other = SinumerikServer(
            on.nck, on.clock, {"folder": str(tmp_path / "renewed"), "users": {"trueflank": "trueflank"}}
        )
        await other.start()
        device = SinumerikOpcUa("840D", other.url, settings(tmp_path), on.clock)
        error = await refused(device.open(5.0), "E-UA-TRUST")
        assert error.fields["pinned"] == first.shown.sha256
        assert other.sessions == 0
        renewed = UaTrust("840D", other.url, settings(tmp_path), on.clock)
        view = await renewed.show(5.0)
        assert not view.equal
        await refused(renewed.accept(first.shown.sha256, "anna", 5.0), "E-TRUST-OTHER")
        await refused(device.open(5.0), "E-UA-TRUST")
        await renewed.accept(view.shown.sha256, "bert", 5.0)
        await device.open(5.0)
        await device.close()
        place = Path(settings(tmp_path)["server_certificate"])
        records = [json.loads(line) for line in record_path(place).read_text().splitlines()]
        assert [record["who"] for record in records] == ["anna", "bert"]
        assert records[1]["before"] == records[0]["accepted"]
        assert len(list(place.parent.glob("control.der.old-*"))) == 1
        await other.stop()

    assert name
    async with on_stage(folder=keys) as on:
        await act(on)


async def test_fault_56_certificates_near_and_past_their_end(keys: Path, tmp_path: Path) -> None:
    async with on_stage(folder=keys) as on:
        trust = UaTrust("840D", on.server.url, settings(tmp_path), on.clock)
        view = await trust.accept((await trust.show(5.0)).shown.sha256, "anna", 5.0)
        assert view.own is not None
        until = min(view.own.valid_until, view.shown.valid_until)
        for left, code in ((90, ""), (30, "E-DOC-EXPIRES"), (-1, "E-DOC-EXPIRED")):
            late = LoopClock(started_utc=until - timedelta(days=left))
            doctor = UaDoctor("840D", on.server.url, settings(tmp_path), late)
            codes = {line.code for line in await doctor.examine(WANTED, 5.0)}
            assert {found for found in codes if found.startswith("E-DOC-EXP")} == ({code} if code else set())
        device = SinumerikOpcUa("840D", on.server.url, settings(tmp_path), late)
        error = await refused(device.open(5.0), "E-UA-OWN-EXPIRED")
        assert error.fields["path"] == str(tmp_path / "pinned" / "trueflank-client" / "trueflank.der")
        early = LoopClock(started_utc=datetime(2000, 1, 1, tzinfo=UTC))
        await refused(
            UaTrust("840D", on.server.url, settings(tmp_path), early).accept(view.shown.sha256, "a", 5.0),
            "E-UA-EXPIRED",
        )


async def test_fault_57_a_server_that_offers_no_encryption_is_never_accepted(keys: Path, tmp_path: Path) -> None:
    async def act(on: Stage) -> None:
        trust = UaTrust("840D", on.server.url, settings(tmp_path), on.clock)
        await refused(trust.show(5.0), "E-UA-POLICY")
        await refused(trust.accept("AA" * 32, "anna", 5.0), "E-UA-POLICY")

    async with on_stage(folder=keys, server={"security": ["None"]}) as on:
        await act(on)
    with pytest.raises(ConfigError, match="E-TRUST-NO-SECURITY"):
        UaTrust("840D", "opc.tcp://127.0.0.1:1", {**USER, "security": "None"}, LoopClock())


TESTED = b";TRUEFLANK SELF 1 X1\n;AT 2026-3-9\n;PASSED 1 READ\n;TRUEFLANK END 1\nM17\n"
SITE = """
[site]
name = "cell"
[controller]
driver = "sinumerik-opcua"
url = "{url}"
serial = "{serial}"
[controller.settings]
user = "trueflank"
password_file = "{secret}"
server_certificate = "{place}"
[[instruments]]
name = "laser"
driver = "umd"
url = "socket://127.0.0.1:1"
[[axes]]
name = "X1"
letter = "X"
kind = "linear"
travel = [-250.0, 250.0]
encoder = 0
[axes.measure]
instrument = "laser"
component = "EXX"
targets = {{ positions = [0.0, 10.0] }}
feed = 100.0
stable = 1.0
[axes.table]
minimum = -200.0
maximum = 200.0
step = 5.0
"""


@pytest.mark.wall_time
async def test_the_commands(keys: Path, tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    place = tmp_path / "pinned" / "control.der"

    def command(*words: str) -> tuple[int, str]:
        result = CliRunner().invoke(
            app, [*words[:2], str(site), *words[2:]] if len(words) > 1 else [words[0], str(site)]
        )
        return (getattr(result.exception, "exit_code", result.exit_code), result.output)

    clock = LoopClock()
    nck = Nck(SPEC, clock)
    await nck.start()
    server = SinumerikServer(nck, clock, {"folder": str(keys), "users": {"trueflank": "trueflank"}})
    await server.start()
    secret = tmp_path / "password"
    secret.write_text("trueflank\n")
    site.write_text(SITE.format(url=server.url, serial=SPEC.serial, place=place, secret=secret))
    code, said = await asyncio.to_thread(command, "doctor", "certificate", "--json")
    shown = json.loads(said)
    assert (code, shown["equal"], shown["pinned"]) == (5, False, None)
    assert (await asyncio.to_thread(command, "doctor"))[0] == 5
    code, _ = await asyncio.to_thread(command, "doctor", "certificate", "--thumbprint", shown["own"]["sha256"])
    assert code == 5
    assert not (await asyncio.to_thread(place.exists))
    code, said = await asyncio.to_thread(command, "doctor", "certificate", "--thumbprint", shown["shown"]["sha256"])
    assert code == 0, said
    assert "accepted by" in said
    nck.files.write("/_N_SPF_DIR/_N_TFSELF_X1_SPF", TESTED)
    machine = MachineIdentity(SPEC.serial, SPEC.nck_version, tuple(axis.name for axis in SPEC.axes))
    SelfTestBook(store_of(load_site(site), site).root).save(passed(machine))
    code, said = await asyncio.to_thread(command, "doctor", "--json")
    told = json.loads(said)
    assert (code, told["ok"]) == (0, True), [line for line in told["lines"] if line["outcome"] != "ok"]
    code, said = await asyncio.to_thread(command, "doctor")
    assert (code, "WRONG" in said, "next: trueflank run" in said) == (0, False, True)
    assert server.requests.changing == 0
    await server.stop()
    await nck.stop()


@pytest.mark.skipif(os.name != "posix", reason="rights of files are told on POSIX only")
async def test_a_private_key_that_others_may_read_is_named(keys: Path, tmp_path: Path) -> None:
    async with on_stage(folder=keys) as on:
        trust = UaTrust("840D", on.server.url, settings(tmp_path), on.clock)
        await trust.accept((await trust.show(5.0)).shown.sha256, "anna", 5.0)
        key = tmp_path / "pinned" / "trueflank-client" / "trueflank.key.pem"
        for mode, found in ((0o600, False), (0o640, True)):
            await asyncio.to_thread(key.chmod, mode)
            lines = await UaDoctor("840D", on.server.url, settings(tmp_path), on.clock).examine(WANTED, 5.0)
            assert ("E-DOC-KEY-OPEN" in {line.code for line in lines}) == found


# ---- policies ----------------------------------------------------------------------------------------

BOTH = ("Aes256_Sha256_RsaPss", "Basic256Sha256")


@pytest.mark.parametrize(
    ("offered", "asked", "used"),
    [
        (("None", *BOTH[::-1]), "best", BOTH[0]),
        (("None", BOTH[1]), "best", BOTH[1]),
        (("None", *BOTH), BOTH[1], BOTH[1]),
        (("None", BOTH[1]), BOTH[0], ""),
    ],
)
async def test_the_best_policy_that_both_know_is_used(
    keys: Path, tmp_path: Path, offered: tuple[str, ...], asked: str, used: str
) -> None:
    async with on_stage(folder=keys, server={"security": list(offered)}) as on:
        await on.device.close()
        given = {**USER, "security": asked, "server_certificate": str(on.server.certificate)}
        given["client_folder"] = str(keys / "client")
        session = UaSession(on.server.url, on.clock, "840D")
        secrets = read_secrets(UaSettings.read(given, "840D"), "840D")
        lines = {one.check: one for one in await UaDoctor("840D", on.server.url, given, on.clock).examine(WANTED, 5.0)}
        line = lines["policy"]
        if used:
            await session.open(secrets, 5.0)
            assert session.policy == used
            assert session._client.security_policy.URI.endswith(f"#{used}")
            assert used in line.what
            assert (await session.read(["/Nck/Configuration/basicLengthUnit"], 5.0))[0].value is not None
            await session.close()
            assert session.policy == ""
        else:
            error = await refused(session.open(secrets, 5.0), "E-UA-POLICY")
            assert BOTH[0] in error.what
            assert f"{BOTH[1]}/SignAndEncrypt" in error.what
            assert line.code == "E-UA-POLICY"


def reissued(folder: Path, since_days: int, until_days: int) -> x509.Certificate:
    """The server's certificate anew, of the same key, holding from and until so many days from now."""
    path = folder / "server.der"
    old = x509.load_der_x509_certificate(path.read_bytes())
    key = load_pem_private_key((folder / "server.key.pem").read_bytes(), None)
    now = datetime.now(UTC)
    builder = x509.CertificateBuilder(old.issuer, old.subject, old.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(now + timedelta(days=since_days)).not_valid_after(
        now + timedelta(days=until_days)
    )
    for one in old.extensions:
        builder = builder.add_extension(one.value, one.critical)
    made = builder.sign(key, SHA256())  # type: ignore[arg-type]
    path.write_bytes(made.public_bytes(Encoding.DER))
    return made


def copied(keys: Path, folder: Path) -> None:
    """The server's key pair, for a test that spoils it; made here where no test before this one needed it."""
    own_key_pair(keys, "server", APPLICATION_URI, "127.0.0.1", server=True)
    for path in keys.glob("server.*"):
        (folder / path.name).write_bytes(path.read_bytes())


@pytest.mark.parametrize(("since", "until"), [(-20, -1), (1, 20)])
async def test_a_pinned_certificate_that_does_not_hold_now_connects_to_nothing(
    keys: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, since: int, until: int
) -> None:
    copied(keys, tmp_path)
    reissued(tmp_path, since, until)

    async def garbled(*_asked: str) -> Any:
        raise struct.error("no end points")

    async def act(on: Stage) -> None:
        await on.device.close()
        before = dict(on.server.requests.services)
        given = {**USER, "server_certificate": str(on.server.certificate), "client_folder": str(keys / "client")}
        for ask in (connection.query_offer, garbled):
            monkeypatch.setattr(connection, "query_offer", ask)
            error = await refused(SinumerikOpcUa("840D", on.server.url, given, on.clock).open(5.0), "E-UA-EXPIRED")
            assert "doctor certificate" in error.hint
        assert dict(on.server.requests.services) == before
        assert on.server.sessions == 0

    async with on_stage(folder=tmp_path) as on:
        await act(on)


async def test_a_server_whose_end_points_are_garbled_must_still_be_the_pinned_one(
    keys: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def garbled(*_asked: str) -> Any:
        raise struct.error("no end points")

    async def act(on: Stage) -> None:
        await on.device.close()
        monkeypatch.setattr(connection, "query_offer", garbled)
        given = {**USER, "server_certificate": str(on.server.certificate), "client_folder": str(keys / "client")}
        for asked, used in (("best", BOTH[1]), (BOTH[0], BOTH[0])):
            session = UaSession(on.server.url, on.clock, "840D")
            await session.open(read_secrets(UaSettings.read({**given, "security": asked}, "840D"), "840D"), 5.0)
            assert session.policy == used
            await session.close()
        other = own_key_pair(tmp_path, "other", "urn:x", "127.0.0.1", server=True)
        given["server_certificate"] = str(other.certificate)
        with pytest.raises(TrueflankError):
            await SinumerikOpcUa("840D", on.server.url, given, on.clock).open(5.0)
        assert on.server.sessions == 0

    async with on_stage(folder=keys) as on:
        await act(on)
