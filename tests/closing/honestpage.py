"""Writes what closing runs on the families of machines found: how honest their uncertainties are, and each machine."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tests.closing.honesty import FEWEST, Spread, broken, spreads
from tests.closing.proof import HEAD, machine_row, row, versions
from tests.closing.record import Results

NAME = "families.md"
WORDS = """Each family is the class of [proof.md](proof.md) with one thing that makes its machines hard; what that is
stands in `tests/closing/families.py`. A normalised error is (truth - prediction) / u, of the flank's points of the
last part, and of its RMS, one a machine. The standard deviation is that about the mean. Of honest uncertainties it is
1; in a family fewer than {fewest} machines decide nothing. A mean below 0 of the RMS says that the flank came out
better than it was predicted. Machines whose run ended with an error stand in the table and not in the figures. Nothing
of this has run on a real control or instrument."""


def write(families: Mapping[str, Results], folder: Path, command: str, wanted: int) -> Path:
    """`families.md` in a folder (made if missing); returns its path. ``wanted`` is how many machines there will be."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / NAME
    path.write_text(document(families, command, wanted), encoding="utf-8")
    return path


def document(families: Mapping[str, Results], command: str, wanted: int) -> str:
    """The whole document as Markdown; the date is that of the runs' own clock."""
    whole = [one for results in families.values() for one in results]
    found = spreads(families)
    failed = [one for one in whole if one.failed]
    done = f"{len(whole)} machines" if len(whole) >= wanted else f"{len(whole)} of {wanted} machines so far"
    return "\n".join(
        [
            "# Families of machines through the closing run",
            "",
            f"Written by the run itself on {max((one.utc for one in whole), default='')[:10]}, with {versions()}.",
            f"Repeat with `{command}`.",
            "",
            f"{done}, {sum(one.hours for one in whole):.0f} machine hours in "
            f"{sum(one.wall_s for one in whole) / 60.0:.0f} minutes of computing; {len(failed)} ended with an error.",
            "",
            row(["figure", "machines of", "machines", "mean", "standard deviation", "allowed", ""]),
            row(["---"] * 7),
            *(_spread_row(one) for one in found),
            "",
            *([f"Broken: {line}." for line in broken(found)] or ["Nothing is outside what is allowed."]),
            "",
            WORDS.format(fewest=FEWEST),
            "",
            "The columns of the machines are those of [proof.md](proof.md).",
            "",
            row(HEAD),
            row(["---"] * len(HEAD)),
            *(machine_row(one) for one in whole),
            "",
        ]
    )


def _spread_row(one: Spread) -> str:
    answer = "too few" if not one.judged else "holds" if one.honest else "broken"
    allowed = f"{one.limits[0]} to {one.limits[1]}"
    figures = [f"{one.mean:+.2f}", f"{one.deviation:.2f}"]
    return row([one.what, one.family, str(one.machines), *figures, allowed, answer])
