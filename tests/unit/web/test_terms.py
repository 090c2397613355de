"""One word for one thing: the glossary's terms in each language, in every text that people are shown."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

MESSAGES = Path(__file__).parents[3] / "drivers" / "messages"

# The English term, and what each of its texts must hold in German and in Chinese. Words of another language for the
# same thing stand beside it: no text may have them.
TERMS = {
    r"set-up values?": ("Einstellwert", "调整值"),
    r"set-ups?(?! value)": ("Aufbau", "安装"),
    r"site files?": ("Anlagendatei", "站点文件"),
    r"cross tables?": ("Kreuztabelle", "交叉表"),
    r"gear file": ("Zahnraddatei", "齿轮文件"),
    r"audit log": ("Prüfprotokoll", "审计日志"),
    r"service engineer": ("Service", "服务工程师"),
    r"proposal": ("Vorschl", "方案|建议"),
    r"uncertainty": ("nsicherheit", "不确定度"),
    r"squareness": ("echtwinklig", "垂直度"),
    r"roll back": ("urücknehmen", "回退"),
}
STRANGE = {
    "de": r"Einrichtwert|Rüstwert|Standortdatei",
    "zh": r"装夹值|设置值|现场文件|交叉补偿表",
}


def _flat(tree: dict[str, Any], at: str) -> Iterator[tuple[str, str]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{at}{key}.")
        elif isinstance(value, str):
            yield at + key, value


def _texts(language: str) -> dict[str, str]:
    folders = (("", path) for path in (MESSAGES / language).glob("*.toml"))
    others = ((f"{room}:", MESSAGES / room / f"{language}.toml") for room in ("page", "document", "panel"))
    return {
        place: text
        for room, path in (*folders, *others)
        for place, text in _flat(tomllib.loads(path.read_text(encoding="utf-8")), room)
    }


@pytest.mark.parametrize(("number", "language"), [(0, "de"), (1, "zh")])
def test_a_term_has_one_word_in_each_language(number: int, language: str) -> None:
    english, own = _texts("en"), _texts(language)
    held = {term: re.compile(rf"(?<![\w-]){term}(?![\w-])", re.IGNORECASE) for term in TERMS}
    named = {
        term: [place for place, text in english.items() if held[term].search(re.sub("`[^`]*`", "", text))]
        for term in TERMS
    }
    assert [term for term, places in named.items() if not places] == []
    lacking = [
        f"{term}: {place}"
        for term, places in named.items()
        for place in places
        if not re.search(TERMS[term][number], own[place])
    ]
    assert lacking == []


@pytest.mark.parametrize("language", sorted(STRANGE))
def test_no_text_has_another_word_for_a_term(language: str) -> None:
    assert [place for place, text in _texts(language).items() if re.search(STRANGE[language], text)] == []
