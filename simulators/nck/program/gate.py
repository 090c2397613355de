"""The double's first gate: what the printed rules of the language refuse is not run.

The judge (`drivers.sinumerik.legality`) knows neither this double nor those who write programs for it, and it is all
that the double shares with them: so the double cannot be more lenient than the manuals again.
"""

from __future__ import annotations

from functools import lru_cache

from drivers.sinumerik.legality import Finding, Machine, check
from simulators.nck.language.syntax import NcSyntaxError
from simulators.nck.spec import NckSpec

SYNTAX = 12080


def admit(spec: NckSpec, path: str, text: str, routines: frozenset[str]) -> None:
    """Judge a program before its first block; ``routines`` are names of other programs of the control.

    Raises NcSyntaxError (alarm 12080) with the line of the first rule that is broken.
    """
    if not spec.judges_programs:
        return
    axes = frozenset(name.upper() for axis in spec.axes for name in (axis.name, axis.letter))
    found = _found(text, path.rpartition("/")[2], axes, routines)
    if found:
        raise NcSyntaxError(max(found[0].line, 1), f"{found[0].code}: {found[0].what}", SYNTAX)


@lru_cache(maxsize=32)
def _found(text: str, name: str, axes: frozenset[str], routines: frozenset[str]) -> tuple[Finding, ...]:
    return check(text, name, Machine(axes, routines))
