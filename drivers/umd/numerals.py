"""Lines of decimal integers, thousands at a time, to arrays: exact grammar, no value from anything else, pure.

Eight digits are turned into a number at once inside a 64 bit word: neighbours are joined to pairs, pairs to
fours, fours to eights, each by one multiplication. Longer numbers take a second word for their front digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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


def _joined(digits: WordArray) -> IntArray:
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
    values = _joined(digits)
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
    values = _joined(digits)
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
        values[left] += _joined(digits) * scale
        scale *= 10**WORD
    np.negative(values, out=values, where=negative)
    return values, bad
