"""uMD counter lines: bytes <-> blocks of integers, pure, in either role.

A line holds 8 or 16 decimal integers separated by one space and ends with CR LF; nothing is ever written to the
counter. Thousands of lines are read at once: eight digits are joined to a number inside a 64 bit word, neighbours first
(tens and units, then hundreds, then ten thousands), so no digit costs a step of Python. The grammar is exact: a line
with anything else gives no value.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LocalProtocolError
from drivers.message import Message

# Lines of decimal integers, thousands at a time, to arrays: exact grammar, no value from anything else, pure.
#
# Eight digits are turned into a number at once inside a 64 bit word: neighbours are joined to pairs, pairs to fours,
# fours to eights, each by one multiplication. Longer numbers take a second word for their front digits.

IntArray = NDArray[np.int64]
Places = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
WordArray = NDArray[np.uint64]

LONGEST = 18
WORD = 8
NARROW = 1 << 32
# Lines worked on together: memory stays bounded however much came at once.
AT_ONCE = 16384
_ZEROS = np.uint64(0x3030303030303030)
_SIXES = np.uint64(0x0606060606060606)
_HIGH = np.uint64(0xF0F0F0F0F0F0F0F0)
_MINUS = np.uint64(ord("-") ^ ord("0"))
_BYTE = np.uint64(0xFF)
_JOINS = (
    (np.uint64(10 * 256 + 1), np.uint64(8), np.uint64(0x00FF00FF00FF00FF)),
    (np.uint64(100 * 65536 + 1), np.uint64(16), np.uint64(0x0000FFFF0000FFFF)),
    (np.uint64(10000 * (1 << 32) + 1), np.uint64(32), None),
)


class _Text:
    """Bytes with room in front, seen as single bytes and as the eight bytes from each place on."""

    def __init__(self, text: bytes) -> None:
        padded = b" " * (2 * WORD) + text
        self.bytes = np.frombuffer(padded, np.uint8)
        self.words: WordArray = np.ndarray((len(padded) - WORD + 1,), "<u8", padded, 0, (1,))


@dataclass(frozen=True, slots=True, eq=False)
class Salvaged:
    """``rows`` (n, width) of the good lines; ``strangers`` the others: how many good ones came before, and bytes."""

    rows: IntArray
    strangers: tuple[tuple[int, bytes], ...]


def read_table(text: bytes, width: int, wide: int) -> IntArray | None:
    """Lines that all end in LF, or all in CR LF, to shape (n, width), columns contiguous.

    None unless every line holds ``width`` integers with one space between them, each of 1 to 18 digits, a minus
    in front of negative ones, no leading zeros and no other byte anywhere; only column ``wide`` may go beyond
    +-(2**32 - 1).
    """
    seen = _Text(text)
    breaks = np.flatnonzero(seen.bytes <= ord(" "))[2 * WORD :]
    per_line = width + text.endswith(b"\r\n")
    if not len(breaks) or len(breaks) % per_line:
        return None
    ends = np.ascontiguousarray(breaks.reshape(-1, per_line).T)
    if not _separated(seen, ends, width):
        return None
    starts = np.concatenate((np.array([2 * WORD]), ends[-1, :-1] + 1))
    table, bad = _read_lines(seen, starts, ends[:width], wide)
    return None if bad.any() else table


def salvage(text: bytes, width: int, wide: int) -> Salvaged:
    """What of these lines, each ended by LF and no other line end, is good by the rules of `read_table`."""
    seen = _Text(text)
    lasts = np.flatnonzero(seen.bytes == ord("\n"))
    firsts = np.concatenate((np.array([2 * WORD]), lasts[:-1] + 1))
    breaks = np.flatnonzero(seen.bytes <= ord(" "))[2 * WORD :]
    counts = np.diff(np.searchsorted(breaks, lasts, side="right"), prepend=0)
    good = counts == width
    ends = np.ascontiguousarray(breaks[np.repeat(good, counts)].reshape(-1, width).T)
    kept = (seen.bytes.take(ends[:-1]) == ord(" ")).all(axis=0)
    good[np.flatnonzero(good)[~kept]] = False
    table, bad = _read_lines(seen, firsts[good], ends[:, kept], wide)
    good[np.flatnonzero(good)[bad]] = False
    before = np.cumsum(good)
    cut = 2 * WORD
    strangers = tuple(
        (int(before[at]), text[int(firsts[at]) - cut : int(lasts[at]) - cut]) for at in np.flatnonzero(~good)
    )
    # Columns stay contiguous: those who work on the rows take them column by column.
    return Salvaged(table.T[:, ~bad].T if bad.any() else table, strangers)


def _separated(seen: _Text, ends: Places, width: int) -> bool:
    """One space after each number but the last of a line, then LF or CR LF, the CR touching the LF."""
    kinds = seen.bytes.take(ends)
    line_end = (ord("\n"),) if len(ends) == width else (ord("\r"), ord("\n"))
    spaced = bool((kinds[: width - 1] == ord(" ")).all())
    ended = all(bool((kinds[width - 1 + at] == mark).all()) for at, mark in enumerate(line_end))
    return spaced and ended and (len(ends) == width or bool((ends[-1] - ends[-2] == 1).all()))


def _read_lines(seen: _Text, firsts: Places, ends: Places, wide: int) -> tuple[IntArray, BoolArray]:
    """Values (n, width) of the tokens, ``firsts`` (n,) of each line, ``ends`` (width, n); and bad lines (n,)."""
    table, bad = np.empty(ends.shape, np.int64), np.zeros(ends.shape[1], np.bool_)
    for start in range(0, len(bad), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        _read_columns(seen, firsts[part], ends[:, part], wide, (table[:, part], bad[part]))
    return table.T, bad


def _read_columns(seen: _Text, firsts: Places, ends: Places, wide: int, into: tuple[IntArray, BoolArray]) -> None:
    """Columns of one digit, of up to eight bytes and of more are each read together."""
    table, bad = into
    starts = np.empty_like(ends)
    starts[0] = firsts
    np.add(ends[:-1], 1, out=starts[1:])
    lengths = ends - starts
    if int(lengths.min()) < 1:
        bad |= (lengths < 1).any(axis=0)
        np.maximum(lengths, 1, out=lengths)
    longest = lengths.max(axis=1)
    for columns, read in (
        (np.flatnonzero(longest == 1), _read_single),
        (np.flatnonzero((longest > 1) & (longest <= WORD)), _read_short),
        (np.flatnonzero(longest > WORD), _read_long),
    ):
        if len(columns):
            table[columns], wrong = read(seen, starts[columns], lengths[columns])
            bad |= wrong.any(axis=0)
    for column in np.flatnonzero(longest > 9):
        if column != wide:
            bad |= np.abs(table[column]) >= NARROW


def _read_single(seen: _Text, starts: Places, _lengths: Places) -> tuple[IntArray, BoolArray]:
    """One digit each, any shape; values and the bad ones."""
    values = seen.bytes.take(starts) - np.uint8(ord("0"))
    return values.astype(np.int64), values > 9


def _kept(words: WordArray, unused: WordArray) -> WordArray:
    """Digit values in the last bytes of each word, zero in the ``unused`` bits before them; ``words`` is used up."""
    words ^= _ZEROS
    words >>= unused
    words <<= unused
    return words


def _odd(digits: WordArray) -> WordArray:
    """Not zero where a byte is no digit value."""
    odd = digits + _SIXES
    odd |= digits
    odd &= _HIGH
    return odd


def _join_digits(digits: WordArray) -> IntArray:
    """The numbers; ``digits`` is used up."""
    for factor, shift, mask in _JOINS:
        digits *= factor
        digits >>= shift
        if mask is not None:
            digits &= mask
    return digits.view(np.int64)


def _unused(lengths: Places) -> WordArray:
    """Bits of a word in front of so many bytes."""
    return (8 * WORD - 8 * lengths).view(np.uint64)


def _led_by_zero(digits: WordArray, unused: WordArray, lengths: Places) -> BoolArray:
    first = digits >> unused
    first &= _BYTE
    return (first == 0) & (lengths > 1)


def _read_short(seen: _Text, starts: Places, lengths: Places) -> tuple[IntArray, BoolArray]:
    """Numbers of at most eight bytes, sign included, in rows (k, n); values and the bad ones."""
    unused = _unused(lengths)
    digits = _kept(seen.words[starts + (lengths - WORD)], unused)
    strange = np.bitwise_or.reduce(_odd(digits), axis=1) != 0
    bad = _led_by_zero(digits, unused, lengths)
    values = _join_digits(digits)
    if strange.any():
        rows = np.flatnonzero(strange)
        values[rows], bad[rows] = _read_signed(seen, starts[rows], lengths[rows])
    return values, bad


def _read_signed(seen: _Text, starts: Places, lengths: Places) -> tuple[IntArray, BoolArray]:
    """The same where some are negative: "-05" and "-0" lead with a zero as "05" does, "0" does not."""
    negative = seen.bytes.take(starts) == ord("-")
    unused = _unused(np.maximum(lengths - negative, 1))
    digits = _kept(seen.words[starts + (lengths - WORD)], unused)
    bad = (_odd(digits) != 0) | _led_by_zero(digits, unused, lengths)
    values = _join_digits(digits)
    np.negative(values, out=values, where=negative)
    return values, bad


def _read_long(seen: _Text, starts: Places, lengths: Places) -> tuple[IntArray, BoolArray]:
    """Numbers of any length in rows (k, n), eight digits after eight from the last; values and the bad ones."""
    negative = seen.bytes.take(starts) == ord("-")
    ends, lengths = starts + lengths, lengths - negative
    zero = seen.bytes.take(np.minimum(starts + negative, ends)) == ord("0")
    bad = (lengths < 1) | (lengths > LONGEST) | (zero & ((lengths > 1) | negative))
    values = np.zeros(starts.shape, np.int64)
    scale = 1
    for taken in range(0, LONGEST, WORD):
        left = np.nonzero(lengths > taken)
        if not len(left[0]):
            break
        unused = _unused(np.minimum(lengths[left] - taken, WORD))
        at = ends[left] - taken - WORD
        # A third word may begin before the room in front of the text, and holds at most two digits.
        ahead = (8 * np.clip(-at, 0, WORD - 1)).astype(np.uint64)
        digits = _kept(seen.words[np.maximum(at, 0)] << ahead, unused)
        bad[left] |= _odd(digits) != 0
        values[left] += _join_digits(digits) * scale
        scale *= 10**WORD
    np.negative(values, out=values, where=negative)
    return values, bad


# Lines.

Role = Literal["client", "server"]

SEQUENCE, CODE, DATA = 5, 6, 7
DISPLACEMENT = (2, 9, 13)
VELOCITY = (3, 10, 14)
PHASE = (4, 11, 15)
WIDTHS = (8, 16)

NO_DATA, LASER_POWER, SIGNAL_STRENGTH = 0, 1, 2
AIR_TEMPERATURE, MATERIAL_TEMPERATURE, PRESSURE, HUMIDITY = 3, 4, 5, 6
SAMPLE_FREQUENCY, FIRMWARE, HOMODYNE = 8, 10, 20

LINE_BYTES = 4096
TEXT_CHARS = 200
_SWITCH_AFTER = 8
# Where more than one line in so many is a stranger, looking at each line costs no more than sorting them out.
_FEW = 8
_NUMBER = re.compile(rb"(?:0|-?[1-9][0-9]{0,17})\Z")
_BREAKS = re.compile(rb"[\r\n]+")


@dataclass(frozen=True, slots=True, eq=False)
class UmdLines:
    """What one piece of the stream held.

    ``rows`` shape (n, 8) or (n, 16), the lines' integers as sent. ``text`` banner and "!" debug lines.
    ``damaged`` counts lines that are none of these, ``damaged_bytes`` their length; they have no rows.
    """

    rows: IntArray = field(default_factory=lambda: np.empty((0, 8), np.int64))
    text: tuple[str, ...] = ()
    damaged: int = 0
    damaged_bytes: int = 0

    def __bool__(self) -> bool:
        return bool(len(self.rows) or self.text or self.damaged)


def encode_rows(rows: IntArray) -> bytes:
    """Rows (n, 8) or (n, 16) of integers to n lines. Raises LocalProtocolError (E-UMD-ROWS)."""
    if rows.ndim != 2 or rows.shape[1] not in WIDTHS or rows.dtype.kind not in "iu":
        raise LocalProtocolError("E-UMD-ROWS", "umd", why=f"shape {rows.shape} of {rows.dtype}")
    if rows.size and not _in_range(rows):
        raise LocalProtocolError("E-UMD-ROWS", "umd", why=Message.of("W-UMD-32-BITS"))
    if not len(rows):
        return b""
    # Most columns of a block hold one number: that is text for all its lines.
    varies = (rows != rows[0]).any(axis=0)
    line = b" ".join(b"%d" if more else b"%d" % one for more, one in zip(varies, rows[0].tolist(), strict=True))
    return ((line + b"\r\n") * len(rows)) % tuple(rows[:, varies].ravel().tolist())


def _in_range(rows: IntArray) -> bool:
    # The sequence number alone is 64 bits wide in the uMD2.
    least, most = rows.min(axis=0), rows.max(axis=0)
    least[SEQUENCE] = most[SEQUENCE] = 0
    return bool(most.max() < NARROW and least.min() > -NARROW)


def _parse_line(line: bytes) -> list[int] | None:
    tokens = line.split()
    if len(tokens) not in WIDTHS or not all(map(_NUMBER.match, tokens)):
        return None
    values = [int(token) for token in tokens]
    narrow = values[:SEQUENCE] + values[SEQUENCE + 1 :]
    return values if max(map(abs, narrow)) < NARROW else None


def _one_line_end(text: bytes) -> bytes:
    """The same lines, each ended by one LF, empty ones left out."""
    if b"\r" in text:
        # Taking the CR away is quick where each belongs to a LF; a mixture of line ends is rare.
        text = text.translate(None, b"\r") if text.count(b"\r") == text.count(b"\r\n") else _BREAKS.sub(b"\n", text)
    return _BREAKS.sub(b"\n", text).lstrip(b"\n") if b"\n\n" in text or text[:1] == b"\n" else text


def _joined(parts: list[IntArray]) -> IntArray:
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.empty((0, WIDTHS[0]), np.int64)


class _Collected:
    """Grows while one piece of the stream is read; a change of width ends one message and begins another."""

    def __init__(self) -> None:
        self.done: list[UmdLines] = []
        self._rows: list[IntArray] = []
        self._text: list[str] = []
        self._damaged = 0
        self._damaged_bytes = 0

    def add_rows(self, rows: IntArray) -> None:
        if self._rows and self._rows[0].shape[1] != rows.shape[1]:
            self.finish()
        self._rows.append(rows)

    def add_text(self, line: str) -> None:
        self._text.append(line)

    def spoil(self, length: int) -> None:
        self._damaged += 1
        self._damaged_bytes += length

    def finish(self) -> tuple[UmdLines, ...]:
        """Close the message that grows; all of them so far."""
        rows = _joined(self._rows)
        lines = UmdLines(rows, tuple(self._text), self._damaged, self._damaged_bytes)
        self._rows, self._text, self._damaged, self._damaged_bytes = [], [], 0, 0
        if lines:
            self.done.append(lines)
        return tuple(self.done)


class UmdCodec:
    """One end of a uMD line. Messages are `UmdLines`, whatever way the bytes were cut on the road.

    ``role`` "client" reads what a counter sends; "server" writes it. With ``join_late`` everything up to the
    first line end is thrown away uncounted, because a client comes in the middle of a line.
    """

    def __init__(self, role: Role, *, join_late: bool = False) -> None:
        self._role = role
        self._joining = join_late
        self._pending = b""
        self._cut_in_two = False
        self._overlong = 0
        self._width: int | None = None
        self._other_width = 0

    def send(self, message: UmdLines) -> bytes:
        """Text lines, then rows. Raises LocalProtocolError: E-UMD-ROLE for a client, E-UMD-ROWS."""
        if self._role != "server":
            raise LocalProtocolError("E-UMD-ROLE", "umd")
        text = b"".join(line.encode("ascii", "replace") + b"\r\n" for line in message.text)
        return text + encode_rows(message.rows)

    def receive(self, data: bytes) -> tuple[UmdLines, ...]:
        """Any bytes to what they complete; the rest of a line waits for the next call. Never raises."""
        if self._pending:
            data = b"".join((self._pending, data))
        cut = max(data.rfind(b"\n"), data.rfind(b"\r")) + 1
        whole, self._pending = self._mended(data[:cut]), data[cut:]
        found = _Collected()
        self._read(self._without_beginnings(whole, found), found)
        self._cap()
        return found.finish()

    def _mended(self, whole: bytes) -> bytes:
        """A CR LF that was cut in two belongs to the line before it."""
        if self._cut_in_two and whole[:1] == b"\n":
            whole = whole[1:]
        if not whole:
            return whole
        self._cut_in_two = whole.endswith(b"\r")
        return whole + b"\n" if self._cut_in_two else whole

    def _without_beginnings(self, whole: bytes, found: _Collected) -> bytes:
        """Cut off the end of an overlong line, or of the line in whose middle we came."""
        if not whole or not (self._overlong or self._joining):
            return whole
        end = min(at for at in (whole.find(b"\n"), whole.find(b"\r")) if at >= 0)
        if self._overlong and not self._joining:
            found.spoil(self._overlong + end)
        self._overlong, self._joining = 0, False
        return whole[end:]

    def _cap(self) -> None:
        if self._overlong or len(self._pending) > LINE_BYTES:
            self._overlong += len(self._pending)
            self._pending = b""

    def _read(self, whole: bytes, found: _Collected) -> None:
        if self._width is not None and whole:
            rows = read_table(whole, self._width, SEQUENCE)
            if rows is not None:
                self._take_rows(rows, found)
                return
        text = self._read_until_width(_one_line_end(whole), found)
        if text:
            self._read_damaged(text, self._width or WIDTHS[0], found)

    def _take_rows(self, rows: IntArray, found: _Collected) -> None:
        found.add_rows(rows)
        self._other_width = 0

    def _read_until_width(self, text: bytes, found: _Collected) -> bytes:
        """Line by line to the first good one, which sets the width; the text after it."""
        at = 0
        while self._width is None and at < len(text):
            end = text.index(b"\n", at)
            self._read_line(text[at:end], found)
            at = end + 1
        return text[at:]

    def _read_damaged(self, text: bytes, width: int, found: _Collected) -> None:
        """The good lines all at once, the strangers among them one by one; all one by one where they are many."""
        made = salvage(text, width, SEQUENCE)
        few = len(made.strangers) * _FEW <= len(made.rows)
        if not few or self._longest_run(made.strangers) >= _SWITCH_AFTER:
            for line in text[:-1].split(b"\n"):
                self._read_line(line, found)
            return
        done = 0
        for before, line in made.strangers:
            if before > done:
                self._take_rows(made.rows[done:before], found)
                done = before
            self._read_line(line, found)
        if done < len(made.rows):
            self._take_rows(made.rows[done:], found)

    def _longest_run(self, strangers: tuple[tuple[int, bytes], ...]) -> int:
        """Strangers without a good line between them, with those that ended the last piece."""
        runs = Counter(before for before, _line in strangers)
        return max(runs.values(), default=0) + self._other_width

    def _read_line(self, line: bytes, found: _Collected) -> None:
        values = _parse_line(line) if len(line) <= LINE_BYTES else None
        if values is not None:
            self._read_values(values, len(line), found)
        elif self._is_text(line):
            found.add_text(line.decode("ascii"))
        else:
            found.spoil(len(line))

    def _read_values(self, values: list[int], length: int, found: _Collected) -> None:
        if self._width in (None, len(values)):
            self._width, self._other_width = len(values), 0
            found.add_rows(np.array([values], np.int64))
            return
        # A torn line can look like one of the other width; a counter that was exchanged keeps doing so.
        found.spoil(length)
        self._other_width += 1
        if self._other_width >= _SWITCH_AFTER:
            self._width, self._other_width = len(values), 0

    def _is_text(self, line: bytes) -> bool:
        printable = len(line) <= TEXT_CHARS and line.isascii() and line.decode("ascii").isprintable()
        banner = self._width is None and any(map(bytes.isalpha, line.split()[:1]))
        return printable and (line.startswith(b"!") or banner)
