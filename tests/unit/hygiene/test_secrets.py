"""Secrets come from a file or the environment; a site file holds none, and no copy of one does."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from drivers.local.scrub import HIDDEN, has_user, without_secrets, without_secrets_text
from drivers.sinumerik.opcua.session.connection import read_secrets
from drivers.sinumerik.opcua.settings import UaSettings
from gateway.config import load_site
from gateway.store import RunFolder
from gateway.workflow.run.folder import new_run, site_of
from tests.unit.ground.test_config import GOOD

SECRET = "hunter2-correct-horse"
SETTINGS = "[controller.settings]\n{}\n\n[[instruments]]"


def site(folder: Path, text: str) -> Path:
    path = folder / "site.toml"
    path.write_text(text, encoding="utf-8")
    return path


def with_settings(line: str) -> str:
    return GOOD.replace("[[instruments]]", SETTINGS.format(line), 1)


@pytest.mark.parametrize(
    ("line", "way"),
    [
        (f'password = "{SECRET}"', "password_file"),
        (f"passphrase = '{SECRET}'", "passphrase_env"),
        (f'bus = {{ api_token = "{SECRET}" }}', "bus.api_token_file"),
    ],
)
def test_a_secret_in_a_site_file_is_refused_with_the_way_out(tmp_path: Path, line: str, way: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_site(site(tmp_path, with_settings(line)))
    assert caught.value.fields["key"] == "controller.settings"
    assert way in caught.value.what
    assert SECRET not in str(caught.value) + repr(caught.value)


def test_a_user_in_an_address_is_refused_and_not_shown(tmp_path: Path) -> None:
    for old in ("opc.tcp://127", "socket://127"):
        scheme, host = old.split("//")
        with pytest.raises(ConfigError) as caught:
            load_site(site(tmp_path, GOOD.replace(old, f"{scheme}//ann:{SECRET}@{host}")))
        assert "password_file" in caught.value.what
        assert SECRET not in str(caught.value) + repr(caught.value)
    assert not has_user("folder:///home/a@b/c")


def test_files_and_variables_are_the_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load_site(site(tmp_path, with_settings('user = "u"\npassword_file = "p.txt"')))
    load_site(site(tmp_path, with_settings('user = "u"\npassword_env = "CNC_PASSWORD"\npassword = ""')))
    given = UaSettings.read({"user": "u", "password_env": "CNC_PASSWORD", "security": "None"}, "840D")
    monkeypatch.setenv("CNC_PASSWORD", SECRET)
    assert read_secrets(given, "840D").password == SECRET
    monkeypatch.delenv("CNC_PASSWORD")
    with pytest.raises(ConfigError, match="E-UA-SECRET-ENV"):
        read_secrets(given, "840D")
    with pytest.raises(ConfigError, match="password_env"):
        UaSettings.read({"password_env": "A", "password_file": "b", "security": "None"}, "840D")


HIDING = [
    f'password = "{SECRET}"',
    f"password='{SECRET}' # {SECRET[:0]}",
    f'settings = {{ user = "u", password = "{SECRET}", n = 1 }}',
    f'settings.password = "{SECRET}"',
    f'settings . "password" = "{SECRET}"',
    f'"pass word" = "{SECRET}"',
    f'# password = "{SECRET}"',
    f"#password={SECRET}",
    f'password = """\n{SECRET}\n"""',
    f"api_token = '''{SECRET}'''",
    f'url = "opc.tcp://ann:{SECRET}@host:4840"',
    f'private_key = "a\\"{SECRET}"',
]


@pytest.mark.parametrize("line", HIDING)
def test_a_copy_of_a_site_file_holds_no_secret(line: str) -> None:
    before = f'[site]\nname = "g" # ü\n{line}\nother = [1, 2] # as it was\npassword_file = "p.txt"\n'
    after = without_secrets_text(before)
    assert SECRET not in after
    assert after.startswith('[site]\nname = "g" # ü\n')
    assert after.endswith('\nother = [1, 2] # as it was\npassword_file = "p.txt"\n')
    assert tomllib.loads(after) == without_secrets(tomllib.loads(before))


def test_a_run_folder_keeps_the_site_file_without_what_slipped_through(tmp_path: Path) -> None:
    path = site(tmp_path, f'# the old password = "{SECRET}"\n{GOOD}')
    kept = new_run(load_site(path), path)
    assert SECRET not in kept.read_text("site.toml")
    assert kept.read_text("site.toml").endswith(GOOD)
    assert all(SECRET.encode() not in file.read_bytes() for file in kept.path.iterdir())


def test_a_run_folder_names_no_folder_of_this_computer_and_finds_its_site_wherever_both_go(tmp_path: Path) -> None:
    (tmp_path / "hall").mkdir()
    path = site(tmp_path / "hall", GOOD)
    kept = new_run(load_site(path), path)
    assert all(str(tmp_path).encode() not in file.read_bytes() for file in kept.path.iterdir())
    assert site_of(kept)[1] == path
    moved = (tmp_path / "hall").rename(tmp_path / "elsewhere")
    again = RunFolder(moved / kept.path.relative_to(tmp_path / "hall"))
    assert site_of(again)[1] == moved / "site.toml"


def test_records_of_settings_hide_at_every_depth() -> None:
    told = without_secrets({"a": [{"token": SECRET}], "b": {"c": f"x://u:{SECRET}@h"}, "token_file": "t"})
    assert told == {"a": [{"token": HIDDEN}], "b": {"c": "x://h"}, "token_file": "t"}
