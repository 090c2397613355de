"""The gateway's own exceptions, sorted by who must act; messages come from the drivers' catalogue."""

from __future__ import annotations

from drivers.errors import ConfigError, TrueflankError


class CaptureError(TrueflankError):
    """The measurement itself is not good enough; the operator must look at the set-up."""

    exit_code = 6


class Incomplete(CaptureError):
    """Targets are missing."""


class Unstable(CaptureError):
    """A reading never settled inside its window."""


class NotMoved(Unstable):
    """The stream never left the value of the previous stop."""


class Scattering(Unstable):
    """The readings of a window scatter or drift by more than is allowed."""


class AmbientOutOfRange(CaptureError):
    """Temperature, pressure or humidity is missing or impossible."""


class ModelError(TrueflankError):
    """The numbers do not allow what was asked of them."""

    exit_code = 7


class NotIdentifiable(ModelError):
    """The data cannot separate what was asked for."""


class WriteRefused(TrueflankError):
    """Nothing was written; every reason at once is in the fields."""

    exit_code = 8


class VerifyError(TrueflankError):
    """The controller does not hold what was written; the difference is in the fields."""

    exit_code = 9


class RollbackFailed(TrueflankError):
    """The old table could not be restored by itself; the back-up's place is in the fields."""

    exit_code = 9


class Unexpected(TrueflankError):
    """Something failed that nobody foresaw: ours to correct; its kind and words are in the fields."""


class StillOn(RollbackFailed):
    """Held, and no read-back says that the table is off: something acts that nobody stands for."""

    exit_code = 12


class InDoubt(TrueflankError):
    """Readings leave a doubt so large that neither a verdict nor a table comes of them; who measured must settle it."""

    exit_code = 21


class BusyError(TrueflankError):
    """One run at a time."""

    exit_code = 10


class IllegalTransition(TrueflankError):
    """The run is not in a state from which this may be done."""

    exit_code = 10


class StoreError(TrueflankError):
    """The run store cannot be read or written."""

    exit_code = 11


class UnknownRun(ConfigError, StoreError):
    """A run that was asked for is not there, or has not what the command needs: who typed it must name another one."""


class CorruptRecord(StoreError):
    """A stored record does not match its hash."""


class FutureSchema(StoreError):
    """A stored record was written by a newer program."""


class CarryFirst(TrueflankError):
    """Nothing failed: a program must be carried to the control and run there before the work can go on."""

    exit_code = 15


class SignInRefused(TrueflankError):
    """Who asks is not known, has not the role, or tried too often; they must sign in, or somebody else must ask."""

    exit_code = 14


class NotSignedIn(SignInRefused):
    """Who asks is not known: no secret, or a wrong one."""


class CodeAsked(NotSignedIn):
    """The secret is right, and the account has a second factor: its code is missing, wrong or used up."""


class TooManyTries(SignInRefused):
    """Wrong secrets came too fast from there; the fields say how long to wait."""


class NotFound(TrueflankError):
    """What was asked for by name is not there."""


class InvalidRequest(TrueflankError):
    """What was handed over is not what can be taken; the fields say what can."""


class RecordNotFound(StoreError, NotFound):
    """The store has no record or file of this name."""


class InvalidAccount(StoreError, InvalidRequest):
    """An account that the rules for names, roles and secrets do not allow."""


class LastAdministrator(StoreError):
    """Without this account nobody could keep the others."""


class InvalidOption(ConfigError, InvalidRequest):
    """An option or an answer that is none of those that can be taken."""
