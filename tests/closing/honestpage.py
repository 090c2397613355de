"""Writes what closing runs on the families of machines found: how honest their uncertainties are, and each machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.closing.honesty import FEWEST, Spread, broken, spreads
from tests.closing.proof import HEAD, machine_row, row, versions
from tests.closing.record import Results
from tests.closing.trials import Trial, harmed, of_trials

NAME = "families.md"
TRIALS = """A smaller trial, of more machines: every set-up is a file that the cell's bench wrote, nothing is written to
a control, no part is inspected or clamped anew. The true machine grinds the disc of few lobes before and with what was
proposed, set-up values right in both. *missed* is the RMS of (true - predicted flank). *u acting* is what the errors
alone make of its u, and how an axis comes to a place where the axes of the machine scatter; *ratio* is missed / u
acting. Of honest uncertainties the root mean square of the ratios is 1. A run with an instrument takes readings out of
line again and measures closer where a curve needs it; from files it cannot. The machines called *other* have three
things that are hard at once, with numbers that no family draws (`tests/closing/others.py`)."""
WORDS = """Each family is the class of [proof.md](proof.md) with one thing that makes its machines hard; what that is
stands in `tests/closing/families.py`. A normalised error is (truth - prediction) / u, of the flank's points of the
last part, and of its RMS, one a machine. The standard deviation is that about the mean. Of honest uncertainties it is
1; in a family fewer than {fewest} machines decide nothing. A mean below 0 of the RMS says that the flank came out
better than it was predicted. Machines whose run ended with an error stand in the table and not in the figures. Nothing
of this has run on a real control or instrument."""


def write(
    families: Mapping[str, Results], folder: Path, command: str, wanted: int, trials: Sequence[Trial] = ()
) -> Path:
    """`families.md` in a folder (made if missing); returns its path. ``wanted`` is how many machines there will be."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / NAME
    path.write_text(document(families, command, wanted, trials), encoding="utf-8")
    return path


def document(families: Mapping[str, Results], command: str, wanted: int, trials: Sequence[Trial] = ()) -> str:
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
            *(_tried(trials) if trials else ()),
        ]
    )


def _tried(trials: Sequence[Trial]) -> list[str]:
    """The part about machines on whose truth a proposal was tried."""
    by = {family: [one for one in trials if one.name.rsplit("-", 1)[0] == family] for family in _families(trials)}
    found = of_trials(by)
    ended = [one for one in trials if one.failed]
    better = sum(one.after_um < one.before_um for one in trials if not one.failed)
    wrong = [line for one in trials for line in harmed(one)]
    return [
        "## Proposals tried on the truth",
        "",
        TRIALS,
        "",
        f"{len(trials)} machines, {len(ended)} ended with an error; the flank of {better} got better.",
        "",
        row(["figure", "machines of", "machines", "mean", "root mean square", "allowed", ""]),
        row(["---"] * 7),
        *(_spread_row(one) for one in found),
        "",
        *([f"Broken: {line}." for line in [*broken(found), *wrong]] or ["Nothing is outside what is allowed."]),
        "",
        row(["machine", "before", "after", "missed", "u acting", "u", "ratio", "M X, Z before -> after"]),
        row(["---"] * 8),
        *(_trial_row(one) for one in trials),
        "",
    ]


def _families(trials: Sequence[Trial]) -> list[str]:
    return list(dict.fromkeys(one.name.rsplit("-", 1)[0] for one in trials))


def _trial_row(one: Trial) -> str:
    if one.failed:
        return row([one.name, *[""] * 6, one.failed])
    figures = (one.before_um, one.after_um, one.missed_um, one.acting_u_um, one.u_um, one.ratio)
    axes = ", ".join(f"{before:.1f} -> {after:.1f}" for before, after in one.axes.values())
    return row([one.name, *(f"{figure:.2f}" for figure in figures), axes])


def _spread_row(one: Spread) -> str:
    answer = "too few" if not one.judged else "holds" if one.honest else "broken"
    allowed = f"{one.limits[0]} to {one.limits[1]}"
    figures = [f"{one.mean:+.2f}", f"{one.deviation:.2f}"]
    return row([one.what, one.family, str(one.machines), *figures, allowed, answer])
