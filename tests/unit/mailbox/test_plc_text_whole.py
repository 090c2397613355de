"""The text of docs/plc run as a whole against the simulated PLC: the same codes, the same status, the same tables."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from tests.sizes import few
from tests.unit.mailbox.plant import FOLDER, ORDER, library
from tests.unit.mailbox.sidebyside import (
    ACTIVATE,
    AXES,
    BEGIN,
    CHUNK,
    DISABLE,
    DONE,
    FAILED,
    OPEN,
    READ,
    SELECT,
    VERIFY,
    WAITING,
    Pair,
    crc,
    moving,
    side_by_side,
)
from tests.unit.mailbox.structured import LeftItsType, Library, Unsound

SEEDS = few([("one", 350, False), ("two", 350, True), ("four", 1000, False), ("four", 1000, True)])
SOAK = [pytest.param(f"soak {number}", 1000, bool(number % 2), marks=pytest.mark.soak) for number in range(20)]
USUAL = {0, 1, 2, 3, 4, 6, 7, 8, 9, 13, 14}


@pytest.mark.parametrize(("seed", "count", "low_first"), [*SEEDS, *SOAK])
def test_random_commands_end_alike_at_the_text_and_at_the_double(seed: str, count: int, low_first: bool) -> None:
    seen = side_by_side(library(), seed, count, low_first=low_first)
    codes: Counter[int] = Counter()
    for (_, code), often in seen.items():
        codes[code] += often
    assert set(codes) >= USUAL | ({5, 10} if count >= 1000 else set()), codes
    assert all(seen[command, 0] >= 3 for command in (BEGIN, CHUNK, VERIFY, ACTIVATE, DISABLE, READ, SELECT)), seen
    assert codes[0] > count // 3


def test_an_activation_that_nobody_confirms_ends_alike() -> None:
    """Error 12 after 60 s: too rare among random commands to be met in each thousand of them."""
    seen = side_by_side(library(), "nobody", 60, low_first=False, fates={"nobody": 1})
    assert seen[ACTIVATE, 12] >= 3, seen


async def test_a_disable_while_the_channel_runs_that_nobody_confirms_ends_alike() -> None:
    entry = [1, 1, 0, 1, 0, *[0] * 95]
    async with Pair(library(), "nobody") as pair:
        heads = ([OPEN, 1, 0, 1, *[0] * 14], [DISABLE, 2, 0, 0, 0, 0x40, *[0] * 8, 1, *[0] * 3])
        pair.write(heads[0], [], crc(heads[0]))
        await pair.until(1, DONE)
        await pair.released()
        pair.each(moving)
        await pair.pass_seconds(0.5)
        pair.write(heads[1], entry, crc([*heads[1], *entry]))
        await pair.until(2, WAITING)
        assert pair.difference() == {}
        await pair.pass_seconds(61.0)
        assert pair.states()[0][0] & FAILED
        assert (pair.text.registers[7], pair.difference()) == (12, {})


CONTROLS: list[tuple[str, dict[str, object], int, int]] = [
    ("keeps tables in single precision", {"float32_tables": True}, 80, 10),
    ("has no option for cross tables", {"option_cec": False}, 300, 11),
    ("counts in inches", {"unit_system": "inch"}, 300, 0),
    ("lets tables act after a reset alone", {"activation": "nck_reset", "strict_activation": True}, 300, 0),
]


@pytest.mark.parametrize(("spec", "count", "code"), few([case[1:] for case in CONTROLS], 1))
def test_other_controls_are_told_alike(spec: dict[str, object], count: int, code: int) -> None:
    """What does not come back as written is error 10 with the same point, what the control refuses error 11."""
    seen = side_by_side(library(), "a", count, low_first=False, **spec)
    assert sum(often for (_, found), often in seen.items() if found == code) >= 3, seen


MUTANTS = {
    "a refused table is shown": (
        "AND (Job.TableKind = SelKind) AND (Job.Index = SelIndex)",
        "AND (Job.Index = Job.Index)",
    ),
    "the session outlives silence": ("TF_SESSION_TIME : TIME := T#5s", "TF_SESSION_TIME : TIME := T#50s"),
    "no zeros above the table": ("Job.Points[I] := 0;", "Job.Points[I] := Answer.Points[I];"),
    "a half-written table is activated": (
        "IF OutOfTurn AND (Error = TF_ERR_NONE) THEN",
        "IF FALSE THEN",
    ),
    "a pressed button is enough": ("Pressed := Answer.Confirm AND NOT LastConfirm;", "Pressed := TRUE;"),
    "the data of a marker are not covered": (
        "IF (Command = TF_CMD_CHUNK) OR (Command = TF_CMD_MARKER) OR",
        "IF (Command = TF_CMD_CHUNK) OR",
    ),
    "a release from before the session counts": ("Answer.Release AND NOT LastRelease THEN", "Answer.Release THEN"),
    "a backlash that was not loaded is switched on": (
        "OutOfTurn := HalfBack[Place] OR NOT BackReady[Place];",
        "OutOfTurn := FALSE;",
    ),
    "a step that divides is asked for": ("(Span - Covered >= DINT_TO_LINT(Width))", "(Span <> Covered)"),
    "the entries are taken as they stand at the end": (
        "Job.Index := WORD_TO_INT(Data[Spot + 1]);",
        "Job.Index := WORD_TO_INT(R[TF_DATA + Spot + 1]);",
    ),
}


@pytest.mark.parametrize("name", few(MUTANTS, 1))
def test_a_text_that_does_otherwise_is_found_out(name: str) -> None:
    """The comparison has teeth: each of these changes is seen."""
    texts = [(FOLDER / f"{one}.st").read_text(encoding="utf-8") for one in ORDER]
    right, wrong = MUTANTS[name]
    assert sum(text.count(right) for text in texts[-2:]) == 1
    other = Library(texts=(*texts[:-2], *(text.replace(right, wrong) for text in texts[-2:])))
    with pytest.raises(AssertionError):
        side_by_side(other, "one", 400, low_first=False)


async def test_a_number_without_an_axis_is_unknown_to_both() -> None:
    axes = (AXES[0], replace(AXES[2], number=3))
    async with Pair(library(), "gaps", axes=axes) as pair:
        for number, (kind, index, output), code in ((1, (1, 2, 0), 9), (2, (2, 0, 2), 9), (3, (1, 3, 0), 0)):
            head = [SELECT, number, kind, index, *[0] * 12, output, 0]
            pair.write(head, [], crc(head))
            await pair.until(number, DONE | FAILED)
            assert pair.text.registers[7] == code
            assert pair.difference() == {}
        assert pair.text.registers[349] == 3
        assert pair.text.registers[332] == 0x4331  # C1


HEAD = "FUNCTION TF_A : INT\nVAR_INPUT\n  A : INT;\n  W : WORD;\n  B : BOOL;\nEND_VAR\nVAR\n  I : INT;\nEND_VAR\n"
UNSOUND = {
    "I := W;": "INT expected, WORD found",
    "I := 40000;": "is no INT",
    "A := 1;": "not to be written",
    "i := 1;": "declared as I",
    "J := 1;": "not declared",
    "I := A AND 1;": "does not go with INT",
    "I := SEL(B, 1, 2, 3);": "no function SEL",
    "I := WORD_TO_DINT(W);": "INT expected, DINT found",
    "I := TF_A(A := 1);": "no function TF_A",
    "IF A THEN I := 1; END_IF;": "no INT",
    "I := 1": "expected",
    "I := 1 // 2;": "expected",
    "I := A[1];": "no elements",
    "FOR I := 0 TO W DO I := I; END_FOR;": "INT expected, WORD found",
    "I = 1;": ":= expected",
    "END_FUNCTION FUNCTION TF_A : INT ;": "declared twice",
}


@pytest.mark.parametrize("body", UNSOUND)
def test_the_reader_is_strict(body: str) -> None:
    Library(texts=(f"{HEAD}  I := A; TF_A := I;\nEND_FUNCTION\n",))
    with pytest.raises(Unsound, match=UNSOUND[body]):
        Library(texts=(f"{HEAD}  {body}\nEND_FUNCTION\n",))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("TYPE TF_S : STRUCT\n A : INT;\nEND_STRUCT\nEND_TYPE", "; expected"),
        ("TYPE TF_S : STRUCT\n Step : INT;\nEND_STRUCT;\nEND_TYPE", "Step is no name"),
        ("FUNCTION TF_F : INT\nVAR_INPUT\n A : ARRAY[0..3] OF INT;\nEND_VAR\n;END_FUNCTION", "no type ARRAY"),
        ("VAR_GLOBAL CONSTANT\n A : INT := 1;\nEND_VAR", "outside every unit"),
        ("FUNCTION TF_F : INT\n TF_F := TF_G(A := 1);\nEND_FUNCTION", "no function TF_G"),
        ("TYPE TF_T : ARRAY[0..3] OF TF_LATER;\nEND_TYPE", "no type TF_LATER"),
    ],
)
def test_the_reader_asks_what_a_strict_compiler_asks(text: str, why: str) -> None:
    with pytest.raises(Unsound, match=why):
        Library(texts=(text,))


def test_no_number_leaves_its_type_unseen() -> None:
    types = "TYPE TF_R : ARRAY[0..3] OF INT;\nEND_TYPE\n"
    made = Library(
        texts=(
            types,
            "FUNCTION TF_F : INT\nVAR_INPUT\n A : INT;\nEND_VAR\nVAR_IN_OUT\n R : TF_R;\nEND_VAR\n"
            "TF_F := R[A] + 1;\nEND_FUNCTION",
        )
    )
    assert made.call("TF_F", {"A": 3, "R": [1, 2, 3, 4]}) == 5
    with pytest.raises(LeftItsType, match="index 4"):
        made.call("TF_F", {"A": 4, "R": [1, 2, 3, 4]})
    with pytest.raises(LeftItsType, match="index -1"):
        made.call("TF_F", {"A": -1, "R": [1, 2, 3, 4]})
    with pytest.raises(LeftItsType, match="32768"):
        made.call("TF_F", {"A": 0, "R": [32767, 2, 3, 4]})
