"""Where a person enters set-up values for the builder's own grinding and dressing programs, in words."""

from __future__ import annotations

from drivers.errors import words
from gateway.config import WorkSection
from gateway.tooth import SetupValues


def entered(work: WorkSection, setup: SetupValues) -> str:
    """Each value with its place, and how it is seen that this was done; our own programs take theirs by themselves."""
    places = {"x_entry": work.x_entry, "c_entry": work.c_entry, "dressing_entry": work.dressing_entry}
    values = {"x": setup.x_um, "c": setup.c_arcsec, "dressing": setup.dressing_um}
    return words("W-SETUP-ENTER", **places, **{key: f"{value:+.1f}" for key, value in values.items()})
