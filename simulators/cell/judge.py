"""The back door: questions about the truth and faults set live, as JSON objects; never used by a gateway."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError, TrueflankError
from simulators.cell import Cell
from simulators.cell.control import with_serial
from simulators.nck.machine import NckRefusal

Answer = Callable[[Mapping[str, Any]], Any | Awaitable[Any]]


class Judge:
    """Answers {"ask": ...} and obeys {"set": ...} for one cell."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._asks: dict[str, Answer] = {
            "deviation": self._deviation,
            "figures": self._figures,
            "tables": self._tables,
            "status": self._status,
            "senses": self._senses,
        }
        self._sets: dict[str, Answer] = {
            "pull": lambda q: self._cell.pull(str(q["instrument"])),
            "plug": lambda q: self._cell.plug(str(q["instrument"])),
            "beam": lambda q: self._cell.beam(str(q["instrument"]), broken=bool(q.get("broken", True))),
            "silent": self._silent,
            "operator": lambda q: self._cell.operator.change(**q["options"]),
            "serial": self._serial,
            "variable": self._variable,
            "access_level": lambda q: self._cell.nck.set_access_level(int(q["value"])),
            "power_cycle": lambda _q: self._cell.nck.power_cycle(),
            "nc_start": lambda _q: self._cell.nck.nc_start(),
            "channel_reset": lambda _q: self._cell.nck.channel_reset(),
            "nck_reset": lambda _q: self._cell.nck.nck_reset(),
            "lose_reference": lambda q: self._cell.nck.lose_reference(str(q["axis"])),
            "reference": lambda q: self._cell.nck.reference_axis(str(q["axis"])),
            "mode": lambda q: self._cell.panel.set_mode(str(q["value"])),
            "acknowledge": lambda _q: self._cell.nck.acknowledge_alarms(),
            "mount": self._mount,
            "override": lambda q: self._cell.nck.set_feed_override(float(q["value"])),
            "drop_connections": lambda _q: self._cell.server.drop_connections(),
            "cut_after_blocks": self._cut,
            "result_file": self._result_file,
        }

    async def answer(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """The answer as an object; {"error": ...} when the question cannot be answered."""
        try:
            found = self._find(question)(question)
            value = await found if inspect.isawaitable(found) else found
        except (KeyError, TypeError, ValueError) as error:
            return {"error": f"{type(error).__name__}: {error}", "to": dict(question)}
        except (TrueflankError, NckRefusal) as error:
            return {"error": str(error), "to": dict(question)}
        return value if isinstance(value, dict) else {"done": True}

    def _find(self, question: Mapping[str, Any]) -> Answer:
        known = self._asks if "ask" in question else self._sets
        name = str(question.get("ask", question.get("set", "")))
        if name not in known:
            names = ", ".join([*self._asks, *self._sets])
            raise ConfigError("E-CELL-ASK", self._cell.file.name, ask=name, why="no such word", known=names)
        return known[name]

    def _deviation(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """{"axis", "positions", "direction", "state": "live"|"raw", "t"}: um or arcsec at 20 degC."""
        unit = self._cell.raw_deviation if question.get("state") == "raw" else self._cell.true_deviation
        places = np.asarray(question["positions"], dtype=np.float64)
        values = unit(str(question["axis"]), places, int(question.get("direction", 1)), question.get("t"))
        kind = self._cell.axis(str(question["axis"])).kind
        return {"deviation": values.tolist(), "unit": "arcsec" if kind == "rotary" else "um"}

    def _figures(self, question: Mapping[str, Any]) -> dict[str, Any]:
        axis, step = str(question["axis"]), float(question.get("step", 0.1))
        return {
            "raw": self._cell.figures(axis, live=False, step=step),
            "live": self._cell.figures(axis, live=True, step=step),
        }

    def _tables(self, _question: Mapping[str, Any]) -> dict[str, Any]:
        """Every EEC value and switch as the control holds it, and one hash over all."""
        found = {axis.name: self._table(axis.name) for axis in self._cell.file.axes}
        digest = hashlib.sha256(repr(sorted(found.items())).encode()).hexdigest()
        return {"tables": found, "digest": digest}

    def _table(self, axis: str) -> dict[str, Any]:
        nck = self._cell.nck
        points = int(nck.get(f"$MA_MM_ENC_COMP_MAX_POINTS[0,{axis}]"))
        names = {
            "step": f"$AA_ENC_COMP_STEP[0,{axis}]",
            "min": f"$AA_ENC_COMP_MIN[0,{axis}]",
            "max": f"$AA_ENC_COMP_MAX[0,{axis}]",
            "modulo": f"$AA_ENC_COMP_IS_MODULO[0,{axis}]",
            "enabled": f"$MA_ENC_COMP_ENABLE[0,{axis}]",
        }
        values = [float(nck.get(f"$AA_ENC_COMP[0,{point},{axis}]")) for point in range(points)]
        return {key: float(nck.get(name)) for key, name in names.items()} | {"values": values}

    def _status(self, _question: Mapping[str, Any]) -> dict[str, Any]:
        nck, cell = self._cell.nck, self._cell
        return {
            "channel": int(nck.channel_status),
            "mode": str(nck.mode),
            "message": str(nck.message),
            "selected": str(nck.selected),
            "alarms": [int(alarm.number) for alarm in nck.alarms],
            "positions": {a.name: float(nck.axis_state(a.name).set_position) for a in cell.file.axes},
            "referenced": {a.name: bool(nck.axis_state(a.name).referenced) for a in cell.file.axes},
            "operator": list(cell.operator.log),
            "clock_s": cell.clock.now(),
            "serial": str(nck.spec.serial),
        }

    def _senses(self, _question: Mapping[str, Any]) -> dict[str, Any]:
        senses = {
            name: (answerer.counter if hasattr(answerer, "counter") else answerer.reader).sense
            for name, answerer in self._cell.instruments.items()
        }
        return {"instruments": senses, "cec": int(self._cell.nck.spec.cec_sign)}

    def _silent(self, question: Mapping[str, Any]) -> None:
        self._cell.instruments[str(question["instrument"])].silent = bool(question.get("value", True))

    def _serial(self, question: Mapping[str, Any]) -> None:
        with_serial(self._cell.nck, str(question["value"]))

    def _cut(self, question: Mapping[str, Any]) -> None:
        """The mains fail after so many more program blocks."""
        self._cell.nck.cut_power_after(int(question["value"]))

    def _variable(self, question: Mapping[str, Any]) -> None:
        """Write any NC variable with a manufacturer's rights, e.g. another table, MD38000 or a backlash."""
        self._cell.nck.set(str(question["name"]), question["value"], int(question.get("level", 0)))

    def _mount(self, question: Mapping[str, Any]) -> None:
        setup = self._cell.bench.setup_for(str(question["component"]), str(question["axis"]))
        if setup is None:
            raise ValueError("the cell has no such set-up")
        self._cell.bench.mount(setup, question.get("optics"))

    def _result_file(self, question: Mapping[str, Any]) -> dict[str, Any]:
        path = Path(str(question["path"]))
        made = self._cell.write_result_file(str(question["axis"]), path, int(question.get("repetitions", 5)))
        return {"path": str(made)}
