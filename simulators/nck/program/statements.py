"""Blocks as closures: each runs against a runner and says what is left to do in time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from simulators.nck.language.syntax import (
    Address,
    Assign,
    BareWord,
    Block,
    Call,
    Case,
    Control,
    Define,
    Expression,
    IfJump,
    Indexed,
    Item,
    Jump,
    Name,
    OrdinaryBlock,
    Proc,
    Procedure,
    ValueList,
)
from simulators.nck.program.block import POSITION_MODES, BlockAction, BlockWords
from simulators.nck.program.expressions import R_NAME, Evaluate, Scope, compile_expression
from simulators.nck.spec import NckRefusal
from simulators.nck.values import Value, compare, to_bool, to_number

Arguments = tuple[Evaluate, ...]


class Runner(Scope, Protocol):
    """What blocks may ask of the interpreter."""

    def block_words(self) -> BlockWords:
        """An empty collection for this block."""
        ...

    def assign(self, name: str, indices: tuple[Value, ...], value: Value) -> None:
        """Assign to a variable. Raises NckRefusal."""
        ...

    def is_local(self, name: str) -> bool:
        """Whether a local variable of that name exists."""
        ...

    def axis_of(self, name: str, indices: tuple[Value, ...]) -> int | None:
        """The axis a word on the left of ``=`` moves (X, X1, POS[X], or an AXIS variable), if any."""
        ...

    def jump(self, jump: Jump) -> None:
        """Go on at a label. Raises NckRefusal 14080."""
        ...

    def go(self, line: int) -> None:
        """Go on at a line (from 0)."""
        ...

    def partner(self) -> int:
        """The line this line's structure leads to."""
        ...

    def word(self, name: str) -> str:
        """A bare word: NEWCONF, RET, a subprogram. Returns the ending it means, if any."""
        ...

    def procedure(self, name: str, arguments: tuple[Expression, ...], given: Arguments) -> None:
        """A call that stands alone."""
        ...

    def define(self, node: Define) -> None:
        """DEF."""
        ...

    def enter(self, node: Proc) -> None:
        """PROC: bind the parameters."""
        ...

    def fill(self, name: str, places: tuple[Value, ...], values: list[Value], *, repeat: bool) -> None:
        """Assign a list to an array from an element on, or from its first where no place is given."""
        ...


Step = Callable[[Runner], BlockAction | None]
_Act = Callable[[Runner, BlockWords], None]

_NO_ACT = frozenset({"REPEAT", "LOOP", "ENDIF"})


def prepare_block(block: Block, head: Block | None = None) -> Step:
    """The closure of a block; ``head`` is the block an ENDFOR belongs to.

    Raises NckRefusal for what can be seen without running.
    """
    if isinstance(block, OrdinaryBlock):
        return _words(block)
    if isinstance(block, Control):
        return _end_for(head) if block.keyword == "ENDFOR" else _control(block)
    if isinstance(block, IfJump):
        return _if_jump(block)
    if isinstance(block, Case):
        return _case(block)
    if isinstance(block, Define):
        return lambda runner: runner.define(block)
    if isinstance(block, Proc):
        return lambda runner: runner.enter(block)
    return lambda _runner: None


# -- control structures --------------------------------------------------------------------------------


def _control(block: Control) -> Step:
    keyword = block.keyword
    if keyword == "FOR":
        return _for(block)
    if keyword in ("ENDWHILE", "ENDLOOP"):
        return lambda runner: runner.go(runner.partner())
    if keyword == "ELSE":
        return lambda runner: runner.go(runner.partner() + 1)
    if keyword in _NO_ACT or block.condition is None:
        return lambda _runner: None
    condition = compile_expression(block.condition)
    if keyword == "UNTIL":
        return lambda runner: None if to_bool(condition(runner)) else runner.go(runner.partner())
    return lambda runner: None if to_bool(condition(runner)) else runner.go(runner.partner() + 1)


def _counter(block: Block | None) -> tuple[str, Arguments, Evaluate, Evaluate]:
    if not isinstance(block, Control) or not (block.target and block.start and block.condition):
        raise NckRefusal(12640, "ENDFOR without FOR")
    name, indices = _target(block.target)
    return name, indices, compile_expression(block.start), compile_expression(block.condition)


def _for(block: Control) -> Step:
    name, indices, start, end = _counter(block)

    def step(runner: Runner) -> BlockAction | None:
        places = tuple([index(runner) for index in indices])
        runner.assign(name, places, start(runner))
        if compare(">", to_number(runner.variable(name, places)), to_number(end(runner))):
            runner.go(runner.partner() + 1)
        return None

    return step


def _end_for(head: Block | None) -> Step:
    name, indices, _, end = _counter(head)

    def step(runner: Runner) -> BlockAction | None:
        places = tuple([index(runner) for index in indices])
        runner.assign(name, places, to_number(runner.variable(name, places)) + 1)
        if compare("<=", to_number(runner.variable(name, places)), to_number(end(runner))):
            runner.go(runner.partner() + 1)
        return None

    return step


def _if_jump(block: IfJump) -> Step:
    condition, jump = compile_expression(block.condition), block.jump
    return lambda runner: runner.jump(jump) if to_bool(condition(runner)) else None


def _case(block: Case) -> Step:
    selector = compile_expression(block.selector)

    def step(runner: Runner) -> BlockAction | None:
        value = to_number(selector(runner))
        hits = (jump for constant, jump in block.arms if compare("==", value, constant))
        chosen = next(hits, block.default)
        if chosen is not None:
            runner.jump(chosen)
        return None

    return step


# -- ordinary blocks -----------------------------------------------------------------------------------


def _words(block: OrdinaryBlock) -> Step:
    acts = [_act(item) for item in block.items]
    jump = block.jump

    def step(runner: Runner) -> BlockAction | None:
        words = runner.block_words()
        for act in acts:
            act(runner, words)
        if jump is not None:
            runner.jump(jump)
        return words.finish()

    return step


def _act(item: Item) -> _Act:
    if isinstance(item, Address):
        return _address(item)
    if isinstance(item, BareWord):
        name = item.name
        return lambda runner, words: None if words.word(name) else words.end(runner.word(name))
    if isinstance(item, Procedure):
        return _procedure(item)
    return _assign(item)


def _address(item: Address) -> _Act:
    letter, value = item.letter, item.value
    if letter == "L":
        name = f"L{value:g}"
        return lambda runner, words: words.end(runner.word(name))
    return lambda _runner, words: words.address(letter, value)


def _procedure(item: Procedure) -> _Act:
    given = tuple(compile_expression(argument) for argument in item.arguments)
    return lambda runner, _words: runner.procedure(item.name, item.arguments, given)


def _target(node: Name | Indexed) -> tuple[str, Arguments]:
    if isinstance(node, Indexed):
        return node.name, tuple(compile_expression(index) for index in node.indices)
    r_name = R_NAME.fullmatch(node.name)
    if r_name is not None:
        index = int(r_name[1])
        return "R", (lambda _scope: index,)
    return node.name, ()


def _assign(item: Assign) -> _Act:
    name, indices = _target(item.target)
    node = item.value
    if isinstance(node, ValueList):
        return _fill(name, indices, node.items, repeat=False)
    if isinstance(node, Call) and node.name in ("SET", "REP"):
        return _fill(name, indices, node.arguments, repeat=node.name == "REP")
    if isinstance(node, Call) and node.name in POSITION_MODES and len(node.arguments) == 1:
        return _position(name, indices, node.name, compile_expression(node.arguments[0]))
    value = compile_expression(node)
    if name == "R" or name.startswith("$"):
        return _plain(name, indices, value)
    return _word_or_variable(name, indices, value)


def _plain(name: str, indices: Arguments, value: Evaluate) -> _Act:
    def act(runner: Runner, _words: BlockWords) -> None:
        runner.assign(name, tuple([index(runner) for index in indices]), value(runner))

    return act


def _fill(name: str, indices: Arguments, items: tuple[Expression, ...], *, repeat: bool) -> _Act:
    values = [compile_expression(item) for item in items]

    def act(runner: Runner, _words: BlockWords) -> None:
        places = tuple([index(runner) for index in indices])
        runner.fill(name, places, [value(runner) for value in values], repeat=repeat)

    return act


def _position(name: str, indices: Arguments, mode: str, value: Evaluate) -> _Act:
    def act(runner: Runner, words: BlockWords) -> None:
        axis = runner.axis_of(name, tuple([index(runner) for index in indices]))
        if axis is None:
            raise NckRefusal(12550, f"{mode}() stands with an axis, not with {name}")
        words.position(axis, mode, float(to_number(value(runner))))

    return act


def _word_or_variable(name: str, indices: Arguments, value: Evaluate) -> _Act:
    letter = name[0] if len(name) == 1 or (name[1:].isdecimal() and name[0] in "MSTH") else ""

    def act(runner: Runner, words: BlockWords) -> None:
        places = tuple([index(runner) for index in indices])
        if not runner.is_local(name):
            axis = runner.axis_of(name, places)
            if axis is not None:
                words.position(axis, "", float(to_number(value(runner))))
                return
            if letter and letter in "GFMSTDH":
                words.address(letter, float(to_number(value(runner))))
                return
        runner.assign(name, places, value(runner))

    return act
