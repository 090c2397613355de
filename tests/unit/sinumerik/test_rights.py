"""One table of rights: what doctor asks for, what a person is told, what the pages list."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from drivers.sinumerik.opcua.rights import ALL_READING, OLDEST_NAME, RIGHTS, as_page, held, missing, surplus, version_of
from simulators.opcua.address_space import GATEWAY_RIGHTS
from simulators.opcua.address_space import RIGHTS as KNOWN_TO_THE_SIMULATOR

ROOT = Path(__file__).parents[3]
NAME = re.compile(r"\b(?:Sinu(?:Read|Write)All|[A-Z][A-Za-z]{0,6}(?:Read|Write))\b")
EVERY = {right.name for right in RIGHTS}
READING = {right.name for right in RIGHTS if right.use == "reading"}
WHOLE = EVERY - READING | {ALL_READING}


def test_the_simulator_and_the_table_were_written_apart_and_agree() -> None:
    assert set(GATEWAY_RIGHTS) == WHOLE
    assert EVERY <= KNOWN_TO_THE_SIMULATOR


def test_spelling_does_not_matter() -> None:
    assert held("SINUREADALL;FSRead, fswrite statewrite\nAPWRITE") == {"SinuReadAll", "FsRead", "FsWrite", "StateWrite",
                                                                      "ApWrite"}  # fmt: skip
    assert held(["FSRead", "Strange"]) == {"FsRead", "Strange"}
    assert held(None) == frozenset()


@pytest.mark.parametrize(
    ("version", "lacking", "perhaps"),
    [((2, 0), (), ()), ((3, 1), ("ApWrite",), ()), (None, (), ("ApWrite",))],
)
def test_a_right_is_asked_of_the_servers_that_know_it(
    version: tuple[int, int] | None, lacking: tuple[str, ...], perhaps: tuple[str, ...]
) -> None:
    assert missing(WHOLE - {"ApWrite"}, version, "reading", "writing") == (lacking, perhaps)
    assert missing({"StateRead", "TeaRead"}, version, "reading") == (("SeaRead",), ())


def test_who_only_reads_needs_nothing_that_changes() -> None:
    assert surplus(WHOLE) == ()
    assert surplus(WHOLE, reads_alone=True) == ("StateWrite", "FsWrite", "ApWrite")
    assert surplus({*WHOLE, "TeaWrite"}) == ("TeaWrite",)


@pytest.mark.parametrize(("text", "found"), [("V02.00.01.00", (2, 0)), ("3.1 SP2", (3, 1)), ("", None), ("x", None)])
def test_versions(text: str, found: tuple[int, int] | None) -> None:
    assert version_of(text) == found


def test_the_pages_list_the_table() -> None:
    controls = (ROOT / "docs/controls.md").read_text(encoding="utf-8")
    assert f"as_page() -->\n{as_page()}\n<!--" in controls
    assert OLDEST_NAME in controls
    for page, wanted in (("first-day.md", WHOLE), ("deployment.md", EVERY | {ALL_READING})):
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        assert set(NAME.findall(text)) == wanted, page


@pytest.mark.parametrize("language", ["en", "de", "zh"])
def test_what_a_person_is_told_lists_the_table(language: str) -> None:
    texts: dict[str, dict[str, str]] = {}
    for path in (ROOT / "drivers/messages" / language).glob("*.toml"):
        texts |= tomllib.loads(path.read_text(encoding="utf-8"))
    assert set(NAME.findall(texts["E-UA-RIGHTS"]["do"])) == WHOLE
    assert set(NAME.findall(texts["W-DOC-RIGHTS-UNKNOWN"]["do"])) == WHOLE
    assert set(NAME.findall(texts["P-INIT-USER"]["do"])) == EVERY


@pytest.mark.parametrize(
    "answer",
    ["FS_READ;fs-write", "FsRead|FsWrite", '["FsRead","FsWrite"]', ("FSREAD ", "fswrite\n"), "FsRead=1; FsWrite=1"],
)
def test_what_stands_between_and_in_names_of_rights_does_not_matter(answer: object) -> None:
    assert held(answer) == {"FsRead", "FsWrite"}
