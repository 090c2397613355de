"""All status codes of the OPC UA standard: each has a family with its cure, and a restart may answer any of them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.ua.status_codes import code_to_name_doc

from drivers.errors import catalogue
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.sinumerik.opcua.doctor import UaDoctor, UaTrust
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.requests import code_name
from drivers.sinumerik.opcua.session.status import FAMILIES, family_of, is_not_yet, status_error
from simulators.opcua.quirks import STARTING_STATUSES
from tests.contract.opcua_stage import ORDER, Stage, on_stage
from tests.contract.test_opcua_doctor import WANTED
from tests.contract.test_opcua_trust import USER, copied, refused, reissued
from tests.sizes import few

NAMES = sorted({name for name, _ in code_to_name_doc.values()})


def test_every_code_of_the_standard_has_one_family() -> None:
    assert len(NAMES) > 250
    assert [name for name in NAMES if family_of(name) == "other"] == []
    every = [name for names in FAMILIES.values() for name in names]
    assert sorted(every) == sorted(set(every))
    assert set(every) <= set(NAMES)
    assert {family_of(name) for name in NAMES} == {"good", "unsure", *FAMILIES}


@pytest.mark.parametrize("stage", ["login", "read", "write", "call"])
def test_every_bad_code_is_an_error_with_a_cure_that_names_it(stage: Any) -> None:
    for name in [*NAMES, "BadOfSomeMaker"]:
        if name == "Good":
            continue
        error = status_error(name, "840D", stage, "node")
        assert catalogue()[error.code]["do"], name
        assert "<" not in error.what, (name, error.what)
        assert not (error.retryable and stage in ("write", "call"))
        assert name in error.what or error.code == "E-UA-CLOCK"


def test_only_rights_and_absent_nodes_are_final_while_a_control_restarts() -> None:
    final = {name for name in NAMES if name != "Good" and not is_not_yet(status_error(name, "840D", "read", "node"))}
    assert {family_of(name) for name in final} == {"rights", "login", "absent"}
    assert "BadWaitingForInitialData" not in final
    assert {name for names in STARTING_STATUSES.values() for name in names} & final == set()
    assert len(STARTING_STATUSES["any"]) > 150


def test_the_low_half_of_a_code_is_no_part_of_its_name() -> None:
    assert code_name(0x80320000) == code_name(0x80320481) == "BadWaitingForInitialData"


@pytest.mark.parametrize(
    ("starting", "seed"),
    few([("any", 1), ("session", 1), *((kind, seed) for kind in STARTING_STATUSES for seed in range(2, 9))], 2, 8),
)
async def test_any_status_of_a_restarting_control_is_waited_through(keys: Path, starting: str, seed: int) -> None:
    async with on_stage(folder=keys) as on:
        quirks = on.server.quirks
        quirks.starting, quirks.starting_seed = starting, seed
        assert await on.push(ORDER)
        assert on.enabled
        assert quirks.started, starting
        assert (await on.device.state()).axes["C1"].referenced


@pytest.mark.parametrize(
    ("status", "code"), few([("BadUserAccessDenied", "E-UA-RIGHTS"), ("BadNodeIdUnknown", "E-UA-ABSENT")])
)
async def test_a_missing_right_or_node_ends_the_wait_at_once(keys: Path, status: str, code: str) -> None:
    async with on_stage(folder=keys) as on:
        await on.loaded(ORDER)
        await on.device.activate((ORDER,), (ORDER,))
        await on.device.confirm((ORDER,), 120.0)
        on.server.quirks.read_status[nodes.of_axis("aaRef", 3, 1)] = status
        began = on.clock.now()
        error = await refused(on.device.restarted((ORDER,), 120.0), code)
        assert error.fields["status"] == status
        assert on.clock.now() - began < 30.0


# ---- clocks and names --------------------------------------------------------------------------------


def answering(on: Stage, status: str) -> None:
    async def refuse(_certificate: Any, _description: Any) -> None:
        raise ServiceError(getattr(ua.StatusCodes, status))

    on.server._core.certificate_validator = refuse


@pytest.mark.parametrize("status", few(["BadInvalidTimestamp", "BadCertificateTimeInvalid"]))
async def test_a_refused_time_names_how_far_the_clocks_are_apart(keys: Path, status: str) -> None:
    async with on_stage(folder=keys) as on:
        await on.device.close()
        answering(on, status)
        given = {**USER, "server_certificate": str(on.server.certificate), "client_folder": str(keys / "client")}
        late = type(on.clock)(started_utc=datetime.now(UTC) + timedelta(hours=2))
        error = await refused(SinumerikOpcUa("840D", on.server.url, given, late).open(5.0), "E-UA-CLOCK")
        assert float(str(error.fields["ahead_s"])) == pytest.approx(-7200, abs=60)
        lines = await UaDoctor("840D", on.server.url, given, late).examine(WANTED, 5.0)
        clock = [line for line in lines if line.check == "clock"]
        assert [(line.code, line.outcome) for line in clock] == [("E-DOC-CLOCK", "wrong")]


async def test_a_refused_name_is_shown_beside_the_one_that_was_sent(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.device.close()
        answering(on, "BadCertificateUriInvalid")
        given = {**USER, "server_certificate": str(on.server.certificate), "client_folder": str(keys / "client")}
        error = await refused(SinumerikOpcUa("840D", on.server.url, given, on.clock).open(5.0), "E-UA-URI")
        assert error.fields["sent"] == error.fields["certificate"] == "urn:trueflank:gateway"


@pytest.mark.parametrize(("since", "until"), few([(5 / 1440, 20), (-20, -1)]))
async def test_a_person_may_accept_a_certificate_that_is_not_valid_with_a_reason(
    keys: Path, tmp_path: Path, since: float, until: float
) -> None:
    copied(keys, tmp_path)
    reissued(tmp_path, since, until)  # type: ignore[arg-type]

    async def act(on: Stage) -> None:
        place = str(tmp_path / "pinned" / "control.der")
        given = {**USER, "server_certificate": place}
        trust = UaTrust("840D", on.server.url, given, on.clock)
        typed = (await trust.show(5.0)).shown.sha256
        for reason in ("", "   "):
            error = await refused(trust.accept(typed, "anna", 5.0, reason), "E-UA-EXPIRED")
            assert abs(float(str(error.fields["ahead_s"]))) < 60
        view = await trust.accept(typed, "anna", 5.0, "renewal is ordered")
        assert (view.reason, view.accepted_by) == ("renewal is ordered", "anna")
        device = SinumerikOpcUa("840D", on.server.url, given, on.clock)
        await device.open(5.0)
        await device.close()
        lines = await UaDoctor("840D", on.server.url, given, on.clock).examine(WANTED, 5.0)
        said = [line for line in lines if line.code == "W-DOC-EXCUSED"]
        assert ["renewal is ordered" in line.what and "anna" in line.what for line in said] == [True]
        assert "E-DOC-EXPIRED" not in {line.code for line in lines}
        settings = type(device._settings).read(given, "840D")
        assert settings.excused() == ("anna", "renewal is ordered")

    async with on_stage(folder=tmp_path) as on:
        await on.device.close()
        await act(on)
