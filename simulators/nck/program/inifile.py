"""Loading and saving NC active data: the text of an initialisation (INI) file, line by line.

Grammar: an optional ``%`` header and CHANDATA line, then assignments, optionally with a block number and, after
an apostrophe, four hex digits of line checksum; M17, M30 or M2 ends it. The real checksum's rule is not
public: CRC-16/CCITT over the text before the apostrophe stands for it.
"""

from __future__ import annotations

import binascii
import re
from collections.abc import Iterator
from dataclasses import dataclass

from simulators.nck.language.parser import parse_block
from simulators.nck.language.syntax import (
    Address,
    Assign,
    BareWord,
    Expression,
    Indexed,
    NcSyntaxError,
    Number,
    OrdinaryBlock,
    Text,
    Unary,
)
from simulators.nck.machine.core import Core
from simulators.nck.program.variables import Variables
from simulators.nck.spec import NckRefusal
from simulators.nck.values import AxisName, Value

_HEADER = re.compile(r"%_N_(AX\d*_EEC|NC_CEC|[A-Z0-9_]+)_INI")
_CHANDATA = re.compile(r"CHANDATA\(\d+\)")
_NUMBER = re.compile(r"N\d+\s*")
_CHECKED = re.compile(r"(.*)'([0-9A-F]{4})\s*")
_ENDS = (2, 17, 30)
_MANUFACTURER = 2
_ABORTED, _COUNTED = 15180, 15185


@dataclass(frozen=True, slots=True)
class IniReport:
    """What became of a file: lines taken, and the refused ones as (line from 1, alarm, text)."""

    taken: int
    errors: tuple[tuple[int, int, str], ...]
    aborted: bool


def checksum(text: str) -> str:
    """The four hex digits after a line's apostrophe."""
    return f"{binascii.crc_hqx(text.rstrip().encode('latin-1', 'replace'), 0xFFFF):04X}"


def load(data: bytes, core: Core, variables: Variables, level: int) -> IniReport:
    """Take a file's values as MD11220 says: abort at the first error, or go on and count (alarms 15180, 15185).

    A value that is refused never overwrites the current one. Lines without a valid checksum need the rights
    of the manufacturer (``level`` 2 or less).
    """
    mode = int(core.data.effective("$MN_INI_FILE_MODE"))
    errors: list[tuple[int, int, str]] = []
    taken = 0
    for number, line in _lines(data):
        try:
            if _take(line, variables, level):
                taken += 1
            elif _is_end(line):
                break
        except (NckRefusal, NcSyntaxError) as error:
            entry = (number, error.number, error.reason if isinstance(error, NcSyntaxError) else error.text)
            errors.append(entry)
            if mode < 2:
                core.alarms.raise_(entry[1], f"INI file line {number}: {entry[2]}")
            if mode == 0:
                break
    _close(core, errors, mode)
    return IniReport(taken, tuple(errors), aborted=bool(errors) and mode == 0)


def _close(core: Core, errors: list[tuple[int, int, str]], mode: int) -> None:
    if errors and mode == 0:
        core.alarms.raise_(_ABORTED, "program cannot be executed as INI file")
    elif errors:
        core.alarms.raise_(_COUNTED, f"{len(errors)} errors in INI file")


def _lines(data: bytes) -> Iterator[tuple[int, str]]:
    for number, raw in enumerate(data.decode("latin-1").splitlines(), 1):
        line = raw.strip()
        first = line.upper()
        if line and not line.startswith(";") and not _HEADER.fullmatch(first) and not _CHANDATA.fullmatch(first):
            yield number, line


def _is_end(line: str) -> bool:
    return line.upper().partition(";")[0].strip() in {f"M{end}" for end in _ENDS}


def _take(line: str, variables: Variables, level: int) -> bool:
    """One line; False when it assigns nothing. Raises NckRefusal or NcSyntaxError."""
    found = _CHECKED.fullmatch(line)
    text = found[1] if found else line
    if (found is None or checksum(found[1]) != found[2]) and level > _MANUFACTURER and "=" in text:
        raise NckRefusal(4075, "no access rights to load a line without valid checksum")
    code = _NUMBER.sub("", text.partition(";")[0].strip().upper(), count=1)
    block = parse_block(code)
    items = block.items if isinstance(block, OrdinaryBlock) else ()
    if len(items) == 1 and isinstance(items[0], Address) and items[0].letter == "M":
        return False
    if len(items) != 1 or not isinstance(items[0], Assign):
        raise NcSyntaxError(1, f"syntax error: no assignment in {code[:40]!r}")
    target, value = items[0].target, items[0].value
    indices = tuple(_constant(index) for index in target.indices) if isinstance(target, Indexed) else ()
    variables.write(target.name, indices, _constant(value), level, program=False)
    return True


def _constant(node: Expression | object) -> Value:
    if isinstance(node, Number | Text):
        return node.value
    if isinstance(node, Unary) and isinstance(node.operand, Number) and node.operator in "+-":
        return -node.operand.value if node.operator == "-" else node.operand.value
    name = getattr(node, "name", None)
    if isinstance(name, str) and not isinstance(node, Indexed | BareWord):
        return AxisName(name) if name not in ("TRUE", "FALSE") else name == "TRUE"
    raise NcSyntaxError(1, "syntax error: a constant is expected")


# -- saving ----------------------------------------------------------------------------------------------


def eec_text(core: Core, variables: Variables, axis: int, encoder: int) -> bytes:
    """The table of an axis and encoder as the control gives it out; MD11230 bit 0: with line checksums."""
    name = core.spec.axes[axis].name
    table = core.memory.eec[axis, encoder]
    lines = [f"$AA_ENC_COMP[{encoder},{n},{name}]={value:.10g}" for n, value in enumerate(table.points)]
    for part in ("STEP", "MIN", "MAX", "IS_MODULO"):
        value = variables.read(f"$AA_ENC_COMP_{part}", (encoder, AxisName(name)))
        lines.append(f"$AA_ENC_COMP_{part}[{encoder},{name}]={float(value):.10g}")
    return _file(f"%_N_AX{axis + 1}_EEC_INI", lines, core)


def cec_text(core: Core, variables: Variables, number: int) -> bytes:
    """A CEC table as the control gives it out. Raises NckRefusal 17020."""
    table = core.memory.cec_table(number)
    lines = [f"$AN_CEC[{number},{n}]={value:.10g}" for n, value in enumerate(table.points)]
    for part in ("INPUT_AXIS", "OUTPUT_AXIS"):
        axis = variables.read(f"$AN_CEC_{part}", (number,))
        lines += [f"$AN_CEC_{part}[{number}]=({axis})"] if axis else []
    for part in ("STEP", "MIN", "MAX", "DIRECTION", "MULT_BY_TABLE", "IS_MODULO", "TYPE"):
        lines.append(f"$AN_CEC_{part}[{number}]={float(variables.read(f'$AN_CEC_{part}', (number,))):.10g}")
    return _file("%_N_NC_CEC_INI", lines, core)


def _file(header: str, lines: list[str], core: Core) -> bytes:
    if int(core.data.effective("$MN_MD_FILE_STYLE")) & 1:
        lines = [f"{line} '{checksum(line + ' ')}" for line in lines]
    return ("\n".join([header, "CHANDATA(1)", *lines, "M17"]) + "\n").encode("latin-1")
