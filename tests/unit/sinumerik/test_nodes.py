"""Identifiers: goldens both ways, blocks, and text that is none."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.sinumerik.opcua.session import nodes

AXES = ("X1", "Z1", "C1")
GOLDEN = tomllib.loads((Path(__file__).parents[2] / "golden" / "sinumerik" / "nodes.toml").read_text())


@pytest.mark.parametrize(("name", "path"), GOLDEN["names"].items())
def test_names_become_identifiers_and_back(name: str, path: str) -> None:
    assert nodes.to_path(name, AXES) == path
    address = nodes.parse(path)
    assert address is not None
    assert address.path == path
    assert nodes.to_names(address, AXES) == (name,)


@pytest.mark.parametrize(("own", "served"), GOLDEN["files"].items())
def test_files_of_the_control_and_of_the_server(own: str, served: str) -> None:
    assert nodes.to_file(own) == served
    assert nodes.from_file(served) == own
    assert nodes.from_file(served.replace(".MPF", ".mpf")) == own


def test_blocks_by_last_element_or_by_count() -> None:
    by_last, by_count = nodes.parse("/Channel/Parameter/R[u1,80,82]"), nodes.parse("/Channel/Parameter/R[u1,80,#3]")
    assert by_last == by_count
    assert by_last is not None
    assert nodes.to_names(by_last, AXES) == ("R[80]", "R[81]", "R[82]")
    assert nodes.r_block(80, 3) == "/Channel/Parameter/R[u1,80,82]"
    assert nodes.parse("/Channel/Parameter/R[u1, 80]") == nodes.parse("/Channel/Parameter/R[u1,80]")


@pytest.mark.parametrize(
    "path",
    [
        "",
        "R[u1,1]",
        "/Channel/Parameter/R[]",
        "/Channel/Parameter/R[u1,3,1]",
        "/Channel/Parameter/R[u1,#3]",
        "/Channel/Parameter/R[u1  ,3]",
        "/Channel/Parameter/R[u1,1",
    ],
)
def test_text_that_is_no_identifier(path: str) -> None:
    assert nodes.parse(path) is None


def test_names_without_a_node_and_elements_that_do_not_exist() -> None:
    assert nodes.to_path("$AA_ENC_COMP[0,1,X1]", AXES) is None
    assert nodes.to_path("$MA_BACKLASH[0,Q1]", AXES) is None
    assert nodes.to_path("R[1,2]", AXES) is None
    for path in (
        "/NC/_N_AX_TEA_ACX/$MA_BACKLASH[u4,1]",
        "/NC/_N_AX_TEA_ACX/$MA_BACKLASH[u1,0]",
        "/Nck/State/numAlarms",
    ):
        address = nodes.parse(path)
        assert address is not None
        assert nodes.to_names(address, AXES) == ()


@pytest.mark.parametrize(
    "path",
    [
        "x.mpf",
        "Sinumerik/FileSystem/Part Program/a.b.mpf",
        "Sinumerik/FileSystem/NC/a.mpf",
        "Sinumerik/FileSystem/Part Program/../x.mpf",
        "Sinumerik/FileSystem/Part Program/x.exe",
    ],
)
def test_files_the_server_does_not_take(path: str) -> None:
    assert nodes.from_file(path) is None


@given(st.text(alphabet="/RuN_[]1239,# $MAX", max_size=60))
def test_any_text_is_parsed_or_refused(text: str) -> None:
    address = nodes.parse(text)
    assert address is None or nodes.parse(address.path) == address


@given(st.integers(0, 9999), st.integers(1, 10))
def test_r_parameters_come_back(number: int, channel: int) -> None:
    path = nodes.to_path(f"R[{number}]", AXES, channel)
    assert path is not None
    address = nodes.parse(path)
    assert address is not None
    assert (address.unit, address.elements) == (channel, (number,))
    assert nodes.kind_of(path) == "Double"
