"""The picture of an inspected part: its flanks unrolled, in the run folder beside the record."""

from __future__ import annotations

from pathlib import Path

from gateway.domain.values import COVERAGE
from gateway.report.drawings.flank import flank_maps
from gateway.report.drawings.plots import png
from gateway.report.tooth.flank import FlankState
from gateway.tooth import FlankMap, InspectedFlank

SIZE_INCH = (9.0, 2.4)


def draw_flank(flank: InspectedFlank, folder: Path) -> Path:
    """Write ``flank-<part>.png`` into a run's folder. Raises StoreError (E-REPORT-WRITE)."""
    path, found = folder / f"flank-{flank.part}.png", [_state(flank.part, flank.fitted, COVERAGE * flank.rms_u_um)]
    png(SIZE_INCH, lambda figure: flank_maps(figure, found), path)
    return path


def _state(part: str, flank: FlankMap, U: float) -> FlankState:
    return FlankState(
        key=part, title=f"part {part}", source="inspected", map=flank, rms=flank.rms_um, largest=flank.largest_um, U=U
    )
