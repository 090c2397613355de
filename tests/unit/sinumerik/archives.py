"""NC archives made by hand, member by member, as the container's rules say."""

from __future__ import annotations

ACTIVE = "\\_NC_ACT.DIR\\"


def member(name: str, folder: str, body: bytes, *, when: int = 1_400_000_000) -> bytes:
    """One member: header with its check sum, body filled to a multiple of 512."""
    header = bytearray(512)
    shown = name.removeprefix("_N_").replace("_INI", ".INI").replace("_MPF", ".MPF")
    for at, text in ((0, name), (50, shown), (124, str(len(body))), (136, str(when)), (384, folder)):
        header[at : at + len(text)] = text.encode()
    header[148:154] = str(sum(header)).encode().ljust(6, b"\0")
    return bytes(header) + body + bytes(-len(body) % 512)


def archive(*members: tuple[str, str, bytes]) -> bytes:
    """An archive with its first entry, which is no file of the control, and these members."""
    return b"".join(member(*one) for one in (("@@STAMP", "", b";made by hand\n"), *members))
