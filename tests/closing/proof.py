"""Writes what a proof run found: a document with the table of machines and the criteria, and a picture."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from tests.closing.record import CRITERIA, EDGES, FLOOR_FACTOR, MachineResult, Results, pooled_points

LIBRARIES = ("trueflank", "numpy", "scipy", "asyncua")
HEAD = (
    "machine", "gear", "before", "set right", "after", "limit", "floor", "least", "u", "predicted", "z RMS",
    "z points", "worst motion", "M X, Z, C before -> after", "verdict", "hours", "s",
)  # fmt: skip
WORDS = """Figures are RMS of the true normal deviation in um: all spaces, both flanks, 95 % of the profile in equal arc
length, full width, one rotation removed. *Before* is the part as ground first, *set right* the same without
what x zero and dressing offset take away, *after* the last part. *floor* is the least that the four cross
tables on the control's grids, x zero and dressing offset leave on the true machine, found by grinding on it; no
table takes the work's own eccentricity, which changes at every clamping (*least*: tables may). *limit* is
sqrt((1.15 floor)^2 + u^2); *u* the standard uncertainty of the flank as predicted. *z points* is the standard
deviation of (true - predicted deviation) / u over the points of the last part, *z RMS* is (true - predicted
RMS) / its predicted standard deviation. *worst motion* is the error motion that uses most of what is allowed,
in per cent of that. M in um, of C in arcsec, with all tables acting. Hours are those of the machine: the moves and
readings of the run, with the times that a site file supposes for people and restarts where it says nothing
(`[times]`: a mounting takes 15 min, an NCK reset 4 min). s are those of the computer."""


def write(results: Results, folder: Path, command: str, name: str = "proof") -> Path:
    """`proof.md` and `proof-histogram.png` in a folder; returns the document's path."""
    folder.mkdir(parents=True, exist_ok=True)
    picture = folder / f"{name}-histogram.png"
    draw(results, picture)
    path = folder / f"{name}.md"
    path.write_text(document(results, command, picture.name), encoding="utf-8")
    return path


def document(results: Results, command: str, picture: str) -> str:
    """The whole document as Markdown; dates are those of the runs' own clock."""
    pooled = pooled_points(results)
    done = [one for one in results if not one.failed]
    scalars = np.asarray([one.scalar for one in done] or [0.0])
    lines = [
        "# The proof: seeded machines through the closing run",
        "",
        f"Written by the run itself on {max(one.utc for one in results)[:10]}, with {versions()}.",
        f"Repeat with `{command}`.",
        "",
        f"{len(results)} machines, {sum(one.hours for one in results):.0f} machine hours in "
        f"{sum(one.wall_s for one in results) / 60.0:.0f} minutes of computing.",
        "",
        "| criterion | | what breaks it |",
        "|---|---|---|",
        *criteria_rows(results),
        "",
        f"Normalised errors: {pooled.count} points, mean {pooled.mean:+.2f}, "
        f"standard deviation {pooled.deviation:.2f};",
        f"RMS of {len(done)} machines, mean {scalars.mean():+.2f}, standard deviation {scalars.std():.2f}.",
        *stricter(done),
        "",
        WORDS,
        "",
        row(HEAD),
        row(["---"] * len(HEAD)),
        *(machine_row(one) for one in results),
        "",
        f"![normalised errors and RMS]({picture})",
        "",
    ]
    few = [one for one in done if one.b_left[0] and one.lobes < 20]
    lines[-2:-2] = [
        f"- {one.name} ({one.gear}): {100 * one.b_left[0]:.0f} % of B said to stay, {100 * one.b_left[1]:.0f} % seen."
        for one in few
    ] + [""] * bool(few)
    return "\n".join(lines)


def stricter(done: Results) -> list[str]:
    """How many machines would stay within stricter readings of the first criterion; for information."""
    if not done:
        return []
    least = sum(one.after_um <= float(np.hypot(FLOOR_FACTOR * one.least_um, one.u_um)) for one in done)
    spread = sum(one.after_um <= float(np.hypot(FLOOR_FACTOR * one.floor_um, one.rms_u_um)) for one in done)
    return [
        "",
        f"Read more strictly, the limit holds on {least} of {len(done)} machines with the least floor, and on "
        f"{spread} of {len(done)} with the predicted standard deviation of the RMS in place of u.",
    ]


def criteria_rows(results: Results) -> list[str]:
    """One row a criterion."""
    rows = []
    for one in CRITERIA:
        broken = one.broken(results)
        rows.append(row([one.says, "broken" if broken else "holds", "; ".join(broken[:5])]))
    return rows


def machine_row(one: MachineResult) -> str:
    """One row of the table of machines."""
    if one.failed:
        return row([one.name, one.gear, *[""] * (len(HEAD) - 5), one.failed, "", f"{one.wall_s:.0f}"])
    part = one.worst_component
    figures = (one.before_um, one.set_right_um, one.after_um, one.limit_um, one.floor_um, one.least_um, one.u_um)
    axes = ", ".join(f"{before:.1f} -> {after:.1f}" for before, after in one.axes.values())
    cells = [one.name, one.gear, *(f"{figure:.2f}" for figure in figures), f"{one.predicted_um:.2f}"]
    cells += [f"{one.scalar:+.1f}", f"{one.points.deviation:.2f}", f"{part.name} {100 * part.off / part.limit:.0f} %"]
    return row([*cells, axes, one.outcome, f"{one.hours:.1f}", f"{one.wall_s:.0f}"])


def row(cells: Sequence[str]) -> str:
    """Cells as a row of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def versions() -> str:
    """Of Python and of what computes."""
    return ", ".join(
        [f"Python {platform.python_version()}", *(f"{name} {metadata.version(name)}" for name in LIBRARIES)]
    )


def draw(results: Results, path: Path) -> None:
    """Left: normalised errors of the points and the normal curve. Right: the flank after over its limit, by machine."""
    done = [one for one in results if not one.failed]
    pooled = pooled_points(results)
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(10.0, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        width = np.diff(EDGES)
        left.bar(EDGES[:-1], np.asarray(pooled.bins) / max(pooled.count, 1) / width, width, align="edge", color="0.7")
        at = np.linspace(EDGES[0], EDGES[-1], 201)
        left.plot(at, np.exp(-0.5 * at**2) / np.sqrt(2.0 * np.pi), "k-", linewidth=1.0)
        left.set_xlabel(f"(truth - prediction) / u of {pooled.count} points: standard deviation {pooled.deviation:.2f}")
        left.set_ylabel("density; line: normal")
        shares = [one.after_um / one.limit_um for one in done]
        right.hist(shares, np.linspace(0.0, max(1.2, *shares, 0.0), 31) if shares else 10, color="0.7")
        right.axvline(1.0, color="k", linewidth=1.0)
        right.set_xlabel("RMS after over its limit")
        right.set_ylabel(f"machines of {len(done)}")
        figure.savefig(path, dpi=110, metadata={"Software": None})
