"""Sentences stand in the catalogue, where each language has its own: what is left in the source, by package.

A sentence is a text of three words in small letters or more, with blanks between them and a word that holds English
together. Excepted are comments of NC programs and of files for a control, which a control shows to an engineer; what
click and pydantic print as help; messages of `TypeError`, `ValueError` and other errors in the use of a function, and
what `repr` shows; names of tasks and context variables; what a log of a library gets; the texts of checks that
developers run; the help of metrics, which is English by convention; pages of the handbook that code writes; the words,
in many languages, by which files of other programs are understood; and pieces of program text.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Container, Iterator
from pathlib import Path

from tests.english import FUNCTION

ROOT = Path(__file__).parents[2]
HELP = {"help", "description", "epilog", "short_help", "metavar"}
OF_USE = {
    "TypeError", "ValueError", "NotImplementedError", "AssertionError", "KeyError", "RuntimeError", "BadParameter",
    "Field", "Option", "Argument", "getLogger", "debug", "info", "warning", "exception",
    "AttributeError", "EOFError", "ConnectionResetError", "SerialException", "ContextVar", "supervise_task",
    "section_comment",
}  # fmt: skip
EXCEPTED = {
    "drivers/sinumerik/ncprogram": "comments of NC programs",
    "drivers/linuxcnc/program.py": "comments of NC programs",
    "drivers/linuxcnc/agent": "runs on the control's own computer, without a catalogue",
    "drivers/clock/shared.py": "what processes of a simulation tell each other's developer",
    "drivers/sinumerik/opcua/conformance": "answers kept in a recorded session, which a later one is compared with",
    "drivers/contract.py": "checks that an author of a driver runs",
    "gateway/acceptance/pytest_plugin.py": "help of pytest",
    "gateway/web/metrics.py": "help of metrics",
    "gateway/config/reference.py": "a page of the handbook",
    "drivers/sinumerik/opcua/rights.py": "a page of the handbook",
    "drivers/files/numbers.py": "words of files of others",
    "drivers/files/tables/headwords.py": "words of files of others",
    "drivers/files/tables/statements.py": "words of files of others",
    "gateway/workflow/files/headers.py": "words of files of others",
    "gateway/workflow/files/statements.py": "words of files of others",
}
LEFT = {"gateway/study": 96}
"""The most that may be left, by package: labels in the figures of the study. These numbers only fall."""
NO_SENTENCE = re.compile(r'\\[swdbW]|\(\?|\[\^|\{%|</?\w+>|^--|SELECT |^\s*[#;]|^"""|^\[Unit\]|color\(')
WORD = re.compile(r"[A-Za-z][A-Za-z'-]*")


def is_sentence(text: object) -> bool:
    """Whether a constant is an English sentence, or a part of one."""
    if not isinstance(text, str) or not re.search(r"\S\s+\S", text) or NO_SENTENCE.search(text):
        return False
    small = [word for word in WORD.findall(text) if word.islower()]
    return len(small) >= 3 and any(word in FUNCTION for word in small)


def kinds(tree: ast.AST) -> Iterator[object]:
    """The values of its Literal types: kinds in records and data, each with a text of its own where it is shown."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id == "Literal":
            yield from (one.value for one in ast.walk(node.slice) if isinstance(one, ast.Constant))


def sentences(tree: ast.AST, apart: Container[object] = ()) -> Iterator[str]:
    """The sentences of a module that are no docstrings and not excepted."""
    aside: set[int] = set()
    for node in ast.walk(tree):
        aside |= {id(one) for part in _aside(node) for one in ast.walk(part)}
    for node in ast.walk(tree):
        if id(node) in aside:
            continue
        if isinstance(node, ast.JoinedStr):
            text = "".join(one.value if isinstance(one, ast.Constant) else "{}" for one in node.values)
            aside |= {id(one) for one in ast.walk(node)}
        elif isinstance(node, ast.Constant):
            text = node.value
        else:
            continue
        if is_sentence(text) and text not in apart:
            yield text


def _aside(node: ast.AST) -> Iterator[ast.AST]:
    """Parts of a node that are read by no user of the program."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        yield node.value
    if isinstance(node, ast.FunctionDef) and (node.name == "__repr__" or node.name.endswith("in_markdown")):
        yield from node.body
    if isinstance(node, ast.Assign) and any(
        isinstance(one, ast.Name) and ("COMMENT" in one.id.upper() or "DESCRIPTION" in one.id) for one in node.targets
    ):
        yield node.value
    if isinstance(node, ast.keyword) and node.arg in HELP:
        yield node.value
    if isinstance(node, ast.Assert) and node.msg is not None:
        yield node.msg
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id == "sources":
        yield node  # for the page of settings in the handbook
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "split":
        yield node.func.value  # a list of words
    if isinstance(node, ast.Call):
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        yield from node.args if name in OF_USE else ()


def _found() -> Counter[str]:
    found: Counter[str] = Counter()
    trees = {
        path.relative_to(ROOT).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for top in ("gateway", "drivers", "trueflank")
        for path in sorted((ROOT / top).rglob("*.py"))
    }
    apart = {one for tree in trees.values() for one in kinds(tree)}
    for place, tree in trees.items():
        if not place.startswith(tuple(EXCEPTED)):
            package = "/".join(place.split("/")[:2])
            found[package] += sum(1 for _ in sentences(tree, apart))
    return +found


def test_the_sentences_outside_the_catalogue_only_fall() -> None:
    found = _found()
    assert all(count <= LEFT.get(package, 0) for package, count in found.items()), dict(found)


def test_a_sentence_is_found_and_a_key_is_none() -> None:
    module = (
        'def f(x):\n    """Says what it is of."""\n    say(f"{x} is not a number of the file", help="what it is for")'
    )
    assert list(sentences(ast.parse(module))) == ["{} is not a number of the file"]
    assert not is_sentence("X1 EEC")
    assert not is_sentence("deviation um")
