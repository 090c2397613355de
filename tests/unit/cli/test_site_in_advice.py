"""What to type next names the site file that the command was given, in every text."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from gateway.cli import app
from gateway.cli.output import echo, remember_site, show_error, with_site

ROOT = Path(__file__).parents[3]
BARE = re.compile(r"\bSITE\b")


def advice() -> list[str]:
    """Every text of the catalogue, in every language, that names a command with a site file."""
    found = []
    for path in sorted((ROOT / "drivers" / "messages").rglob("*.toml")):
        for entry in tomllib.loads(path.read_text(encoding="utf-8")).values():
            if isinstance(entry, dict):
                found += [text for text in entry.values() if isinstance(text, str) and BARE.search(text)]
    return found


def test_no_text_keeps_the_bare_word_once_the_site_is_known() -> None:
    texts = advice()
    assert len(texts) > 40
    remember_site({"site": Path("hall 3/site.toml")})
    kept = [text for text in map(with_site, texts) if BARE.search(text)]
    remember_site({})
    assert kept == []
    assert [with_site(text) for text in texts] == texts, "nobody knows which is meant"


def test_a_refusal_names_the_file_that_the_command_was_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = tmp_path / "hall.toml"
    site.write_bytes((ROOT / "examples" / "sites" / "mailbox-grinder.toml").read_bytes())
    refused = CliRunner().invoke(app, ["run", str(site), "--plan"]).exception
    assert isinstance(refused, TrueflankError)
    show_error(refused, as_json=False)
    assert f"trueflank measure {site} --plan" in " ".join(capsys.readouterr().err.split())
    CliRunner().invoke(app, ["explain", "E-RUN"])
    echo("trueflank run SITE")
    assert capsys.readouterr().out == "trueflank run SITE\n"
