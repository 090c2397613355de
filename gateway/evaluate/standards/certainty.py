"""How sure we are of a standard's formulas, in the words that stand beside every result."""

from __future__ import annotations

from typing import Final, Literal

Certainty = Literal["from the text of the standard", "from secondary sources", "recalled"]

FROM_TEXT: Final = "from the text of the standard"
SECONDARY: Final = "from secondary sources"
RECALLED: Final = "recalled"
