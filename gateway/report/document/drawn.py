"""The words of a drawing in the document's language: whole phrases of its texts, by the same catalogue."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping

from gateway.report.document.words import catalogue_of

MARK = "drawn_"
DRAWN_IN = "en"
_TEXT = re.compile(r"(<text\b[^>]*>)([^<]+)(?=</text>)")


def in_language(svg: str, language: str) -> str:
    """A drawing, whose words are drawn in English, with its words in another language; numbers and names stay."""
    if language == DRAWN_IN:
        return svg
    phrases, known = _phrases(language)
    return _TEXT.sub(lambda text: text[1] + phrases.sub(lambda found: known[found[0]], text[2]), svg)


@functools.cache
def _phrases(language: str) -> tuple[re.Pattern[str], Mapping[str, str]]:
    """What matches any phrase of the drawings, the longest first, and each one's words in the language."""
    own, other = catalogue_of(DRAWN_IN), catalogue_of(language)
    known = {text: other[key] for key, text in own.items() if key.startswith(MARK)}
    longest = sorted(known, key=len, reverse=True)
    return re.compile(rf"(?<!\w)(?:{'|'.join(map(re.escape, longest))})(?!\w)"), known
