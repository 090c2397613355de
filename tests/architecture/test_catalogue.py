"""Every code that the source uses stands in the catalogue, and its text asks only for fields that are given."""

from __future__ import annotations

import ast
import re
import string
import tomllib
from pathlib import Path

from drivers.errors import TrueflankError, catalogue, text_of
from drivers.terms import PREFIX, Terms, filled
from tests.architecture.sources import nodes

ROOT = Path(__file__).parents[2]
CODE = re.compile(r"^[EPW]-[A-Z0-9]+(-[A-Z0-9]+)+$")
OWN_ARGUMENTS = {"retryable", "where"}


def _uses() -> list[tuple[str, str, set[str], bool]]:
    found = []
    for package in ("gateway", "drivers", "simulators", "trueflank"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in nodes(path, ast.Call):
                if not node.args or _callee(node).startswith("_"):
                    continue  # a private function passes the code on with its own fields
                first = node.args[0]
                if isinstance(first, ast.Constant) and isinstance(first.value, str) and CODE.match(first.value):
                    names = {keyword.arg for keyword in node.keywords if keyword.arg} - OWN_ARGUMENTS
                    star = any(keyword.arg is None for keyword in node.keywords) or _callee(node) == "Message"
                    place = f"{path.relative_to(ROOT)}:{node.lineno}"
                    found.append((place, first.value, names, star))
    return found


def _callee(node: ast.Call) -> str:
    return node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")


def _placeholders(text: str) -> set[str]:
    names = {name.split(".")[0].split("[")[0] for _, name, _, _ in string.Formatter().parse(text) if name}
    return {name for name in names if not name.startswith(PREFIX)}


def test_every_code_in_the_source_has_a_text_whose_fields_are_given() -> None:
    problems = []
    for place, code, names, star in _uses():
        entry = catalogue().get(code)
        if entry is None:
            problems.append(f"{place}: {code} is not in the catalogue")
            continue
        missing = (_placeholders(entry["what"]) | _placeholders(entry["do"])) - names
        if missing and not star:
            problems.append(f"{place}: {code} lacks the fields {sorted(missing)}")
    assert not problems, "\n".join(problems)


def test_a_text_read_alone_is_the_text_of_the_whole_catalogue() -> None:
    for language in ("en", "de", "zh"):
        whole = catalogue(language)
        assert {code: text_of(code, language) for code in whole} == whole
    assert text_of("E-NOBODY-SAYS-THIS") is None


def test_the_files_of_all_languages_hold_the_same_codes() -> None:
    """A translator finds each text in the file of the same name; empty advice is left out."""
    folder = ROOT / "drivers" / "messages"
    for english in sorted((folder / "en").glob("*.toml")):
        codes = list(tomllib.loads(english.read_text(encoding="utf-8")))
        for language in ("de", "zh"):
            text = (folder / language / english.name).read_text(encoding="utf-8")
            assert list(tomllib.loads(text)) == codes, f"{language}/{english.name}"
            assert 'do = ""' not in text
    names = {one.name for one in (folder / "en").glob("*.toml")}
    assert all({one.name for one in (folder / language).glob("*.toml")} == names for language in ("de", "zh"))


def test_every_text_is_used_and_says_what_to_do() -> None:
    quoted = re.compile(r'"([A-Z]-[A-Z0-9-]+)"')
    used = {
        code
        for package in ("gateway", "drivers", "simulators", "trueflank")
        for path in (ROOT / package).rglob("*.py")
        for code in quoted.findall(path.read_text(encoding="utf-8"))
    }
    unused = [code for code in catalogue() if code not in used]
    silent = [code for code, entry in catalogue().items() if code.startswith("E-") and not entry["do"].strip()]
    assert not unused
    assert not silent


def test_every_text_renders_without_its_fields() -> None:
    texts = {code: _rendered(code) for code in sorted(catalogue())}
    wrong = [f"{code}: {text}" for code, text in texts.items() if code not in text or "somewhere" not in text]
    assert not wrong, "\n".join(wrong)


def _rendered(code: str) -> str:
    """The text as a person reads it, or what rendering it raised."""
    try:
        return str(TrueflankError(code, "somewhere"))
    except Exception as error:  # noqa: BLE001 - whatever it is, the other codes are told too
        return f"raised {error!r}"


def test_every_term_that_a_text_asks_for_is_one_a_driver_brings() -> None:
    asked = {
        name
        for entry in catalogue().values()
        for text in entry.values()
        for _, name, _, _ in string.Formatter().parse(text)
        if name and name.startswith(PREFIX)
    }
    assert len(asked) > 5
    assert [name for name in sorted(asked) if filled(name) is None] == []
    assert all(isinstance(getattr(Terms(), name.removeprefix(PREFIX)), str) for name in asked)


DRIVERS_OWN = ("attocube", "bridge", "gauge", "legality", "linuxcnc", "mailbox", "manual", "replay", "sinumerik", "umd")
"""Catalogues of concrete drivers: what they mean crosses the port as an exception class or a record."""


def _driver_codes() -> set[str]:
    folder = ROOT / "drivers" / "messages" / "en"
    return {code for name in DRIVERS_OWN for code in tomllib.loads((folder / f"{name}.toml").read_text("utf-8"))}


def test_the_gateway_names_no_code_of_a_concrete_driver() -> None:
    codes = _driver_codes()
    assert len(codes) > 200
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno} {node.value}"
        for path in sorted((ROOT / "gateway").rglob("*.py"))
        for node in nodes(path, ast.Constant)
        if node.value in codes
    ]
    assert found == []


def test_no_code_stands_twice_in_one_language() -> None:
    for language in ("en", "de", "zh"):
        found = [
            code
            for path in sorted((ROOT / "drivers" / "messages" / language).glob("*.toml"))
            for code in tomllib.loads(path.read_text(encoding="utf-8"))
        ]
        assert sorted(found) == sorted(set(found)), language


def test_no_text_leaves_it_to_the_reader_whether_it_is_one_or_many() -> None:
    halves = re.compile(r"\w\((?:s|es|e|n|en|er|ten)\)")
    found = [
        f"{language} {code}: {text}"
        for language in ("en", "de", "zh")
        for code, entry in catalogue(language).items()
        for text in entry.values()
        if halves.search(text)
    ]
    assert found == []
