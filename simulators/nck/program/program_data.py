"""System variables a running program sees of itself and the time: ``$P_``, ``$AC_``, ``$A_`` names."""

from __future__ import annotations

from collections.abc import Callable

from simulators.nck.machine.core import Core
from simulators.nck.spec import NckRefusal
from simulators.nck.values import Value, real, whole

_TIMERS = 200
_NAMES = frozenset(
    {"$AC_TIMER", "$P_PROG", "$P_PROGPATH", "$P_SIM", "$P_SEARCH", "$P_ISTEST", "$AC_PROG"}
    | {"$AC_STAT", "$AC_OVR", "$A_YEAR", "$A_MONTH", "$A_DAY", "$A_HOUR", "$A_MINUTE", "$A_SECOND"}
)


class ProgramData:
    """Reads and writes those names; ``paths`` gives the programs under execution, outermost first."""

    def __init__(self, core: Core, paths: Callable[[], list[str]]) -> None:
        self._core = core
        self._paths = paths
        self._timers: dict[int, tuple[float, float | None]] = {}

    def knows(self, name: str) -> bool:
        """Whether the name is one of these."""
        return name in _NAMES

    def read(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The value. Raises NckRefusal 17020 for an index out of range."""
        if name == "$AC_TIMER":
            value, since = self._timers.get(self._timer(indices), (0.0, None))
            return value if since is None else value + self._core.clock.now() - since
        if name == "$P_PROG":
            return self._program(indices).rpartition("/")[2]
        if name == "$P_PROGPATH":
            return self._program(()).rpartition("/")[0] + "/"
        if name.startswith("$A_"):
            return int(getattr(self._core.clock.utc(), name.removeprefix("$A_").lower()))
        fixed: dict[str, Value] = {"$AC_PROG": 2, "$AC_STAT": 1, "$AC_OVR": self._core.override_percent}
        return fixed.get(name, 0)

    def write(self, name: str, indices: tuple[Value, ...], value: Value) -> None:
        """Set a timer: running from a value >= 0, standing after -1. Others raise NckRefusal 17070."""
        if name != "$AC_TIMER":
            raise NckRefusal(17070, f"{name}: data write-protected")
        timer, plain = self._timer(indices), real(value)
        if plain < 0.0:
            standing = real(self.read(name, indices))
            self._timers[timer] = (standing, None)
        else:
            self._timers[timer] = (plain, self._core.clock.now())

    def _timer(self, indices: tuple[Value, ...]) -> int:
        number = whole(indices[0]) if len(indices) == 1 else -1
        if not 0 <= number < _TIMERS:
            raise NckRefusal(17020, "$AC_TIMER: illegal array index 1")
        return number

    def _program(self, indices: tuple[Value, ...]) -> str:
        paths = self._paths()
        level = whole(indices[0]) if indices else len(paths) - 1
        if not 0 <= level < len(paths):
            raise NckRefusal(17020, "illegal array index 1: program level")
        return paths[level]
