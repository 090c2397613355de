"""The nodes of a parsed block, and the error of a block that cannot be parsed."""

from __future__ import annotations

from dataclasses import dataclass


class NcSyntaxError(Exception):
    """A block that cannot be read: 1-based source line, reason, and the alarm the control would show."""

    def __init__(self, line: int, reason: str, number: int = 12080) -> None:
        super().__init__(line, reason, number)
        self.line = line
        self.reason = reason
        self.number = number


@dataclass(frozen=True, slots=True)
class Number:
    """A constant, INT or REAL."""

    value: int | float


@dataclass(frozen=True, slots=True)
class Text:
    """A string constant."""

    value: str


@dataclass(frozen=True, slots=True)
class Name:
    """A bare name in an expression or on the left: variable, R parameter, axis, TRUE, FALSE."""

    name: str


@dataclass(frozen=True, slots=True)
class Indexed:
    """A name with indices: array element, ``R[n]``, ``POS[X]``; ``$`` names carry their sign."""

    name: str
    indices: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Call:
    """A function call."""

    name: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Unary:
    """One operand: ``-``, ``+``, NOT, B_NOT, ``<<`` (to text)."""

    operator: str
    operand: Expression


@dataclass(frozen=True, slots=True)
class Binary:
    """Two operands."""

    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class ValueList:
    """A list of values on the right of an assignment."""

    items: tuple[Expression, ...]


Expression = Number | Text | Name | Indexed | Call | Unary | Binary | ValueList


@dataclass(frozen=True, slots=True)
class Address:
    """A DIN word: letter and number, as in G1, X-5, M30."""

    letter: str
    value: int | float


@dataclass(frozen=True, slots=True)
class BareWord:
    """A bare word: SUPA, STOPRE, NEWCONF, a subprogram's name."""

    name: str


@dataclass(frozen=True, slots=True)
class Procedure:
    """A call that stands alone: MSG, WRITE, SETAL, a subprogram with parameters."""

    name: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Assign:
    """``target = value``: variables, R parameters, ``$`` variables, axis words, F and S."""

    target: Name | Indexed
    value: Expression


@dataclass(frozen=True, slots=True)
class Jump:
    """GOTOF, GOTOB, GOTO or GOTOC to a label or block number."""

    kind: str
    label: str


Item = Address | BareWord | Procedure | Assign


@dataclass(frozen=True, slots=True)
class OrdinaryBlock:
    """An ordinary block: its words in order, and the jump at its end."""

    items: tuple[Item, ...]
    jump: Jump | None = None


@dataclass(frozen=True, slots=True)
class Control:
    """A line of a control structure: keyword, its condition or values, and FOR's variable."""

    keyword: str
    condition: Expression | None = None
    target: Name | Indexed | None = None
    start: Expression | None = None


@dataclass(frozen=True, slots=True)
class IfJump:
    """``IF condition GOTOx label``."""

    condition: Expression
    jump: Jump


@dataclass(frozen=True, slots=True)
class Case:
    """``CASE expression OF constant jump ... DEFAULT jump``."""

    selector: Expression
    arms: tuple[tuple[int | float, Jump], ...]
    default: Jump | None


@dataclass(frozen=True, slots=True)
class Declared:
    """One variable of a DEF: dimensions and initial value."""

    name: str
    dimensions: tuple[Expression, ...] = ()
    initial: Expression | None = None


@dataclass(frozen=True, slots=True)
class Define:
    """DEF: type, string length and the variables."""

    kind: str
    length: Expression | None
    variables: tuple[Declared, ...]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One formal parameter of a PROC."""

    kind: str
    name: str
    by_reference: bool
    default: Expression | None


@dataclass(frozen=True, slots=True)
class Proc:
    """PROC: the program's name and its formal parameters."""

    name: str
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True, slots=True)
class Extern:
    """EXTERN: a declaration that the control needs and the simulator only reads."""

    name: str


Block = OrdinaryBlock | Control | IfJump | Case | Define | Proc | Extern
