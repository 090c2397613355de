"""A study's pictures as PNG files in a folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drivers.terms import spoken
from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.gear.grinding import Grinding
from gateway.study import drawing
from gateway.study.calculate import Study
from gateway.study.draw_drive import transmission_picture
from gateway.study.plots.charts import Paint, write_sheet
from gateway.study.plots.kinematics import machine_frames, relative_curves
from gateway.study.relative_errors import RelativeSweep, relative_lines


def write_pictures(study: Study, folder: Path) -> tuple[Path, ...]:
    """Draw everything into a folder (made if missing). Raises StoreError E-STUDY-WRITE."""
    states = (
        ("present state", study.before.deviation),
        (f"with {spoken().own} (axes corrected)", study.with_own.deviation),
        (f"with {spoken().own}, {spoken().cross} and set-up values", study.after.deviation),
    )
    pictures: tuple[tuple[str, tuple[float, float], Paint], ...] = (
        ("one-at-a-time", (11.0, 5.2), lambda figure: drawing.one_at_a_time(figure, study)),
        ("flank-before-after", (11.0, 6.0), lambda figure: drawing.flank_maps(figure, study, states)),
        ("ranking", (11.0, 5.6), lambda figure: drawing.draw_ranking(figure, study)),
        ("pitch", (9.0, 4.6), lambda figure: drawing.pitch(figure, study)),
        ("axes-before-after", (11.0, 4.0), lambda figure: drawing.axes_before_after(figure, study.correction.axes)),
    )
    if study.drive is not None:
        drive, depth = study.drive.states, {name: _depth(study, name) for name in ("before", "after")}
        pictures += (("transmission", (11.0, 7.0), lambda figure: transmission_picture(figure, drive, depth)),)
    return tuple(write_sheet(folder / f"{name}.png", size, paint) for name, size, paint in pictures)


def _depth(study: Study, name: str) -> FloatArray:
    """Mean deviation by space (K,) of a state of the flank, um."""
    state = study.before if name == "before" else study.after
    return mm_to_um(np.asarray(state.deviation.mean(axis=(1, 2))))


def write_relative(grinding: Grinding, sweep: RelativeSweep, folder: Path) -> tuple[Path, ...]:
    """Draw the machine's frames and its six relative errors around the gear. Raises StoreError E-STUDY-WRITE."""
    turn, values, names = relative_lines(sweep)
    label = "direction of the space  deg"
    return (
        write_sheet(folder / "frames.png", (10.0, 5.0), lambda figure: machine_frames(figure, grinding.chain)),
        write_sheet(
            folder / "relative-errors.png",
            (9.0, 4.8),
            lambda figure: relative_curves(figure, label, turn, values, frame=sweep.frame, lines=names),
        ),
    )
