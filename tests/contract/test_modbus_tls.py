"""Modbus/TCP Security: the mailbox inside TLS, both ends with certificates; every refusal in plain words."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.checks import Wanted
from drivers.clock import LoopClock
from drivers.errors import ConfigError, TrueflankError
from drivers.sinumerik.mailbox.device import ModbusDoctor, SinumerikModbus
from drivers.sinumerik.mailbox.settings import ModbusSettings
from tests import certificates
from tests.certificates import Made
from tests.contract.modbus_stage import Stage, on_stage, order_for, table

URL = "tcp://127.0.0.1:0"


class Papers:
    """An authority of the plant, the PLC's certificate and ours, and two that nobody knows."""

    def __init__(self, folder: Path) -> None:
        self.plant = certificates.made(folder, "plant")
        self.plc = certificates.made(folder, "plc.hall", self.plant)
        self.old = certificates.made(folder, "old.hall", self.plant, days=-1)
        self.own = certificates.made(folder, "gateway", self.plant)
        self.stranger = certificates.made(folder, "stranger")
        self.hidden = certificates.made(folder, "hidden", self.plant, password="four words")

    def settings(self, trusted: Made | None = None, own: Made | None = None, **more: Any) -> dict[str, Any]:
        """Keys of a site file: the PLC's own certificate is trusted, and we are who we are."""
        own = own or self.own
        files = {"client_certificate": str(own.certificate), "client_key_file": str(own.key)}
        return {"security": "tls", "server_certificate": str((trusted or self.plc).certificate), **files, **more}


@pytest.fixture(scope="module")
def papers(tmp_path_factory: pytest.TempPathFactory) -> Papers:
    return Papers(tmp_path_factory.mktemp("papers"))


async def secured(on: Stage, papers: Papers, shown: Made | None = None) -> None:
    """The PLC listens again, by TLS alone."""
    await on.station.pull()
    on.station.tls = certificates.server(shown or papers.plc, papers.plant)
    await on.station.plug(URL)


def device(on: Stage, settings: dict[str, Any]) -> SinumerikModbus:
    given = {"unit": on.plc.settings.unit, "needs_reference": False, **settings}
    return SinumerikModbus("grinder", on.station.url, given, on.bench.clock)


GOOD: dict[str, Callable[[Papers], dict[str, Any]]] = {
    "the PLC's own certificate": lambda p: p.settings(),
    "the plant's authority": lambda p: p.settings(p.plant, server_name="plc.hall"),
}


@pytest.mark.parametrize("how", GOOD)
async def test_a_whole_push_goes_through_tls(papers: Papers, how: str) -> None:
    async with on_stage(URL, opened=False) as on:
        await secured(on, papers)
        on.device = device(on, GOOD[how](papers))
        assert on.device.capabilities.unprotected is None
        await on.device.open(5.0)
        old, new = await on.push(await order_for(on.device, table(12)))
        assert (old.own.enabled, new.own.table.deviations) == (False, table(12).deviations)
        assert on.get("$MA_ENC_COMP_ENABLE[0,X1]")


BAD: dict[str, tuple[str, Callable[[Papers], dict[str, Any]]]] = {
    "a PLC that nobody pinned": ("E-TLS-TRUST", lambda p: p.settings(p.stranger)),
    "another PLC of the same plant": ("E-TLS-OTHER", lambda p: p.settings(p.plant)),
    "another name": ("E-TLS-NAME", lambda p: p.settings(p.plant, server_name="other.hall")),
    "a client that the PLC does not know": ("E-TLS-REFUSED", lambda p: p.settings(own=p.stranger)),
    "no such file": ("E-TLS-FILE", lambda p: p.settings(server_certificate="/nowhere/plc.pem")),
    "no certificate in the file": ("E-TLS-FILE", lambda p: p.settings(server_certificate=str(p.own.key))),
    "a key of another certificate": ("E-TLS-FILE", lambda p: p.settings(client_key_file=str(p.plc.key))),
    "a key behind a password": ("E-TLS-FILE", lambda p: p.settings(own=p.hidden)),
}


@pytest.mark.parametrize("how", BAD)
async def test_what_is_wrong_with_a_certificate_is_said(papers: Papers, how: str) -> None:
    code, settings = BAD[how]
    async with on_stage(URL, opened=False) as on:
        await secured(on, papers)
        await refused(device(on, settings(papers)), code)
        assert on.station.served == 0


async def refused(one: SinumerikModbus, code: str) -> None:
    with pytest.raises(TrueflankError) as caught:
        await one.open(5.0)
    await one.close()
    assert (caught.value.code, bool(caught.value.hint)) == (code, True)


async def test_a_certificate_that_has_ended_is_told_by_its_date(papers: Papers) -> None:
    async with on_stage(URL, opened=False) as on:
        await secured(on, papers, papers.old)
        await refused(device(on, papers.settings(papers.old)), "E-TLS-DATE")


async def test_a_plain_port_is_not_taken_for_a_secured_one_nor_the_other_way(papers: Papers) -> None:
    async with on_stage(URL, opened=False) as on:
        await refused(device(on, papers.settings()), "E-TLS-NONE")
        await secured(on, papers)
        with pytest.raises(TrueflankError):
            await device(on, {}).open(5.0)


async def test_the_doctor_says_which_it_is(papers: Papers) -> None:
    async with on_stage(URL, opened=False) as on:
        await secured(on, papers)
        settings = {"unit": on.plc.settings.unit, **papers.settings()}
        doctor = ModbusDoctor("grinder", on.station.url, settings, on.bench.clock)
        lines = {line.check: (line.outcome, line.code) for line in await doctor.examine(Wanted("", ()), 5.0)}
        assert lines["protection"] == ("ok", "W-DOC-TLS")
        assert lines["mailbox"][0] == "ok"


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"security": "tls"}, "server_certificate"),
        ({"server_certificate": "plc.pem"}, "server_certificate"),
        ({"server_name": "plc.hall"}, "server_name"),
        ({"security": "tls", "framer": "rtu"}, "framer"),
    ],
)
def test_half_of_it_is_a_mistake_of_the_site_file(settings: dict[str, Any], key: str) -> None:
    assert key in [fault.key for fault in ModbusSettings.faults(settings)]


async def test_tls_goes_over_tcp_alone(papers: Papers) -> None:
    one = SinumerikModbus("grinder", "memory://plc", papers.settings(), LoopClock())
    with pytest.raises(ConfigError, match="E-LINK-URL"):
        await one.open(5.0)
