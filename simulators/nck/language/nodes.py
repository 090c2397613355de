"""What the parser found -> nodes of the language, built while the text is parsed, so nothing recurses afterwards.

A chain of comparisons is refused here (12180) where the control would silently compute something else.
"""

from __future__ import annotations

from typing import Any

from simulators.nck.language.syntax import (
    Address,
    Assign,
    BareWord,
    Binary,
    Block,
    Call,
    Case,
    Control,
    Declared,
    Define,
    Expression,
    Extern,
    IfJump,
    Indexed,
    Item,
    Jump,
    Name,
    Number,
    OrdinaryBlock,
    Parameter,
    Proc,
    Procedure,
    Text,
    Unary,
    ValueList,
)


class NodeRefused(Exception):
    """A node that cannot stand; carries reason and alarm number out of the parser's callbacks."""

    def __init__(self, reason: str, number: int = 12080) -> None:
        super().__init__(reason)
        self.reason = reason
        self.number = number


def _number(text: str) -> int | float:
    if text.isdecimal():
        value = int(text)
        if value < 2**31:
            return value
        return float(value)
    mantissa, _, power = text.partition("EX")
    if power and abs(int(power)) > 300:
        raise NodeRefused(f"{text} lies beyond the range of REAL", 12160)
    return float(f"{mantissa}e{power or 0}")


class Nodes:
    """One method for each rule of the grammar."""

    def words(self, items: list[Any]) -> OrdinaryBlock:
        jump = items.pop() if items else None
        return OrdinaryBlock(tuple(items), jump)

    def address(self, items: list[Any]) -> Item:
        text = str(items[0]).replace(" ", "")
        sign = -1 if text[1] == "-" else 1
        return Address(text[0], sign * _number(text[1:].lstrip("+-")))

    def bare(self, items: list[Any]) -> Item:
        return BareWord(str(items[0]))

    def procedure(self, items: list[Any]) -> Item:
        return Procedure(str(items[0]), items[1] or ())

    def assign(self, items: list[Any]) -> Item:
        return Assign(items[0], items[1])

    def jump(self, items: list[Any]) -> Jump:
        return Jump(str(items[0]), str(items[1]))

    def if_jump(self, items: list[Any]) -> Block:
        return IfJump(items[0], items[1])

    def conditional(self, items: list[Any]) -> Block:
        return Control(str(items[0]), condition=items[1])

    def structural(self, items: list[Any]) -> Block:
        return Control(str(items[0]))

    def counting(self, items: list[Any]) -> Block:
        return Control("FOR", condition=items[2], target=items[0], start=items[1])

    def case(self, items: list[Any]) -> Block:
        return Case(items[0], tuple(items[1:-1]), items[-1])

    def arm(self, items: list[Any]) -> tuple[int | float, Jump]:
        return items[0], items[1]

    def signed(self, items: list[Any]) -> int | float:
        value = _number(str(items[1]))
        return -value if items[0] else value

    def define(self, items: list[Any]) -> Block:
        return Define(str(items[0]), items[1], tuple(items[2:]))

    def declared(self, items: list[Any]) -> Declared:
        return Declared(str(items[0]), items[1] or (), items[2])

    def proc(self, items: list[Any]) -> Block:
        return Proc(str(items[0]), tuple(item for item in items if isinstance(item, Parameter)))

    def parameter(self, items: list[Any]) -> Parameter:
        return Parameter(str(items[1]), str(items[3]), items[0] is not None, items[4])

    def extern(self, items: list[Any]) -> Block:
        return Extern(str(items[0]))

    def kind(self, items: list[Any]) -> str:
        return str(items[1])

    def listing(self, items: list[Any]) -> Expression:
        return ValueList(tuple(items))

    def args(self, items: list[Any]) -> tuple[Expression, ...]:
        return tuple(items)

    def name(self, items: list[Any]) -> Name:
        return Name(str(items[0]))

    def indexed(self, items: list[Any]) -> Indexed:
        return Indexed(str(items[0]), items[1])

    def call(self, items: list[Any]) -> Expression:
        return Call(str(items[0]), items[1] or ())

    def number(self, items: list[Any]) -> Expression:
        return Number(_number(str(items[0])))

    def radix(self, items: list[Any]) -> Expression:
        """Raises NodeRefused for digits that the radix does not have."""
        text = str(items[0])
        try:
            return Number(int(text[2:-1], 16 if text[1] == "H" else 2))
        except ValueError as error:
            raise NodeRefused(f"{text} is no number") from error

    def text(self, items: list[Any]) -> Expression:
        return Text(str(items[0])[1:-1])

    def bracket(self, items: list[Any]) -> Expression:
        found: Expression = items[0]
        return found

    def unary(self, items: list[Any]) -> Expression:
        return Unary(str(items[0]), items[1])

    def binary(self, items: list[Any]) -> Expression:
        return Binary(str(items[1]), items[0], items[2])

    def expr_chain(self, _items: list[Any]) -> Expression:
        raise NodeRefused("comparisons bind last: put each in brackets", 12180)
