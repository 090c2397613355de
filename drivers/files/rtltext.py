"""The text of .rtl and .rta files to a record and back, pure: grammar only, no units, no directions.

Layout as five independent public readers and one writer agree on it: sections "NAME::", keys padded before
a colon, targets five a line, rows "run target deviation" counted from 1. What is not understood is kept.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from drivers.errors import FileFormatError
from drivers.files.numbers import decimal, fixed, uses_comma, whole
from drivers.message import Message

_SECTION = re.compile(r"([A-Z][A-Z0-9 -]*)::\s*\Z")
_BREAK = re.compile(r"\r\n|\n|\r")
TARGETS_A_LINE = 5
ENOUGH = 3
"""So many letters of the first line tell what a file was to be."""
MOST_TARGETS, MOST_RUNS = 100_000, 10_000

Lines = tuple[tuple[int, str], ...]


@dataclass(frozen=True, slots=True)
class RtlText:
    """One file. ``sections`` holds every section's lines as they stood but the targets and the rows.

    ``targets`` in the file's own unit; ``rows`` (run, target number, deviation) in the order of the file.
    """

    targets: tuple[float, ...]
    run_count: int
    rows: tuple[tuple[int, int, float], ...]
    sections: tuple[tuple[str, tuple[str, ...]], ...]
    warnings: tuple[Message, ...] = ()

    def section(self, name: str) -> tuple[str, ...]:
        """The lines of a section; empty where it is missing."""
        return next((lines for found, lines in self.sections if found == name), ())

    def keys(self, name: str) -> dict[str, str]:
        """The keys of a section, blanks collapsed, first of equal ones, with their values."""
        return keyed(self.section(name))


def keyed(lines: Iterable[str]) -> dict[str, str]:
    """Lines "key : value" to a mapping; keys keep their letters, their blanks are collapsed."""
    found: dict[str, str] = {}
    for line in lines:
        key, colon, value = line.partition(":")
        name = " ".join(key.split())
        if colon and name:
            found.setdefault(name, value.strip())
    return found


def lookup(found: dict[str, str], key: str) -> str | None:
    """A value by its key, whatever the case of its letters."""
    return next((value for name, value in found.items() if name.lower() == key.lower()), None)


def wrong_line(where: str, line: int, why: str | Message) -> FileFormatError:
    """The error for one line."""
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)


def parse(text: str, where: str) -> RtlText:
    """Read a whole file. Raises FileFormatError: E-FILE-DETECT, E-FILE-LINE, E-FILE-CUT, E-FILE-COUNT."""
    sections, whole_file = _sections(text, where)
    try:
        return _content(sections, whole_file, where)
    except FileFormatError as error:
        if whole_file:
            raise
        raise _cut(text, where) from error


def _content(sections: dict[str, Lines], whole_file: bool, where: str) -> RtlText:
    """What the sections hold; of a file without its end, only what lacks no reading."""
    warnings = [] if whole_file else [Message.of("S-FILE-NO-EOF")]
    comma = _decimal_comma(sections)
    if comma:
        warnings.append(Message.of("S-FILE-COMMA"))
    targets, target_rest = _targets(sections.get("TARGET DATA", ()), comma, where)
    rows, row_rest = _rows(sections.get("DEVIATIONS", ()), len(targets), comma, where)
    run_count = _run_count(sections.get("RUNS", ()), rows, warnings, where)
    if not whole_file and len(rows) < run_count * len(targets):
        raise FileFormatError("E-FILE-COUNT", where, stated=run_count * len(targets), found=len(rows))
    kept = {name: tuple(line for _at, line in lines) for name, lines in sections.items()}
    kept["TARGET DATA"], kept["DEVIATIONS"] = target_rest, row_rest
    return RtlText(
        targets=targets, run_count=run_count, rows=rows, sections=tuple(kept.items()), warnings=tuple(warnings)
    )


def _cut(text: str, where: str) -> FileFormatError:
    """The error of a file that ends too soon."""
    return FileFormatError("E-FILE-CUT", where, line=len(_BREAK.split(text.rstrip())))


def _sections(text: str, where: str) -> tuple[dict[str, Lines], bool]:
    """Section name -> numbered lines that are not blank, up to EOF::; and whether that was there."""
    lines = _BREAK.split(text)
    if len(text.rstrip()) >= ENOUGH and "HEADER::".startswith(text.rstrip()):
        raise _cut(text, where)
    first = next((line.rstrip() for line in lines if line.strip()), "")
    if first != "HEADER::":
        raise FileFormatError("E-FILE-DETECT", where, found=first[:40])
    grown: dict[str, list[tuple[int, str]]] = {}
    current: list[tuple[int, str]] = []
    for at, line in enumerate(lines, start=1):
        match = _SECTION.match(line)
        if match and match[1] == "EOF":
            return {name: tuple(found) for name, found in grown.items()}, True
        if match:
            if match[1] in grown:
                raise wrong_line(where, at, f"section {match[1]} occurs twice")
            current = grown.setdefault(match[1], [])
        elif line.strip():
            current.append((at, line))
    if lines[-1].strip():
        raise _cut(text, where)
    return {name: tuple(found) for name, found in grown.items()}, False


def _decimal_comma(sections: dict[str, Lines]) -> bool:
    numeric = (line for name in ("TARGET DATA", "DEVIATIONS") for _at, line in sections.get(name, ()))
    return uses_comma(" ".join(line for line in numeric if ":" not in line))


def _targets(lines: Lines, comma: bool, where: str) -> tuple[tuple[float, ...], tuple[str, ...]]:
    """The numbers after "Targets :" and all other lines of their section."""
    numbers: list[float] = []
    rest: list[str] = []
    inside = False
    for at, line in lines:
        key, colon, value = line.partition(":")
        if colon:
            inside = "".join(key.split()).lower() == "targets"
            if not inside:
                rest.append(line)
        elif not inside:
            raise wrong_line(where, at, Message.of("W-FILE-NO-KEY", found=line.strip()))
        if inside:
            numbers.extend(_numbers((value if colon else line).split(), comma, at, where))
    count = lookup(keyed(rest), "Target-count")
    if not numbers and count is None:
        raise FileFormatError("E-FILE-ROWS", where)
    if not numbers or (count is not None and whole(count) != len(numbers)) or len(numbers) > MOST_TARGETS:
        raise FileFormatError("E-FILE-COUNT", where, stated=count or "some", found=len(numbers))
    return tuple(numbers), tuple(rest)


def _numbers(tokens: Iterable[str], comma: bool, at: int, where: str) -> Iterator[float]:
    for token in tokens:
        number = decimal(token, comma=comma)
        if number is None:
            raise wrong_line(where, at, Message.of("W-FILE-NO-NUMBER", bad=token))
        yield number


def _rows(
    lines: Lines, targets: int, comma: bool, where: str
) -> tuple[tuple[tuple[int, int, float], ...], tuple[str, ...]]:
    """Rows of three numbers, every (run, target) once, and the lines with keys among them."""
    rows: dict[tuple[int, int], float] = {}
    rest: list[str] = []
    for at, line in lines:
        if ":" in line and not line.lstrip()[0].isdigit():
            rest.append(line)
            continue
        run, target, value = _row(line.split(), comma, at, where)
        if not 1 <= target <= targets or not 1 <= run <= MOST_RUNS:
            raise wrong_line(where, at, Message.of("W-FILE-RUN-TARGET", run=run, target=target, targets=targets))
        if (run, target) in rows:
            raise wrong_line(where, at, f"run {run}, target {target} occurs twice")
        rows[run, target] = value
    if not rows:
        raise FileFormatError("E-FILE-ROWS", where)
    return tuple((run, target, value) for (run, target), value in rows.items()), tuple(rest)


def _row(tokens: list[str], comma: bool, at: int, where: str) -> tuple[int, int, float]:
    if len(tokens) != 3:
        raise wrong_line(where, at, Message.of("W-FILE-ROW-NEEDS"))
    run, target, value = whole(tokens[0]), whole(tokens[1]), decimal(tokens[2], comma=comma)
    if run is None or target is None or value is None:
        raise wrong_line(where, at, Message.of("W-FILE-NO-ROW", tokens=" ".join(tokens)))
    return run, target, value


def _run_count(lines: Lines, rows: tuple[tuple[int, int, float], ...], warnings: list[Message], where: str) -> int:
    stated = lookup(keyed(line for _at, line in lines), "Run-count")
    found = max(run for run, _target, _value in rows)
    if stated is None:
        warnings.append(Message.of("S-FILE-NO-COUNT", found=found))
        return found
    count = whole(stated)
    if count is None or not found <= count <= MOST_RUNS:
        raise FileFormatError("E-FILE-COUNT", where, stated=f"{stated} runs", found=f"run {found}")
    return count


def render(content: RtlText) -> str:
    """A whole file's text with CR LF line ends; `parse` gives the same record back."""
    lines: list[str] = []
    for name, kept in content.sections:
        lines.append(f"{name}::")
        lines.extend(_target_lines(kept, content.targets) if name == "TARGET DATA" else kept)
        if name == "DEVIATIONS":
            lines.extend(f"{run:3d}  {target:3d}  {fixed(value)}" for run, target, value in content.rows)
        lines.append("")
    return "\r\n".join([*lines, "EOF::", ""])


def _target_lines(kept: tuple[str, ...], targets: tuple[float, ...]) -> list[str]:
    """The targets stand before "Flags", five a line, as capture programs write them."""
    starts = range(0, len(targets), TARGETS_A_LINE)
    numbers = [" " + "  ".join(fixed(target) for target in targets[at : at + TARGETS_A_LINE]) for at in starts]
    flags = [line for line in kept if line.lower().startswith("flags")]
    return [*(line for line in kept if line not in flags), "Targets :", *numbers, *flags]
