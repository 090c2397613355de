"""The structured text of docs/plc before two parsers nobody here wrote: blark, and the grammar of tree-sitter.

blark takes more than the standard has; tree-sitter's grammar is of the standard's third edition and without a dialect.
Both read syntax alone: reserved words, types, order and ranges are judged by `tests/unit/mailbox/structured.py`.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.interop.peers import needed

pytestmark = pytest.mark.interop
FILES = sorted((Path(__file__).parents[2] / "docs" / "plc").glob("*.st"))
SOUND = """TYPE TF_S : STRUCT
    A : INT;
END_STRUCT;
END_TYPE

FUNCTION TF_F : INT
VAR_INPUT
    A : INT;
END_VAR
VAR
    I : INT;
END_VAR
    FOR I := 0 TO 7 DO
        IF (A > 3) AND (I < 2) THEN
            TF_F := A;
        END_IF;
    END_FOR;
END_FUNCTION
"""
BROKEN = {
    "a structure is not ended": ("END_STRUCT;", "END_STRUCT"),
    "IF without THEN": (" THEN", ""),
    "IF is not ended": ("        END_IF;\n", ""),
    "a statement is not ended": ("TF_F := A;", "TF_F := A"),
    "an assignment as in BASIC": ("TF_F := A", "TF_F = A"),
    "a comparison as in C": ("(A > 3)", "(A == 3)"),
    "FOR without DO": (" DO", ""),
    "variables are not ended": ("END_VAR\nVAR\n", "VAR\n"),
    "brackets differ": ("(A > 3)", "{A > 3)"),
    "the function is not ended": ("END_FUNCTION", ""),
    "ELSEIF": ("        END_IF;", "        ELSEIF A > 2 THEN\n        END_IF;"),
}
LENIENT = {"blark": {"a structure is not ended"}, "tree-sitter": set[str]()}


def by_blark(text: str) -> str:
    """What is wrong with a text, "" for nothing."""
    needed(importlib.util.find_spec("blark") is not None, "blark")
    result: Any = importlib.import_module("blark.parse").parse_source_code(text)
    return "" if result.exception is None else str(result.exception) or type(result.exception).__name__


def by_tree_sitter(text: str) -> str:
    """What is wrong with a text, "" for nothing."""
    needed(importlib.util.find_spec("tree_sitter_iec61131_3_st") is not None, "tree-sitter-iec61131-3-st")
    library: Any = importlib.import_module("tree_sitter")
    grammar: Any = importlib.import_module("tree_sitter_iec61131_3_st")
    root = library.Parser(library.Language(grammar.language())).parse(text.encode("utf-8")).root_node
    places = list(faults(root))
    assert bool(places) == root.has_error
    return ", ".join(places)


def faults(node: Any) -> list[str]:
    """Lines that the grammar does not know."""
    own = [f"line {node.start_point[0] + 1}: {node.type}"] if node.is_error or node.is_missing else []
    return own + [one for child in node.children for one in faults(child)]


PARSERS: dict[str, Callable[[str], str]] = {"blark": by_blark, "tree-sitter": by_tree_sitter}


@pytest.mark.parametrize("parser", PARSERS)
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_file_is_read(path: Path, parser: str) -> None:
    assert PARSERS[parser](path.read_text(encoding="utf-8")) == ""


@pytest.mark.parametrize("parser", PARSERS)
def test_the_parser_refuses_what_is_wrong(parser: str) -> None:
    assert PARSERS[parser](SOUND) == ""
    taken = {name for name, (right, wrong) in BROKEN.items() if not PARSERS[parser](SOUND.replace(right, wrong))}
    assert taken == LENIENT[parser]
