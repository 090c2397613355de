"""Word lists that find an English sentence in a German or Chinese text; names, codes and quotations do not count."""

from __future__ import annotations

import re
from collections.abc import Iterable

_FUNCTION = """
the of and is are has have had been were its it they them their which that this these those from by for with
without not no nothing nobody none than then there here who whose where when while until before after because
cannot must should would could can may will does did do be but only each every other another some any all both
more most less least own between beyond through about into onto off on to at as or if so such one two
"""
FUNCTION = frozenset(_FUNCTION.split())
"""Words that hold an English sentence together."""
_GERMAN = "an also am die war was in so will man bin not all alle art hat rest on off do"
GERMAN = frozenset(_GERMAN.split())
"""Those of them that are German words, names of switches or units too."""
NO_SENTENCE = re.compile(
    r"`[^`]*`|[„“\"'‘’][^„“\"'‘’]*[“”\"'‘’]|https?://\S+|\S*[/\\]\S*|\b[ENPRSW]-[A-Z0-9-]+|\S*_\S*|\{[^}]*\}|--[a-z-]+"
    r"|\bISO \S+|\bON\b|\bOFF\b"
)
"""Code, quotations, addresses and paths, codes, keys, fields, options."""
WORD = re.compile(r"(?<!\w)[A-Za-zÄÖÜäöüß']+(?!\w)")


def english_words(text: str, language: str) -> list[str]:
    """The English function words of a text in another language, in their order."""
    tongue = FUNCTION - GERMAN if language == "de" else FUNCTION
    return [word for word in WORD.findall(NO_SENTENCE.sub(" ", text)) if word.lower() in tongue and not word.isupper()]


def english_sentences(texts: Iterable[str], language: str, least: int = 2) -> list[str]:
    """The texts in which so many English function words stand that they are an English sentence."""
    return [text for text in texts if len(english_words(text, language)) >= least]
