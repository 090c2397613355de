"""What the handbook shows to copy is taken: instruments by the check of a site file, keys of the page by its words."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.setup.check import check_site

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```toml\n(.*?)^```", re.DOTALL | re.MULTILINE)
BOLD = re.compile(r"\*\*(.+?)\*\*", re.DOTALL)


def _page(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def _instruments() -> list[str]:
    return [block for block in BLOCK.findall(_page("docs/instruments.md")) if block.startswith("[[instruments]]")]


def _checked(tmp_path: Path, text: str) -> list[str]:
    (tmp_path / "site.toml").write_text(text, encoding="utf-8")
    (tmp_path / "control.der").write_bytes(b"\x30\x82")
    (tmp_path / "laser.rtl").write_bytes((ROOT / "tests" / "golden" / "files" / "basic.rtl").read_bytes())
    return [fault.error("site").what for fault in check_site(tmp_path / "site.toml").faults]


def _site() -> str:
    return next(iter(BLOCK.findall(_page("docs/connecting.md"))))


@pytest.mark.parametrize("block", _instruments())
def test_an_instrument_of_the_handbook_is_taken_by_the_check(
    block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRUEFLANK_PASSWORD", "x")
    site = re.sub(r"^instruments = .*\n", "", _site(), flags=re.MULTILINE)
    name = tomllib.loads(block)["instruments"][0]["name"]
    assert _checked(tmp_path, site.replace('instrument = "laser"', f'instrument = "{name}"') + "\n" + block) == []


def test_an_axis_from_a_file_is_taken_by_the_check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUEFLANK_PASSWORD", "x")
    (block,) = (one for one in BLOCK.findall(_page("docs/instruments.md")) if one.startswith("[axes.measure]"))
    site = re.sub(r"^(instruments|measure) = .*\n", "", _site(), flags=re.MULTILINE)
    assert _checked(tmp_path, site + "\n" + block) == []


def test_every_instrument_driver_and_every_road_has_its_way() -> None:
    page = _page("docs/instruments.md")
    shown = {tomllib.loads(block)["instruments"][0]["driver"] for block in _instruments()}
    assert shown == {"umd", "attocube-ids", "bridge", "gauge", "manual"}
    roads = ("sinumerik-opcua", "sinumerik-modbus", "sinumerik-offline", "linuxcnc-agent")
    assert [road for road in roads if f"`{road}`" not in page] == []


def _words(tree: dict[str, Any]) -> Iterator[str]:
    for one in tree.values():
        if isinstance(one, dict):
            yield from _words(one)
        else:
            yield str(one)


def test_every_key_that_the_tutorial_of_the_page_presses_is_on_the_page() -> None:
    said = {*_words(tomllib.loads(_page("drivers/messages/page/en.toml")))}
    pressed = {" ".join(word.split()) for word in BOLD.findall(_page("docs/tutorial-page.md"))}
    assert len(pressed) > 15
    assert sorted(pressed - said) == []
