"""The structured text of docs/plc: its constants are those of the codec, and nothing in it is undeclared."""

from __future__ import annotations

import re
from enum import IntEnum, IntFlag
from pathlib import Path

import pytest

from drivers.sinumerik.mailbox.codec import registers

FOLDER = Path(__file__).parents[3] / "docs" / "plc"
FILES = sorted(FOLDER.glob("*.st"))
CODE = {path.name: re.sub(r"\(\*.*?\*\)", "", path.read_text(encoding="utf-8"), flags=re.DOTALL) for path in FILES}
ORDER = ("tf_types.st", "tf_constants.st", "tf_control.st", "tf_words.st", "tf_checks.st", "tf_mailbox.st")
RESERVED = (
    "STEP INITIAL_STEP TRANSITION ACTION FROM TO ON PROGRAM TASK RESOURCE PRIORITY AT EN ENO TYPE RETURN EXIT BY OF"
)
EVERYTHING = "\n".join(CODE.values())
CONSTANTS = {
    name: int(value.replace("16#", "0x"), 0)
    for name, value in re.findall(r"\bTF_(\w+)\s*:\s*(?:INT|WORD|DWORD)\s*:=\s*([\w#]+);", CODE["tf_constants.st"])
}


def test_every_address_is_that_of_the_codec() -> None:
    plain = {name: value for name, value in CONSTANTS.items() if name in registers.ADDRESS}
    assert plain == registers.ADDRESS


@pytest.mark.parametrize(
    ("prefix", "kind"),
    [
        ("CMD", registers.Command),
        ("KIND", registers.Kind),
        ("ERR", registers.RefusalCode),
        ("BIT", registers.StatusBit),
        ("AXIS", registers.AxisBit),
        ("SWITCH", registers.SwitchBit),
        ("FLAG", registers.TableFlag),
    ],
)
def test_every_code_and_bit_is_that_of_the_codec(prefix: str, kind: type[IntEnum] | type[IntFlag]) -> None:
    wanted = {f"{prefix}_{one.name}": int(one) for one in kind}
    if prefix == "FLAG":
        wanted["FLAG_NOT_EXPRESSIBLE"] = registers.NOT_EXPRESSIBLE
    others = {name: value for name, value in CONSTANTS.items() if name.startswith(prefix + "_")}
    assert {name: value for name, value in others.items() if name not in registers.ADDRESS} == wanted


def test_the_fixed_words_are_those_of_the_codec() -> None:
    assert CONSTANTS["MAGIC_WORD"] == registers.MAGIC
    assert CONSTANTS["VERSION_WORD"] == registers.MAP_VERSION
    assert CONSTANTS["ORDER_DWORD"] == registers.ORDER_TEST
    assert CONSTANTS["CHUNK_POINTS"] == registers.CHUNK_POINTS
    assert CONSTANTS["LAST_REGISTER"] == registers.ADDRESS["BACKLASH_FACTOR"] + 1 == sum(registers.PICTURE_SPAN) - 1
    assert CONSTANTS["ENTRY_WORDS"] == registers.ENTRY_REGISTERS
    assert CONSTANTS["MOST_ENTRIES"] == registers.MOST_ENTRIES
    assert CONSTANTS["RELEASE_SECONDS"] == registers.MOST_RELEASE_S


def test_every_name_that_is_used_is_declared() -> None:
    declared = {f"TF_{name}" for name in CONSTANTS}
    declared |= set(re.findall(r"(?:FUNCTION_BLOCK|FUNCTION|TYPE)\s+(TF_\w+)", EVERYTHING))
    declared |= set(re.findall(r"^\s+(TF_\w+),?\s*$", CODE["tf_control.st"], flags=re.MULTILINE))
    declared |= set(re.findall(r"(TF_\w+)\s*:\s*TIME", EVERYTHING))
    assert not set(re.findall(r"\bTF_\w+", EVERYTHING)) - declared


def test_every_address_command_and_code_has_its_place_in_the_program() -> None:
    program = "\n".join(text for name, text in CODE.items() if name != "tf_constants.st")
    # Registers of the header are reached by counting from COMMAND; some words are the plant's to fill in.
    counted = {name for name, address in registers.ADDRESS.items() if 17 < address < 34}
    plants = {name for name in CONSTANTS if name.startswith(("AXIS_", "FLAG_"))} - {
        "AXIS_FLAGS",
        "AXIS_NAME",
        "AXIS_COUNT",
        "AXIS_MAP",
    }
    numbers = {"CMD_DISABLE", "CMD_CHUNK", "KIND_BACKLASH"}
    unused = [name for name in CONSTANTS if not re.search(rf"\bTF_{name}\b", program)]
    assert set(unused) <= counted | plants | numbers


def test_blocks_are_closed() -> None:
    words = ("IF", "CASE", "FOR", "WHILE", "VAR", "FUNCTION", "FUNCTION_BLOCK", "STRUCT", "TYPE")
    assert [f"{name}: {word}" for name, text in CODE.items() for word in words if not _closed(text, word)] == []


def _closed(text: str, word: str) -> bool:
    tail = r"\b" if word != "VAR" else r"(?:_GLOBAL|_INPUT|_IN_OUT|_OUTPUT)?\b"
    opened = len(re.findall(rf"(?<![\w_]){word}{tail}", text))
    return opened == len(re.findall(rf"\bEND_{word}\b", text))


def test_it_keeps_to_the_standard() -> None:
    """As a strict compiler asks: structures ended, named types where arrays are handed over, no constants of a file."""
    assert set(ORDER) == set(CODE)
    assert not re.findall(r"END_STRUCT(?!;)", EVERYTHING)
    assert "VAR_GLOBAL" not in EVERYTHING
    for block in re.findall(r"VAR_(?:INPUT|IN_OUT|OUTPUT)\b(.*?)END_VAR", EVERYTHING, flags=re.DOTALL):
        assert "ARRAY" not in block
    names = set(re.findall(r"^\s+(\w+)\s*:\s*\w", EVERYTHING, flags=re.MULTILINE))
    assert not {name.upper() for name in names} & set(RESERVED.split())


def test_nothing_is_used_before_it_is_there() -> None:
    whole = "\n".join(CODE[name] for name in ORDER)
    for kind in ("FUNCTION", "TYPE"):
        for name in re.findall(rf"^{kind}\s+(TF_\w+)", whole, flags=re.MULTILINE):
            assert (
                re.search(rf"\b{name}\b", whole[: re.search(rf"^{kind}\s+{name}\b", whole, re.MULTILINE).start()])
                is None
            )  # type: ignore[union-attr]


def test_every_constant_of_a_block_is_that_of_the_list() -> None:
    blocks = {name: text for name, text in CODE.items() if name != "tf_constants.st"}
    found = re.findall(r"\bTF_(\w+)\s*:\s*(?:INT|WORD|DWORD)\s*:=\s*([\w#]+);", "\n".join(blocks.values()))
    assert len(found) > 80
    assert [name for name, value in found if CONSTANTS[name] != int(value.replace("16#", "0x"), 0)] == []
    for text in blocks.values():
        for part in re.split(r"^(?=FUNCTION)", text, flags=re.MULTILINE)[1:]:
            body = part[part.rindex("END_VAR") :]
            used = {name for name in re.findall(r"\bTF_(\w+)", body) if name in CONSTANTS}
            assert used == {name for name, _ in re.findall(r"\bTF_(\w+)\s*:\s*(INT|WORD|DWORD)\s*:=", part)}


def test_a_refused_table_is_not_shown_under_the_old_selection() -> None:
    """The picture is taken over only from a job for the very table that is selected."""
    shown = CODE["tf_mailbox.st"].partition("R[TF_SELECTED_KIND]")[0].rpartition("IF JobDone")[2]
    for pair in ("Job.TableKind = SelKind", "Job.Index = SelIndex", "Job.Encoder = SelEncoder", "Job.Axis = SelAxis"):
        assert pair in shown


def test_every_variable_of_the_mailbox_is_used() -> None:
    block = CODE["tf_mailbox.st"]
    head, _, body = block.rpartition("END_VAR")
    names = re.findall(r"^\s+(\w+)\s*:\s*\w", head, flags=re.MULTILINE)
    assert len(names) > 30
    assert not [name for name in names if not re.search(rf"\b{name}\b", body)]


def test_the_document_names_every_register() -> None:
    document = (FOLDER.parent / "plc-mailbox-reference.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+)(?:-(\d+))?(?: \w+, (\d+)-(\d+) STEP.*)? ", document, flags=re.MULTILINE)
    firsts = {int(first) for first, *_ in rows}
    listed = document.split("## 2. Registers")[1].split("## 3.")[0]
    for name, address in registers.ADDRESS.items():
        assert address in firsts or re.search(rf"\b{address}\b", listed), name
