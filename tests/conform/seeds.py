"""How the double is made more lenient than a control, one way at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from drivers.sinumerik.opcua.session import nodes
from simulators.nck import NckRefusal
from simulators.nck.channel import Channel
from simulators.nck.machine import files
from simulators.nck.machine.files import FileSystem
from simulators.nck.program import expressions as functions
from simulators.nck.program import names, procedures, variables
from simulators.nck.program.variables import TableVariables
from simulators.opcua import methods
from simulators.opcua.address_space import Account, StatusRefused
from simulators.opcua.methods import Methods

Patch = pytest.MonkeyPatch


@dataclass(frozen=True)
class Leniency:
    """``seed`` makes the double lenient; at least one of ``named`` must differ then, and nothing but these may."""

    name: str
    named: frozenset[str]
    seed: Callable[[Patch], None]


def rule(code: str, *named: str) -> Leniency:
    """The gate forgets one rule of the language; whatever stands behind it may still stop the program, otherwise."""

    def seed(patch: Patch) -> None:
        checked = names.check

        def lenient(*given: Any) -> Any:
            return tuple(one for one in checked(*given) if one.code != f"E-LEGAL-{code}")

        patch.setattr(names, "check", lenient)
        names._first_violation.cache_clear()

    return Leniency(f"rule {code}", frozenset(named), seed)


def refusal_is(
    place: Any, name: str, value: Any, *, when: Callable[..., bool] = lambda *_: True
) -> Callable[[Patch], None]:
    """A function that answers ``value`` where it used to refuse."""

    def seed(patch: Patch) -> None:
        strict = getattr(place, name)

        def lenient(*given: Any, **more: Any) -> Any:
            try:
                return strict(*given, **more)
            except (NckRefusal, StatusRefused):
                if when(*given):
                    return value
                raise

        patch.setattr(
            place, name, staticmethod(lenient) if isinstance(place.__dict__.get(name), staticmethod) else lenient
        )

    return seed


def wrapped(place: Any, name: str, change: Callable[[Any], Any]) -> Callable[[Patch], None]:
    return lambda patch: patch.setattr(place, name, change(getattr(place, name)))


def may_all(strict: Any) -> Any:
    return lambda self, right: right == "TeaWrite" or strict(self, right)


def typed(strict: Any) -> Any:
    def lenient(self: Any, item: Any, account: Any) -> Any:
        variant = item.Value.Value
        if variant.VariantType.name == "Int32":
            item.Value.Value = type(variant)(float(variant.Value))
        return strict(self, item, account)

    return lenient


def stamped(strict: Any) -> Any:
    def lenient(self: Any, item: Any, account: Any) -> Any:
        item.Value.SourceTimestamp = item.Value.ServerTimestamp = None
        return strict(self, item, account)

    return lenient


def any_length(strict: Any) -> Any:
    def lenient(self: Any, path: str, values: list[Any], account: Account) -> None:
        address = nodes.parse(path)
        count = len(address.elements) if address is not None else 1
        strict(self, path, (values * max(count, 1))[: max(count, len(values) if count <= 1 else count)], account)

    return lenient


def any_type(strict: Any) -> Any:
    def lenient(self: Any, name: str, arguments: Any, types: Any, account: Account) -> Any:
        found = next((one for one in methods.SIGNATURES if one.name == name), None)
        kinds = [kind for _, kind in found.arguments] if found is not None else []
        return strict(self, name, arguments, kinds if len(kinds) == len(types) else types, account)

    return lenient


def any_count(strict: Any) -> Any:
    def lenient(self: Any, name: str, arguments: Any, types: Any, account: Account) -> Any:
        found = next((one for one in methods.SIGNATURES if one.name == name), None)
        count = len(found.arguments) if found is not None else 0
        return strict(self, name, arguments[:count], types[:count], account)

    return lenient


def file_of(change: Callable[[str], str]) -> Callable[[Patch], None]:
    def seed(patch: Patch) -> None:
        strict = Methods._file
        patch.setattr(
            Methods, "_file", staticmethod(lambda path: strict(change(path) if isinstance(path, str) else path))
        )

    return seed


def selects(strict: Any) -> Any:
    return lambda self, path, channel=1: strict(self, path, 1)


def selects_always(patch: Patch) -> None:
    strict = Channel.select

    def lenient(self: Any, path: str) -> int:
        answer = strict(self, path)
        return 0 if answer == 3 else answer

    patch.setattr(Channel, "select", lenient)


def over_always(strict: Any) -> Any:
    return lambda self, account, target, data, _overwrite: strict(self, account, target, data, True)


def opens_by_zero(strict: Any) -> Any:
    return lambda self, file, mode, account, session: strict(self, file, mode or 1, account, session)


def unlimited(side: str) -> Callable[[Patch], None]:
    def seed(patch: Patch) -> None:
        strict = variables.check_value

        def lenient(spec: Any, name: str, value: Any) -> Any:
            if spec.kind == "real" and (value > spec.high if side == "high" else value < spec.low):
                return float(value)
            return strict(spec, name, value)

        patch.setattr(variables, "check_value", lenient)

    return seed


def bool_of_two(patch: Patch) -> None:
    strict = variables.check_value
    patch.setattr(
        variables,
        "check_value",
        lambda spec, name, value: bool(value) if spec.kind == "bool" else strict(spec, name, value),
    )


def unlocked(patch: Patch) -> None:
    patch.setattr(TableVariables, "_free_eec", lambda self, name, indices: self._eec(name, indices)[0])


def clamped(patch: Patch) -> None:
    strict = TableVariables._taken

    def lenient(self: Any, name: str, kind: str, value: Any) -> Any:
        try:
            return strict(self, name, kind, value)
        except NckRefusal:
            return 0

    patch.setattr(TableVariables, "_taken", lenient)


def divides(patch: Patch) -> None:
    strict = functions.apply_operator
    from simulators.nck.program import expressions

    def lenient(operator: str, left: Any, right: Any) -> Any:
        return 0.0 if operator == "/" and right == 0 else strict(operator, left, right)

    patch.setattr(expressions, "apply_operator", lenient)


def root(patch: Patch) -> None:
    fewest, most, strict = functions.FUNCTIONS["SQRT"]
    lenient = (fewest, most, lambda given: 0.0 if float(given[0]) < 0.0 else strict(given))
    patch.setitem(functions.FUNCTIONS, "SQRT", lenient)


def state_ok(name: str, answer: int) -> Callable[[Patch], None]:
    def seed(patch: Patch) -> None:
        strict = getattr(FileSystem, name)
        patch.setattr(
            FileSystem, name, lambda self, *given: files.OK if (was := strict(self, *given)) == answer else was
        )

    return seed


def reads_missing(patch: Patch) -> None:
    strict = procedures.PROCEDURES["READ"]

    def lenient(host: Any, frame: Any, given: Any, store: Any) -> None:
        strict(host, frame, given, lambda place, value, element=None: store(place, 0 if place == 0 else value, element))

    patch.setitem(procedures.PROCEDURES, "READ", lenient)


def stale(patch: Patch) -> None:
    strict = FileSystem.read

    def lenient(self: Any, path: str) -> bytes:
        first: dict[str, bytes] = self.__dict__.setdefault("first", {}) if hasattr(self, "__dict__") else {}
        return first.setdefault(path, strict(self, path)) if path.endswith("TFPROBE_MPF") else strict(self, path)

    patch.setattr(FileSystem, "read", lenient)


def single(strict: Any) -> Any:
    return lambda self, value: round(float(value), 4)
