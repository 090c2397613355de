"""Names of the stages in a run folder: one place for what is stored under which word."""

from __future__ import annotations

from typing import Literal

from drivers.message import words
from drivers.types.results import MeasuredSet

Phase = Literal["before", "after", "acting"]
"""Before and after an axis' own table, and with every table acting."""

EQUIPMENT = "equipment"
PROPOSAL = "proposal"
VERDICT = "verdict"
ERRORS = "errors"
GUARD = "guard"
AGREEMENT = "part-agreement"
TOOTH = "tooth"
TOOTH_VERDICT = "tooth-verdict"
FROM_GEAR = "from-gear"
CARRIED = "carried-push"
CYCLE = "builder-cycle"
ORDER, WHEEL_VERDICT, UNEXPLAINED = "corrections", "wheel-verdict", "unexplained"
STATED = "stated"
MEASURED, GEAR, DYNAMIC = "measured", "gear-inspection", "dynamic"
"""What an imported file was."""


def raw(axis: str, phase: Phase) -> str:
    """Averages as the instrument gave them."""
    return f"raw-{axis}-{phase}"


def capture(axis: str, phase: Phase) -> str:
    """Corrected deviations."""
    return f"capture-{axis}-{phase}"


def evaluation(axis: str, phase: Phase) -> str:
    """ISO 230-2 results."""
    return f"evaluation-{axis}-{phase}"


def acting(axis: str) -> str:
    """What a short capture said of an axis with every table acting."""
    return f"acting-{axis}"


def component(axis: str) -> str:
    """The fitted error motion."""
    return f"component-{axis}"


def hidden(axis: str) -> str:
    """What the check stops say of structure between the targets."""
    return f"hidden-{axis}"


def push(axis: str) -> str:
    """What a push did."""
    return f"push-{axis}"


def setup(key: str) -> str:
    """One set-up's corrected deviations."""
    return f"setup-{key}"


def setup_raw(key: str) -> str:
    """One set-up's averages as the instrument gave them."""
    return f"setup-{key}-raw"


def setup_proof(key: str) -> str:
    """How a set-up's mounting was proved."""
    return f"setup-{key}-proof"


def ground(part: str) -> str:
    """A part ground through the control; parts are called "before", "trial", "after" or as people say."""
    return f"ground-{part}"


def inspected(part: str) -> str:
    """The flanks of a part as an inspection machine found them."""
    return f"inspected-{part}"


def inspected_raw(part: str) -> str:
    """The points of that inspection as the machine or a file gave them."""
    return f"inspected-{part}-raw"


def separated(part: str) -> str:
    """The deviations of an inspected part by cause."""
    return f"separated-{part}"


def handed(part: str) -> str:
    """The set-up values handed over to the builder's cycle after this part."""
    return f"handed-{part}"


# Whether a double stood in for the machine or an instrument, by the words of a result file.

DOUBLE = "simulated"
SAID = words("S-RUN-SIMULATED")


def simulated_set(measured: MeasuredSet) -> bool:
    """Whether a result file's own words name a double, as every file that is exported from such a run does."""
    return any(DOUBLE in text.lower() for text in measured.header.values())
