"""The rules of names: user variables, labels, programs, files of the control's own file system."""

from __future__ import annotations

import functools
import re

from drivers.sinumerik.legality.dictionary import dictionary
from drivers.sinumerik.legality.findings import Illegal

LONGEST = {"variable": 31, "label": 32, "program": 24, "axis": 8}  # printed
_FIRST = re.compile(r"[A-Z_]{2}[A-Z0-9_]*", re.ASCII)
_PROGRAM = re.compile(r"(?:[A-Z]{2}|_[A-Z])[A-Z0-9_]*", re.ASCII)
_RESERVED_PREFIXES = ("CYCLE", "CCS", "CC_", "CUST_", "GROUP_", "S_", "E_", "F_", "_")
_RESERVED_NAMES = frozenset({"RL"})
_DEVICES = re.compile(r"CON|PRN|AUX|NUL|COM[1-9]|LPT[1-9]")
_FILE = re.compile(r"(?:_N_)?(?P<name>.*?)(?:[._](?P<extension>MPF|SPF|WPF|INI|DEF|GUD|TEA|UFR|TOA|EEC|CEC))?")
_FOLDER = re.compile(r"(?:_N_)?[A-Z0-9_]+[._](?:DIR|WPD)", re.ASCII)
AXIS_LETTERS = frozenset("ABCEIJKQUVWXYZ")  # printed: the address letters that take a number
_NUMBERED_AXIS = re.compile(r"(?:[ABCEIJKQUVWXYZ][1-9]?[0-9]?|AX[1-9][0-9]?|S[0-9]{1,2})")


def judge_name(name: str, kind: str) -> None:
    """Raise Illegal unless ``name`` (in capitals) may be a user's name of this kind (variable, label)."""
    if not _FIRST.fullmatch(name):
        raise Illegal("E-LEGAL-NAME", name=name, kind=kind)
    _judge_length(name, kind)
    _judge_reserved(name, kind)


def judge_program_name(name: str) -> None:
    """Raise Illegal unless a program may be called so; with or without _N_ and extension, no path."""
    bare = bare_name(name)
    if not _PROGRAM.fullmatch(bare):
        raise Illegal("E-LEGAL-PROGRAM-NAME", name=name)
    _judge_length(bare, "program")
    if _DEVICES.fullmatch(bare):
        raise Illegal("E-LEGAL-DEVICE-NAME", name=name)
    _judge_reserved(bare, "program")


def judge_file_name(text: str) -> None:
    """Raise Illegal unless ``text`` names a file of the control: [path/][_N_]name[_MPF]; words are no matter here."""
    *folders, last = text.upper().split("/")
    if folders and folders[0]:
        raise Illegal("E-LEGAL-FILE-NAME", name=text)  # printed: paths are absolute
    bare = bare_name(last)
    if any(not _FOLDER.fullmatch(folder) for folder in folders[1:]) or not _PROGRAM.fullmatch(bare):
        raise Illegal("E-LEGAL-FILE-NAME", name=text)
    _judge_length(bare, "program")


def bare_name(name: str) -> str:
    """The name itself in capitals: without _N_, without extension."""
    match = _FILE.fullmatch(name.upper())
    return match["name"] if match else name.upper()


@functools.lru_cache(maxsize=512)
def looks_like_axis(name: str) -> bool:
    """An address letter with or without a number (X, X1, A12), AXn, or a spindle S1."""
    return _NUMBERED_AXIS.fullmatch(name) is not None


def _judge_length(name: str, kind: str) -> None:
    if len(name) > LONGEST[kind]:
        raise Illegal("E-LEGAL-NAME-LENGTH", name=name, kind=kind, length=len(name), limit=LONGEST[kind])


def _judge_reserved(name: str, kind: str) -> None:
    if name in dictionary().reserved or name in _RESERVED_NAMES or looks_like_axis(name):
        raise Illegal("E-LEGAL-RESERVED", name=name, kind=kind)
    for prefix in _RESERVED_PREFIXES:
        if name.startswith(prefix):
            raise Illegal("E-LEGAL-PREFIX", name=name, kind=kind, prefix=prefix)
