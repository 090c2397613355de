"""Is an NC program legal? The printed rules of the control's language and the control's own lists of names judge.

This room knows no generator and no double: it was written from the manuals and ``dictionary.json`` (names, numbers,
types and index counts; its licence stands beside it) alone, so that it can judge both.

Judged as printed (Programming Manual Fundamentals 10.2004, 11/2006, Job Planning 04.00, 03/2006, 07/2010, 02/2011,
SINUMERIK ONE 12/2019): names (first two characters, 31/32/24 characters, reserved words, prefixes and devices; one
name, one thing), file names and paths, known words, functions, G commands and their groups, machine and setting
data and system variables with their number of indices, axis indices of axial data, R parameters, ``=`` behind
addresses, numbers (EX, hexadecimal, 32-bit INT), characters, brackets, texts of at most 200 characters, priority of
operators, conversion of types, comparisons of STRING, AXIS and FRAME, DEF in the head with one type, structures
closed in order, without label and skip sign, labels and directions of jumps, the end word, % and ;$PATH lines.

Refused though only recalled, because nothing is lost by keeping them: block of 512 characters, MSG 124, WRITE 200,
structures nested 16 deep, no jump into a structure, block numbers of eight digits, the number of values of the
procedures in ``functions``. Refused because it misleads, though
legal: a comparison beside an unbracketed AND, OR, XOR or comparison (it binds weakest), NOT before a bare number.
Refused because this judge does not read it: more than 40 brackets in brackets.

Not judged, because not printed where we looked, or not to be known from the text: how often an address may stand in
a block, how many M functions, which commands want a block of their own; the order of words; access levels, options
and whether a variable may be written; how long a chained text becomes when it runs; numbers of R parameters, axes
and tables of this machine; values and array limits of data; what synchronised actions, macros, CALL, MCALL and
REDEF contain; labels in STRING variables; axis names without brackets as values; characters in comments; whether a
block can be reached; the end word by kind of program (M17 in a main program); machine data of builders.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.sinumerik.legality.lexer import Finding, IllegalBlock, Scope, check_program_name, make_finding
from drivers.sinumerik.legality.program import Program

__all__ = ["Finding", "Machine", "check"]


@dataclass(frozen=True)
class Machine:
    """What a program may name beside the language: the machine's axes (in capitals) and its sub-programs."""

    axes: frozenset[str] = frozenset()
    programs: frozenset[str] = frozenset()


def check(text: str, name: str = "", machine: Machine | None = None) -> tuple[Finding, ...]:
    """Every broken rule of a program's ``text``, by line; none if it is legal.

    ``name`` is the program's own, with or without extension (line 0 of the findings); "" leaves it unjudged.
    """
    known = machine or Machine()
    program = Program(name, Scope(axes=known.axes, routines=set(known.programs)))
    lines = text.split("\n")
    for number, line in enumerate(lines, 1):
        program.read(number, line)
    return (*_judge_name(name), *program.findings(len(lines)))


def _judge_name(name: str) -> tuple[Finding, ...]:
    if not name:
        return ()
    try:
        check_program_name(name)
    except IllegalBlock as wrong:
        return (make_finding(0, wrong),)
    return ()
