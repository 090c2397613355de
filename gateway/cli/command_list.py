"""The commands as typer sees them: each is loaded when it is chosen, so that the list of all of them is quick.

`order.toml` names each command with its function, its purpose and its examples. `CommandTable` is the dictionary of
commands that click asks; it imports a module when a command is looked up, so `--help` of the whole program imports
none. An entry with `inner` is a group; with a `place` of its own as well (`GroupWithDefault`) it is a command whose
first word may be one of its sub-commands: `trueflank doctor site.toml`, `trueflank doctor devices site.toml`. A name of
a former version is refused with the line that is typed today. The second half refuses options that a mode of a command
cannot use.
"""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command_from_info
from typer.models import CommandInfo

from drivers.errors import ConfigError, UnsupportedDevice
from drivers.message import words
from gateway.cli import output
from gateway.cli.output import remember_site

CommandEntry = Mapping[str, Any]
FIRST_EXAMPLES = ("trueflank demo", "trueflank init", "trueflank run --help")
CONTEXT_SETTINGS = {"max_content_width": 100}


@cache
def _order() -> Mapping[str, Any]:
    return tomllib.loads(Path(__file__).with_name("order.toml").read_text(encoding="utf-8"))


def command_groups() -> tuple[CommandEntry, ...]:
    """Groups in the order of the work, each {"title", "commands": {name: {"place", "words", "examples", "inner"}}}."""
    return tuple(_order()["groups"])


def renamed_commands() -> Mapping[str, str]:
    """Words of former versions and the words of today; the first of several that fit counts."""
    renamed: Mapping[str, str] = _order()["renamed"]
    return renamed


def command_entries() -> dict[str, CommandEntry]:
    """Every command of the first floor by its name, in the order of the work."""
    return {name: entry for group in command_groups() for name, entry in group["commands"].items()}


class CommandTable(dict[str, Any]):
    """Commands by name; one that is asked for is loaded and kept."""

    def __init__(self, known: Mapping[str, CommandEntry]) -> None:
        super().__init__(dict.fromkeys(known))
        self._known = known

    def __getitem__(self, name: str) -> Any:
        """The command. Raises KeyError."""
        if super().__getitem__(name) is None:
            self[name] = load_command(name, self._known[name])
        return super().__getitem__(name)

    def get(self, name: str, default: Any = None) -> Any:
        """The command, or ``default`` where there is none of this name."""
        return self[name] if name in self else default  # noqa: SIM401 - `get` of a dict would not load it

    def items(self) -> Any:
        """Names with their commands, all of them loaded."""
        return [(name, self[name]) for name in self]


class CommandWithExamples(TyperCommand):
    """A command whose help ends with its examples."""

    examples: tuple[str, ...] = ()

    def invoke(self, ctx: Any) -> Any:
        """The command, and from now on its texts know its site file.

        Where one fact of the machine is another than it was, a person is asked, and it begins again.
        """
        remember_site(ctx.params)
        with current_command(ctx):
            try:
                return super().invoke(ctx)
            except UnsupportedDevice as error:
                from gateway.cli.machine.identity import accept_changed_fact

                if not accept_changed_fact(error, ctx.params):
                    raise
            return super().invoke(ctx)

    def format_epilog(self, _ctx: Any, formatter: Any) -> None:
        """The examples, one a line as they are typed."""
        write_examples(formatter, self.examples)


class GroupWithDefault(CommandWithExamples):
    """A command that has sub-commands: it is done itself where the first word is none of them."""

    inner: CommandEntry
    commands: Mapping[str, Any]

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """The context of the sub-command that the first word names, else of the command itself.

        Whoever calls this invokes the command of the context, so nothing else need know that a group is one.
        """
        if not args or args[0] not in self.commands:
            return super().make_context(info_name, args, parent=parent, **extra)
        # Stands for the group in the usage line: the group's own arguments are none of its sub-commands'.
        outer = self.context_class(TyperCommand(info_name), info_name=info_name, parent=parent)
        return self.commands[args[0]].make_context(args[0], args[1:], parent=outer, **extra)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """The sub-commands first, then the options of the command itself."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry["words"]) for name, entry in self.inner.items()])
            first = next(iter(self.inner))
            formatter.write_text(words("S-CLI-ELSE-FOR", command_path=ctx.command_path, first=first))
        super().format_options(ctx, formatter)


class CommandList(TyperGroup):
    """A group whose help lists its commands without loading one; the first floor's in groups."""

    examples: tuple[str, ...] = ()
    floor: tuple[CommandEntry, ...] = ()

    def __init__(self, **asked: Any) -> None:
        super().__init__(**asked)
        if not self.commands:
            self.floor, self.examples = command_groups(), FIRST_EXAMPLES
            self.commands = CommandTable(command_entries())
        self.no_args_is_help = True

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """The command that the first word names. Raises ConfigError (E-CLI-RENAMED) with the line of today."""
        if not ctx.resilient_parsing:
            known = args[0] in self.commands
            refuse_renamed(args if ctx.parent is None else [str(self.name), *args], known=known)
        return super().resolve_command(ctx, args)

    def list_commands(self, _ctx: Any) -> list[str]:
        """Names in the order of the work."""
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """What each command is for; of a group's commands all that is said of them."""
        for group in self.floor:
            rows = [
                (name, entry["words"] if ctx.parent else _brief(entry)) for name, entry in group["commands"].items()
            ]
            with formatter.section(group["title"]):
                formatter.write_dl(rows)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """The commands first: they are what is looked for."""
        self.format_commands(ctx, formatter)
        rows = [record for one in self.get_params(ctx) if (record := one.get_help_record(ctx)) is not None]
        with formatter.section("Options"):
            formatter.write_dl(rows)

    def format_epilog(self, _ctx: Any, formatter: Any) -> None:
        """The examples, one a line as they are typed."""
        write_examples(formatter, self.examples)


def _brief(entry: CommandEntry) -> str:
    """The first clause of what a command is for, and its sub-commands; what may write to a machine is said whole."""
    words: str = entry["words"]
    first = words if "--apply" in words else re.split("[;:.]", words)[0]
    if "inner" not in entry:
        return first
    return f"{first}{'; also' if 'place' in entry else ':'} {', '.join(entry['inner'])}"


def refuse_renamed(words: list[str], *, known: bool) -> None:
    """Raise ConfigError (E-CLI-RENAMED) where these words begin with a name of a former version.

    ``known``: the first of them is a command today, so only an entry that names more of them counts.
    """
    for old, new in renamed_commands().items():
        first, *others = old.split()
        if words[0] == first and (others or not known) and set(others) <= set(words[1:]):
            names = [one for one in new.split() if not one.startswith("--")]
            options = dict(zip(others, new.split()[len(names) :], strict=False))
            rest = [options.get(one, one) for one in words[1:] if one in options or one not in others]
            line = shlex.join(["trueflank", *names, *rest])
            raise ConfigError("E-CLI-RENAMED", "command line", old=old, new=new, line=line)


def write_examples(formatter: Any, examples: tuple[str, ...]) -> None:
    """Examples below a help."""
    with formatter.section("Examples"):
        for one in examples:
            formatter.write(f"{'':{formatter.current_indent}}{one}\n")


def load_command(name: str, entry: CommandEntry) -> Any:
    """A command or a group of commands, made of its entry."""
    if "inner" in entry and "place" not in entry:
        group = CommandList(
            name=name, commands=CommandTable(entry["inner"]), help=entry["words"], rich_markup_mode=None
        )
        group.floor = ({"title": "Commands", "commands": entry["inner"]},)
        group.examples = tuple(entry["examples"])
        return group
    module, _, function = entry["place"].partition(":")
    kind = GroupWithDefault if "inner" in entry else CommandWithExamples
    command = _make_command(name, getattr(import_module(module), function), entry["words"], kind)
    if "inner" in entry:
        command.inner, command.commands = entry["inner"], CommandTable(entry["inner"])
    command.examples = tuple(entry["examples"])
    command.params = [*command.params, *_voice_options()]
    return command


def _make_command(
    name: str, work: Callable[..., Any], words: str, kind: type[TyperCommand] = CommandWithExamples
) -> Any:
    info = CommandInfo(name=name, cls=kind, callback=work, help=words, context_settings=CONTEXT_SETTINGS)
    return get_command_from_info(info, pretty_exceptions_short=True, rich_markup_mode=None)


def _voice_options() -> list[Any]:
    """How much a command says: options that every command has."""

    def options(
        _quiet: Annotated[
            bool,
            typer.Option(
                "--quiet", "-q", help="Print essential messages only.", callback=output.quiet_option, expose_value=False
            ),
        ] = False,
        _verbose: Annotated[
            bool,
            typer.Option(
                "--verbose",
                "-v",
                help="Print every step, as in the log.",
                callback=output.verbose_option,
                expose_value=False,
            ),
        ] = False,
    ) -> None: ...

    return list(_make_command("voices", options, "").params)


def command_names() -> Iterator[str]:
    """Every command as it is typed; a group where it does something itself."""
    for name, entry in command_entries().items():
        if "place" in entry:
            yield name
        yield from (f"{name} {inner}" for inner in entry.get("inner", ()))


# ---- options that a mode of a command cannot use
#
# Each mode lists what it takes. Anything else that was typed is a wrong option (exit code 2), never ignored: the person
# who typed it expects it to count.

_FILES = ("files", "kind", "limit", "plot", "column")
_GEOMETRY = (*_FILES, "axis", "unit", "phase", "store", "accept_doubt", "accept", "ask")
_POSITIONING = ("standard", "air", "expansion", "material_degc", "seed", "site", "jobs", "scheduler", "table")
_KINDS: dict[str, tuple[str, ...]] = {
    "straightness": (),
    "angular": ("angle",),
    "squareness": ("plane", "artefact", "senses"),
    "parallelism": ("senses",),
    "six-dof": ("offset",),
    "reversal": (),
    "axis-location": (),
    "rotary-motion": ("motion", "distance"),
    "harmonics": ("order",),
}
OPTIONS_BY_MODE: dict[str, tuple[str, ...]] = {
    "study --relative": ("gear", "errors", "relative", "plots", "height"),
    "run --plan": ("site", "plan", "axis", "apply"),
    "close --plan": ("site", "plan", "apply", "hours", "tolerance", "goal"),
    "measure --plan": ("site", "plan", "hours", "tolerance", "goal"),
    "simulate --list": ("listed",),
    "docs schema --page": ("as_page",),
    "docs schema --api": ("api",),
    "docs schema --states": ("states",),
    "correct --run": ("site", "run"),
    "correct --run ERRORS": ("site", "run", "error_u", "sense"),
    "guard --axis": ("site", "run", "axis", "limit"),
    "evaluate --standard list": ("standard",),
    "evaluate --kind positioning": (*_GEOMETRY, *_POSITIONING),
    "evaluate --kind transmission": (*_FILES, "pins", "ratio", "rated_torque", "encoder_u"),
    "evaluate --kind ballbar": _FILES,
    "evaluate --kind gear": ("files", "kind", "limit", "plot", "site"),
    **{f"evaluate --kind {name}": (*_GEOMETRY, *own) for name, own in _KINDS.items()},
}
COMMON_OPTIONS = ("as_json", "_quiet", "_verbose", "help")
_current_context: ContextVar[Any] = ContextVar("context of the command that runs", default=None)


@contextmanager
def current_command(context: Any) -> Iterator[None]:
    """In the block this command line is the one that `only` asks."""
    before = _current_context.set(context)
    try:
        yield
    finally:
        _current_context.reset(before)


def require_only(mode: str) -> None:
    """Refuse what was typed and this mode of `TAKEN` cannot use. Raises typer.BadParameter (exit code 2).

    A kind that is none is refused by its own command; a function called without a command line has nothing typed.
    """
    context = _current_context.get()
    if context is None or mode not in OPTIONS_BY_MODE:
        return
    words = [spelt for name, spelt in _typed_options(context) if name not in OPTIONS_BY_MODE[mode]]
    if words:
        option = mode[mode.index("--") :]
        raise typer.BadParameter(f"{option} cannot use {', '.join(words)}: leave one of them out", param_hint=words[0])


def _typed_options(context: Any) -> Iterator[tuple[str, str]]:
    """Names and spellings of the parameters that were typed."""
    for one in context.command.params:
        source = context.get_parameter_source(one.name or "")
        if one.name and one.name not in COMMON_OPTIONS and source is not None and source.name == "COMMANDLINE":
            yield one.name, next((opt for opt in one.opts if opt.startswith("--")), one.opts[0])
