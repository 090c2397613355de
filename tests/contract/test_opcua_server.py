"""The control's OPC UA server as a client meets it: trust, users, rights, refusals, address space."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from asyncua import ua
from asyncua.client.client import Client

from drivers.errors import ConfigError, TrueflankError
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.sinumerik.opcua.session.certificates import own_key_pair
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.connection import Secrets
from drivers.types.stops import Stop
from simulators.opcua import SinumerikServer
from tests.contract.opcua_stage import SPEC, Stage, on_stage, plan

FOLDER = "Sinumerik/FileSystem/Part Program"


async def refused(work: Any, code: str) -> TrueflankError:
    with pytest.raises(TrueflankError) as caught:
        await work
    assert caught.value.code == code, caught.value
    assert "<" not in caught.value.what
    return caught.value


async def session(on: Stage, user: str = "trueflank", password: str | None = None) -> UaSession:
    made = UaSession(on.server.url, on.clock, "test")
    await made.open(Secrets(user, user if password is None else password), 5.0)
    return made


# ---- who may come in --------------------------------------------------------------------------------


async def test_sign_and_encrypt_with_the_pinned_certificate(keys: Path, tmp_path: Path) -> None:
    async with on_stage(folder=keys) as on:
        (tmp_path / "password").write_text("trueflank\n")
        settings = {"security": "Basic256Sha256", "server_certificate": str(on.server.certificate)}
        settings |= {"password_file": str(tmp_path / "password"), "password": "", "client_folder": str(tmp_path)}
        device = on.driver(**settings)
        identity = await device.open(5.0)
        assert identity.serial == SPEC.serial
        assert (await device.state()).mode == "AUTO"
        await device.close()
        own = tmp_path / "trueflank.key.pem"
        assert own.stat().st_mode & 0o077 == 0


async def test_another_certificate_is_not_trusted_and_shown_by_fingerprint(keys: Path, tmp_path: Path) -> None:
    async with on_stage(folder=keys) as on:
        other = own_key_pair(tmp_path, "other", "urn:sinumerik:opcua:server", "127.0.0.1", server=True)
        device = on.driver(security="Basic256Sha256", server_certificate=str(other.certificate))
        error = await refused(device.open(5.0), "E-UA-TRUST")
        assert error.fields["found"] != error.fields["pinned"]


async def test_a_server_without_encryption_is_refused_unless_asked_for(keys: Path, tmp_path: Path) -> None:
    async with on_stage(folder=keys, server={"security": ["None"]}) as on:
        device = on.driver(security="Basic256Sha256", server_certificate=str(keys / "server.der"))
        await refused(device.open(5.0), "E-UA-POLICY")


async def test_a_control_that_does_not_know_our_certificate(keys: Path, tmp_path: Path) -> None:
    async with on_stage(folder=keys, server={"trusted": []}) as on:
        pinned = {"security": "Basic256Sha256", "server_certificate": str(on.server.certificate)}
        device = on.driver(**pinned, client_folder=str(tmp_path))
        await refused(device.open(5.0), "E-UA-TRUST-US")


@pytest.mark.parametrize(("user", "password"), [("trueflank", "wrong"), ("nobody", "trueflank"), ("trueflank", "")])
async def test_wrong_logins(keys: Path, user: str, password: str) -> None:
    async with on_stage(folder=keys) as on:
        error = await refused(on.driver(user=user, password=password).open(5.0), "E-UA-LOGIN")
        assert "wrong" not in str(error)
        await on.clock.sleep(0.5)
        assert on.server.sessions == 1


async def test_anonymous_may_enter_and_do_nothing(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await refused(on.driver(user="", password="").open(5.0), "E-UA-RIGHTS")
        visitor = await session(on, "", "")
        (value,) = await visitor.read(["/Channel/State/chanStatus"], 5.0)
        assert value.status == "BadUserAccessDenied"
        error = await refused(visitor.call("GetMyAccessRights", [], 5.0), "E-UA-RIGHTS")
        assert error.fields["status"] == "BadRequestNotAllowed"
        await visitor.close()


async def test_no_more_than_ten_sessions(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        guests = [await session(on) for _ in range(9)]
        await refused(session(on), "E-UA-SESSIONS")
        for guest in guests:
            await guest.close()
        assert on.server.sessions == 1


@pytest.mark.parametrize(
    ("settings", "code"),
    [
        ({"security": "None", "usr": "x"}, "E-CFG-SETTING"),
        ({"security": "Basic128Rsa15"}, "E-CFG-SETTING-VALUE"),
        ({}, "E-CFG-SETTING-VALUE"),
        ({"security": "None", "r_first": "80"}, "E-CFG-SETTING-VALUE"),
        ({"security": "None", "r_first": 32530}, "E-CFG-SETTING-VALUE"),
        ({"security": "None", "password": "a", "password_file": "b"}, "E-CFG-SETTING-VALUE"),
        ({"security": "None", "serial_node": "somewhere"}, "E-CFG-SETTING-VALUE"),
    ],
)
def test_settings_are_checked_before_anything_is_connected(settings: dict[str, Any], code: str) -> None:
    with pytest.raises(ConfigError, match=code):
        SinumerikOpcUa("840D", "opc.tcp://127.0.0.1:1", settings, None)  # type: ignore[arg-type]


async def test_files_named_in_the_settings_must_be_there(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        for key, code in (("password_file", "E-UA-SECRET"), ("server_certificate", "E-UA-UNPINNED")):
            settings = {"security": "Basic256Sha256", "server_certificate": str(on.server.certificate), "password": ""}
            device = on.driver(**{**settings, key: str(keys / "missing")})
            error = await refused(device.open(5.0), code)
            assert error.fields["path"] == str(keys / "missing")
        device = on.driver(security="Basic256Sha256", server_certificate=__file__)
        await refused(device.open(5.0), "E-UA-SECRET")


# ---- variants of servers ----------------------------------------------------------------------------


@pytest.mark.parametrize("server", [{"method_folder": "/Methods"}, {"name_space": 5}])
async def test_methods_under_either_parent_and_any_name_space_index(keys: Path, server: dict[str, Any]) -> None:
    async with on_stage(folder=keys, server=server) as on:
        assert len(await on.walk(plan((Stop(5.0, 1),)))) == 1


async def test_r_parameters_that_may_not_be_written(keys: Path) -> None:
    async def act(on: Stage) -> None:
        await refused(on.device.prepare_stops(plan((Stop(5.0, 1),))), "E-UA-RIGHTS")
        assert on.nck.selected == ""
        assert on.nck.files.list("/_N_MPF_DIR") == []

    rights = ["SinuReadAll", "FsRead", "FsWrite", "ApWrite"]
    async with on_stage(
        folder=keys, server={"users": {"trueflank": {"password": "trueflank", "rights": rights}}}
    ) as on:
        await act(on)
    async with on_stage(replace(SPEC, r_writable=False), folder=keys) as on:
        await act(on)


@pytest.mark.parametrize("missing", ["FsWrite", "FsRead", "ApWrite"])
async def test_missing_rights_for_files_and_selection(keys: Path, missing: str) -> None:
    async def act(on: Stage) -> None:
        await refused(on.device.prepare_stops(plan((Stop(5.0, 1),))), "E-UA-RIGHTS")
        assert on.nck.selected == ""

    rights = sorted({"SinuReadAll", "StateWrite", "FsRead", "FsWrite", "ApWrite"} - {missing})
    async with on_stage(
        folder=keys, server={"users": {"trueflank": {"password": "trueflank", "rights": rights}}}
    ) as on:
        await act(on)


async def test_an_access_level_too_low_for_files(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        on.nck.set_access_level(7)
        error = await refused(on.device.prepare_stops(plan((Stop(5.0, 1),))), "E-UA-LEVEL")
        assert error.fields["status"] == "BadNotSupported"


# ---- answers and refusals, one by one ---------------------------------------------------------------


async def test_every_element_is_read_by_identifier(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        made = await session(on)
        on.nck.set("R[90]", 1.5, 7)
        paths = ["/Channel/Parameter/R[u1,90]", "/Channel/Parameter/R[u1, 90]", "/Channel/Parameter/R[u1,89,#3]"]
        paths += ["/Channel/MachineAxis/aaStat[u1,3]", "/NC/_N_AX_TEA_ACX/$MA_MM_ENC_COMP_MAX_POINTS[u3,1]"]
        paths += [
            "/NC/_N_NC_TEA_ACX/$MN_AXCONF_MACHAX_NAME_TAB[u1,2]",
            "/NC/_N_NC_TEA_ACX/$MN_AXCONF_MACHAX_NAME_TAB[u1,4]",
        ]
        values = [reading.value for reading in await made.read(paths, 5.0)]
        assert values == [1.5, 1.5, [0.0, 1.5, 0.0], 4, 80, "Z1", ""]
        await made.close()


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/channel/parameter/R[u1,90]", "BadAttributeIdInvalid"),
        ("R[u1,90]", "BadNodeIdUnknown"),
        ("/Channel/Parameter/R[u1,5000]", "BadAttributeIdInvalid"),
        ("/Channel/Parameter/Q[u1,1]", "BadAttributeIdInvalid"),
        ("/Channel/State/chanStatus[u2]", "BadAttributeIdInvalid"),
        ("/Channel/MachineAxis/aaStat[u1,4]", "BadAttributeIdInvalid"),
        ("/Nck/AA/ENC_COMP[u1,1]", "BadAttributeIdInvalid"),
        ("/NC/_N_AX_TEA_ACX/$MA_NO_SUCH[u1,1]", "BadAttributeIdInvalid"),
        ("/NC/_N_NC_TEA_ACX/$AA_ENC_COMP[u1,1]", "BadAttributeIdInvalid"),
    ],
)
async def test_variables_that_are_not_there(keys: Path, path: str, status: str) -> None:
    async with on_stage(folder=keys) as on:
        made = await session(on)
        good, bad = await made.read(["/Channel/State/chanStatus", path], 5.0)
        assert (good.status, bad.status) == ("", status)
        await made.close()


async def test_what_may_not_be_written(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        made = await session(on)
        enable = "/NC/_N_AX_TEA_ACX/$MA_ENC_COMP_ENABLE[u3,1]"
        await refused(made.write([(enable, True)], 5.0), "E-UA-RIGHTS")
        error = await refused(made.write([("/Channel/State/chanStatus", 0)], 5.0), "E-UA-RIGHTS")
        assert error.fields["status"] == "BadNotWritable"
        administrator = await session(on, "OpcUaClient")
        await refused(administrator.write([("/Channel/Parameter/R[u1,90]", 1.0)], 5.0), "E-UA-RIGHTS")
        await made.write([("/Channel/Parameter/R[u1,90]", 1.0)], 5.0)
        assert on.nck.get("R[90]") == 1.0
        assert on.nck.get("$MA_ENC_COMP_ENABLE[0,C1]") in (0, False)
        await made.close()
        await administrator.close()


async def test_files_and_selection_as_the_manual_says(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        made = await session(on)

        async def send(name: str, overwrite: bool = False, data: bytes = b"M30\n") -> None:
            arguments = [(f"{FOLDER}/{name}", "String"), (data, "ByteString"), (overwrite, "Boolean")]
            await made.call("CopyFileToServer", arguments, 5.0)

        await send("ab.mpf")
        await refused(send("ab.mpf"), "E-UA-REFUSED")
        await send("ab.mpf", overwrite=True, data=b"M0\nM30\n")
        for name in ("a.txt", "a", "a.b.mpf", "../ab.mpf"):
            await refused(send(name), "E-UA-REFUSED")
        assert await made.call("CopyFileFromServer", [(f"{FOLDER}/AB.MPF", "String")], 5.0) == b"M0\nM30\n"
        await refused(made.call("CopyFileFromServer", [(f"{FOLDER}/BC.MPF", "String")], 5.0), "E-UA-FILE")
        await refused(made.call("CopyFileFromServer", [(7, "Int32")], 5.0), "E-UA-TYPE")

        async def select(name: str, channel: int = 1) -> Any:
            return await made.call("Select", [(f"{FOLDER}/{name}", "String"), (channel, "Int32")], 5.0)

        assert [await select("AB.MPF", 2), await select("BC.MPF"), await select("AB.MPF")] == [1, 2, 0]
        on.press()
        await on.clock.sleep(1.0)
        assert on.nck.channel_status == 2
        assert await select("AB.MPF") == 3
        assert "FsWrite" in await made.call("GetMyAccessRights", [], 5.0)
        await refused(made.call("Start", [], 5.0), "E-UA-ABSENT")
        await made.close()


async def test_large_programs_go_through_in_pieces(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        made = await session(on)
        data = b"; a line of a long program\n" * 20000
        arguments = [(f"{FOLDER}/L.MPF", "String"), (data, "ByteString"), (True, "Boolean")]
        await made.call("CopyFileToServer", arguments, 5.0)
        assert await made.call("CopyFileFromServer", [(f"{FOLDER}/L.MPF", "String")], 5.0) == data
        await made.close()


async def test_a_foreign_client_browses_first_elements_only_and_meets_typed_refusals(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        client = Client(on.server.url, timeout=30, watchdog_intervall=30)
        client.set_user("trueflank")
        client.set_password("trueflank")
        async with client:
            index = await client.get_namespace_index("SinumerikVarProvider")
            names = []
            for node in await client.get_node(ua.NodeId("Sinumerik", index)).get_children():
                names.append((await node.read_browse_name()).Name)
            assert "Methods" in names
            assert "R[u1,1]" in names
            assert not [name for name in names if name.startswith("R[u1,2")]
            node = client.get_node(ua.NodeId("/Channel/Parameter/R[u1,97]", index))
            assert await node.read_value() == 0.0
            assert (await node.read_data_type()).Identifier == ua.ObjectIds.Double
            for value, error in (
                (ua.DataValue(ua.Variant(1, ua.VariantType.Int32)), ua.uaerrors.BadTypeMismatch),
                (ua.Variant(1.0, ua.VariantType.Double), ua.uaerrors.BadWriteNotSupported),  # it adds a time stamp
            ):
                with pytest.raises(error):
                    await node.write_value(value)
            await node.write_value(ua.DataValue(ua.Variant(2.5, ua.VariantType.Double)))
            assert on.nck.get("R[97]") == 2.5
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await client.get_node(ua.ObjectIds.Server_ServerStatus_State).write_value(0)


async def test_the_server_listens_on_loopback_and_may_be_stopped_twice(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        assert on.server.url.startswith("opc.tcp://127.0.0.1:")
        other = SinumerikServer(on.nck, on.clock, {"folder": str(keys)})
        await other.start()
        await other.stop()
        await other.stop()
        with pytest.raises(ConfigError, match="E-CFG-SETTING"):
            SinumerikServer(on.nck, on.clock, {"prt": 4840})


async def test_another_index_than_the_name_space_s_is_refused(keys: Path) -> None:
    async with on_stage(folder=keys, server={"name_space": 5}) as on:
        made = await session(on)
        made._index = 2
        (wrong,) = await made.read(["/Channel/State/chanStatus"], 5.0)
        assert wrong.status == "BadNodeIdUnknown"
        await refused(made.write([("/Channel/Parameter/R[u1,90]", 1.0)], 5.0), "E-UA-RIGHTS")
        assert on.nck.get("R[90]") == 0.0
        await made.close()


async def test_a_session_nobody_uses_ends_after_sixty_seconds(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        guest = await session(on)
        assert guest._alive is not None
        guest._alive.cancel()
        await on.clock.sleep(59.0)
        assert on.server.sessions == 2
        await on.clock.sleep(2.0)
        assert on.server.sessions == 1
        await guest.close()


async def test_a_subscription_gets_an_interval_that_the_control_offers(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        client = Client(on.server.url, timeout=30, watchdog_intervall=30)
        client.set_user("trueflank")
        client.set_password("trueflank")
        async with client:
            subscription = await client.create_subscription(120, None)
            assert subscription.parameters.RequestedPublishingInterval == 250.0
            await subscription.delete()
