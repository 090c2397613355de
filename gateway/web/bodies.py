"""What callers may send: small, closed records; what is unknown or of another kind is refused unread."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from gateway.users import MOST_TOKEN_DAYS, TOKEN_DAYS, UserRole

Text = Annotated[str, Field(max_length=200)]
Secret = Annotated[str, Field(max_length=200, json_schema_extra={"format": "password"})]


class Body(BaseModel):
    """Nothing unknown, nothing infinite, no long text."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, strict=True, str_max_length=2000, hide_input_in_errors=True
    )


class SignIn(Body):
    """Who signs in, with a password or a PIN; ``code`` is the second factor's, where the account has one."""

    name: Text
    password: Secret = ""
    pin: Secret = ""
    code: Secret = ""


class OwnSecret(Body):
    """A person's own new password or PIN, proved by the old one (and by the code of the second factor)."""

    old: SignIn
    password: Secret = ""
    pin: Secret = ""


class OwnFactor(Body):
    """A second factor that ``code`` is of, or none (``secret`` ""), proved by the password or PIN, and the old code."""

    proof: SignIn
    secret: Secret = ""
    code: Secret = ""


class TokenBody(Body):
    """A program's token that ends after so many days."""

    days: Annotated[int, Field(ge=1, le=MOST_TOKEN_DAYS)] = TOKEN_DAYS


class FirstStart(Body):
    """The first account, made with the token that the service wrote into the folder of the runs."""

    token: Secret
    name: Text
    password: Secret


class UserBody(Body):
    """An account: secrets that are left empty stay as they are.

    ``system`` are the person's names at operating systems; left out they stay. ``forget_factor`` takes the second
    factor away, for a person who has lost it.
    """

    roles: Annotated[list[UserRole], Field(min_length=1, max_length=4)]
    password: Secret = ""
    pin: Secret = ""
    system: Annotated[list[Text], Field(max_length=10)] | None = None
    forget_factor: bool = False


class SiteAnswers(Body):
    """What was answered so far, by the questions' keys; ``anew`` asks the control again."""

    answers: Annotated[dict[Text, Secret], Field(max_length=40)] = {}
    anew: bool = False


class Thumbprint(Body):
    """SHA-256 or SHA-1 of a certificate, whole, as the control's own display shows it."""

    thumbprint: Text


class Plain(Body):
    """A command that takes nothing."""


class Measure(Body):
    """Which set-ups or components (empty: all of the plan), and which run to go on with ("": a new one)."""

    setups: Annotated[list[Text], Field(max_length=500)] = []
    resume: Text = ""


class Close(Body):
    """The whole loop; it only proposes unless ``apply`` is set and ``machine`` is the machine's name, typed.

    ``risk`` as in a push. ``keep_worse`` leaves the new tables on where the flank became worse; else they go back.
    """

    apply: bool = False
    machine: Text = ""
    risk: Text = ""
    resume: Text = ""
    keep_worse: bool = False


class OfRun(Body):
    """A stored run by its id."""

    run: Text


class Push(OfRun):
    """A run's proposal into the control; ``machine`` is the machine's name, typed. Without ``apply`` it is shown.

    ``risk`` "unprotected" is typed by one person alone where the connection to the control is unprotected.
    """

    apply: bool = False
    machine: Text = ""
    risk: Text = ""


class Disable(Body):
    """One table off: ``table`` "" is the axis' own."""

    axis: Text
    table: Text = ""
    apply: bool = False
    machine: Text = ""


class RollBack(Body):
    """What the last consent changed taken back: of an axis, of one table, or ("") all of it."""

    table: Text = ""
    apply: bool = False
    machine: Text = ""


class Recover(Body):
    """What an interrupted push left; with ``apply`` it is put right.

    ``choice`` says whether an interrupted rollback is finished (the earlier tables act) or undone (the pushed ones do).
    """

    choice: Literal["offered", "finish", "undo"] = "offered"
    apply: bool = False
    machine: Text = ""


class Verify(Body):
    """The live tables, or one, against what was pushed, or against a run's proposal."""

    table: Text = ""
    run: Text = ""


class SelfTestAsked(Body):
    """The self-test of all axes, or of one."""

    axis: Text = ""


class Approve(Body):
    """Consent to a run's tables, or to one of them; ``machine`` is the machine's name, typed.

    ``by`` is the person who agrees, where it is not the one who is signed in; their session is not touched.
    """

    machine: Text
    table: Text = ""
    by: SignIn | None = None


class Note(Body):
    """A word for those who come after, kept for good."""

    text: Annotated[str, Field(min_length=1, max_length=2000)]


class MountingConfirmed(Body):
    """A set-up is mounted as its drawing shows; ``text`` may say what was odd."""

    setup: Text
    text: Text = ""


class RetakeAsked(Body):
    """A reading of the run at work to be taken again; ``repetition`` counts from 1, 0 means all of them."""

    axis: Text
    target: float
    approach: Literal[1, -1]
    repetition: Annotated[int, Field(ge=0, le=50)] = 0
