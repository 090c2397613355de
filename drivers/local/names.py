"""What may be a name, and how text from outside is shown: one rule for files, commands and wires; pure."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Iterable
from difflib import get_close_matches

from drivers.errors import words

MOST = 60
MOST_OF_FILE = 120
PATTERN = r"^[A-Za-z0-9](?:[A-Za-z0-9_.+ -]*[A-Za-z0-9_+-])?$"
_NAME = re.compile(PATTERN[1:-1])
# Names that Windows takes for devices, whatever stands behind a point.
_DEVICES = re.compile(r"(?:con|prn|aux|nul|conin\$|conout\$|com[0-9]|lpt[0-9])(?:[ .].*)?", re.IGNORECASE)
_OTHER = re.compile(r"[^A-Za-z0-9_-]")
_HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
_MOST_SHOWN = 80


def is_name(text: str, most: int = MOST) -> bool:
    """Whether a text may be a name, and so a part of a file's name on every system.

    ASCII letters, digits and ``_ - + .``, blanks inside; it begins with a letter or digit and ends with no point.
    """
    return len(text) <= most and _NAME.fullmatch(text) is not None and _DEVICES.fullmatch(text) is None


def person_key(name: str) -> str:
    """What two spellings of one person's name have in common: compatible letters, no case, single blanks."""
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


def allowed(most: int = MOST) -> str:
    """What `is_name` allows, in words."""
    return words("W-NAME-ALLOWED", most=most)


def is_file_name(text: str) -> bool:
    """Whether a text may be a whole file name: a name without blanks, longer than a name may be."""
    return is_name(text, MOST_OF_FILE) and " " not in text


def stem(text: str, *, unique: bool = False) -> str:
    """A part of a file name made of any text, of a serial number from a wire too; "_" for none.

    Two texts may give the same stem; ``unique`` adds a part of the text's hash where the stem is not the text.
    """
    safe = _OTHER.sub("_", text)[:MOST] or "_"
    if _DEVICES.fullmatch(safe):
        safe = f"_{safe}"
    return safe if safe == text or not unique else f"{safe}-{_digest(text)}"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:8]


def is_hidden(letter: str) -> bool:
    """Whether a letter is a control, direction, line or broken one: nothing that a reader would see."""
    return unicodedata.category(letter) in _HIDDEN


def visible(text: str, keep: str = "\n\t") -> str:
    r"""Text for a terminal: what steers one or turns its writing direction is shown as ``\x1b``, ``\u202e``."""
    return "".join(letter if letter in keep or not is_hidden(letter) else _escaped(ord(letter)) for letter in text)


def _escaped(number: int) -> str:
    return f"\\x{number:02x}" if number < 0x100 else f"\\u{number:04x}" if number < 0x10000 else f"\\U{number:08x}"


def shown(value: object) -> str:
    """A value for an error's text: one line, nothing hidden, not long."""
    text = visible(str(value), keep="")
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."


def guess(text: str, known: Iterable[str]) -> str:
    """The words "; did you mean NAME?" where one of the known words is close to a mistyped one, else nothing."""
    close = closest(text, known)
    return words("W-CFG-GUESS", word=close) if close else ""


def closest(text: str, known: Iterable[str]) -> str:
    """The known word that a mistyped one was probably to be, whatever its upper and lower case; "" for none."""
    lower = {word.lower(): word for word in known}
    found = get_close_matches(text.lower(), list(lower), n=1, cutoff=0.6 if len(text) > 3 else 0.5)
    return lower[found[0]] if found else ""
