"""What a command speaks of: kinds, one table, its parameters, and the codes it may end with."""

from __future__ import annotations

from dataclasses import dataclass

EEC, CEC, BACKLASH_KIND, TEMPERATURE = 1, 2, 3, 4
NO_CRC, OUT_OF_ORDER, LENGTH, RANGE, NOT_RELEASED, NOT_IN_RESET, PROTECTED, TOO_MANY, UNKNOWN = range(1, 10)
DIFFERS, NCK_REFUSED, TIME_OVER, NO_SESSION, TAKEN = range(10, 15)

INEXPRESSIBLE = 1 << 15


class PlcFault(Exception):
    """A command ends with this error code and detail."""

    def __init__(self, code: int, detail: int = 0) -> None:
        super().__init__(code, detail)
        self.code = code
        self.detail = detail


@dataclass(frozen=True, slots=True)
class Target:
    """One table or set of data: kind, axis number or table t, encoder, and the axis it is looked at by."""

    kind: int
    index: int
    encoder: int
    axis: int

    @property
    def table(self) -> tuple[int, int, int]:
        """What identifies the table itself."""
        return (self.kind, self.index, self.encoder if self.kind != CEC else 0)


@dataclass(frozen=True, slots=True)
class Parameters:
    """A table's parameters in mailbox units; ``flags`` as register 356, axes by number (0: none yet)."""

    flags: int
    minimum: int
    step: int
    maximum: int
    input_axis: int
    output_axis: int
    factor: int
