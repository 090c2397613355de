"""The back door for tests: questions about the truth and faults set live, as JSON objects; no gateway uses it."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drivers.clock import LoopClock
from drivers.errors import ConfigError, TrueflankError
from simulators.cell import Cell
from simulators.cell.control import with_serial_number
from simulators.cell.setup_files import write_setup_file, write_site_of_files
from simulators.grinding import WorkPiece
from simulators.inspection import GearInspectionServer
from simulators.modbus import PlcStation
from simulators.nck import NckRefusal
from simulators.umd import UmdServer

AnswerFunction = Callable[[Mapping[str, Any]], Any | Awaitable[Any]]


class BackDoor:
    """Answers {"ask": ...} and obeys {"set": ...} for one cell."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._asks: dict[str, AnswerFunction] = {
            "deviation": self._deviation,
            "figures": self._figures,
            "tables": self._tables,
            "status": self._status,
            "senses": self._senses,
            "plc": self._plc,
            "motion": self._motion,
            "location": lambda q: {"value": self._cell.truth.location(str(q["name"]), q.get("t"))},
            "part": self._part,
            "flank": self._flank,
        }
        self._sets: dict[str, AnswerFunction] = {
            "pull": lambda q: self._cell.pull(str(q["instrument"])),
            "plug": lambda q: self._cell.plug(str(q["instrument"])),
            "beam": lambda q: self._cell.beam(str(q["instrument"]), broken=bool(q.get("broken", True))),
            "silent": self._silent,
            "operator": lambda q: self._cell.operator.change(**q["options"]),
            "serial": self._serial,
            "variable": self._variable,
            "access_level": lambda q: self._cell.nck.set_access_level(int(q["value"])),
            "power_cycle": lambda _q: self._cell.power_cycle(),
            "press": lambda q: self._cell.operator.press(str(q["key"]).upper()),
            "nc_start": lambda _q: self._cell.nck.nc_start(),
            "channel_reset": lambda _q: self._cell.nck.channel_reset(),
            "nck_reset": lambda _q: self._cell.nck.nck_reset(),
            "lose_reference": lambda q: self._cell.nck.lose_reference(str(q["axis"])),
            "reference": lambda q: self._cell.nck.reference_axis(str(q["axis"])),
            "mode": lambda q: self._cell.panel.set_mode(str(q["value"])),
            "acknowledge": lambda _q: self._cell.nck.acknowledge_alarms(),
            "mount": self._mount,
            "weather": self._weather,
            "speed": self._speed,
            "override": lambda q: self._cell.nck.set_feed_override(float(q["value"])),
            "drop_connections": lambda _q: self._cell.connections.drop_connections(),
            "jog": lambda q: self._cell.operator.jog(str(q["axis"]), float(q["value"])),
            "confirm": lambda _q: {"taken": self._mailbox().plc.confirm()},
            "release": self._release,
            "plc": self._change_plc,
            "cut_after_blocks": self._cut,
            "result_file": self._result_file,
            "setup_file": self._setup_file,
            "filed_site": self._filed_site,
            "gear_machine": lambda q: self._gear_machine().machine.change(**q["options"]),
            "reclamp": lambda _q: self._gear_machine().reclamp(),
            "load_blank": lambda _q: {"done": self._cell.shop.load()},
            "dresser_table": lambda q: {"done": self._cell.shop.give_dresser(q["axial_mm"], q["correction_um"])},
            "builder_cycle": lambda _q: {"done": self._cell.run_builder_cycle()},
            "unload_part": lambda _q: {"done": self._cell.shop.unload()},
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

    def _find(self, question: Mapping[str, Any]) -> AnswerFunction:
        known = self._asks if "ask" in question else self._sets
        name = str(question.get("ask", question.get("set", "")))
        if name not in known:
            names = ", ".join([*self._asks, *self._sets])
            raise ConfigError("E-CELL-ASK", self._cell.file.name, ask=name, why="no such word", known=names)
        return known[name]

    def _speed(self, question: Mapping[str, Any]) -> None:
        """{"value"}: machine seconds in one second from now on."""
        clock = self._cell.clock
        if not isinstance(clock, LoopClock):
            raise TypeError("this cell's clock has no speed")
        clock.change_speed(float(question["value"]))

    def _deviation(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """{"axis", "positions", "direction", "state": "live"|"raw", "t"}: um or arcsec at 20 degC."""
        unit = self._cell.raw_deviation if question.get("state") == "raw" else self._cell.true_deviation
        places = np.asarray(question["positions"], dtype=np.float64)
        values = unit(str(question["axis"]), places, int(question.get("direction", 1)), question.get("t"))
        kind = self._cell.axis(str(question["axis"])).kind
        return {"deviation": values.tolist(), "unit": "arcsec" if kind == "rotary" else "um"}

    def _motion(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """{"name": "EYX", "positions"}: an error motion of the truth in um or arcsec, without any reversal."""
        places = np.asarray(question["positions"], dtype=np.float64)
        return {"motion": self._cell.truth.motion(str(question["name"]), places).tolist()}

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
            "serial": str(nck.spec.identity[0]),
        }

    def _senses(self, _question: Mapping[str, Any]) -> dict[str, Any]:
        readers = {
            name: answerer.counter if isinstance(answerer, UmdServer) else answerer.reader
            for name, answerer in self._cell.instruments.items()
        }
        senses = {name: reader.sense for name, reader in readers.items() if hasattr(reader, "sense")}
        return {"instruments": senses, "cec": int(self._cell.nck.spec.cec_sign)}

    def _mailbox(self) -> PlcStation:
        if self._cell.plc is None:
            raise ValueError("the cell has no PLC mailbox: its roads are " + ", ".join(self._cell.connections.names))
        return self._cell.plc

    def _plc(self, _question: Mapping[str, Any]) -> dict[str, Any]:
        """What the PLC keeps and does: marker, half-written tables, session, whether it waits at the panel."""
        plc = self._mailbox().plc
        return {
            "session": plc.session,
            "waiting": plc.waiting,
            "released": plc.release.counts,
            "half": sorted(plc.memory.half),
            "marker": list(plc.memory.marker),
            "marker_state": plc.memory.marker_state,
            "requests": self._mailbox().served,
        }

    def _release(self, question: Mapping[str, Any]) -> None:
        """The local release switch at the panel."""
        self._mailbox().plc.release.set(bool(question.get("value", True)))

    def _change_plc(self, question: Mapping[str, Any]) -> None:
        """{"options": {...}}: keys of [machine.modbus], from now on."""
        self._mailbox().plc.change(**question["options"])

    def _silent(self, question: Mapping[str, Any]) -> None:
        self._cell.outlet(str(question["instrument"])).silent = bool(question.get("value", True))

    def _serial(self, question: Mapping[str, Any]) -> None:
        with_serial_number(self._cell.nck, str(question["value"]))

    def _cut(self, question: Mapping[str, Any]) -> None:
        """The mains fail after so many more program blocks."""
        self._cell.nck.cut_power_after(int(question["value"]))

    def _variable(self, question: Mapping[str, Any]) -> None:
        """Write any NC variable with a manufacturer's rights, e.g. another table, MD38000 or a backlash."""
        self._cell.nck.set(str(question["name"]), question["value"], int(question.get("level", 0)))

    def _mount(self, question: Mapping[str, Any]) -> None:
        letters = {axis.name: axis.letter for axis in self._cell.file.axes}
        axis = str(question["axis"])
        setup = self._cell.bench.setup_for(str(question["component"]), letters.get(axis, axis))
        if setup is None:
            raise ValueError("the cell has no such set-up")
        self._cell.bench.mount(setup, question.get("optics"))

    def _weather(self, question: Mapping[str, Any]) -> None:
        """{"air_degc", "material_degc", "pressure_hpa", "humidity_pct"}: these, from now on, with their drifts."""
        wanted = {key: float(value) for key, value in question.items() if key != "set"}
        self._cell.truth.climate.change(self._cell.clock.now(), **wanted)

    def _result_file(self, question: Mapping[str, Any]) -> dict[str, Any]:
        path = Path(str(question["path"]))
        made = self._cell.write_result_file(str(question["axis"]), path, int(question.get("repetitions", 5)))
        return {"path": str(made)}

    def _setup_file(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """{"component", "axis", "path", "targets", "repetitions", "park"}: any set-up, measured and saved as .csv."""
        asked = {key: question[key] for key in ("targets", "repetitions", "park") if key in question}
        component, axis, path = (str(question[key]) for key in ("component", "axis", "path"))
        return {"path": str(write_setup_file(self._cell, component, axis, Path(path), **asked))}

    def _filed_site(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """{"path", "components"}: a site file whose set-ups (those named, all without) come from tables beside it."""
        path = Path(str(question.get("path", self._cell.site_path)))
        return {"path": str(write_site_of_files(self._cell, path, question.get("components", ())))}

    def _gear_machine(self) -> GearInspectionServer:
        found = (one for one in self._cell.instruments.values() if isinstance(one, GearInspectionServer))
        machine = next(found, None)
        if machine is None:
            raise ValueError("the cell has no gear inspection machine")
        return machine

    def _part(self, _question: Mapping[str, Any]) -> dict[str, Any]:
        """What is on the table, and the part that was ground last."""
        shop = self._cell.shop
        return {"clamped": _part_record(shop.clamped), "ground": _part_record(shop.ground)}

    def _flank(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """{"profile", "width", "share"}: true surplus in um of the part ground last, (spaces, profile, width).

        ``t`` (rad) and ``z`` (mm) say where; profile points go evenly from one tip over the bottom to the other.
        """
        work = self._cell.shop.ground
        if work is None:
            raise ValueError("no part has been ground yet")
        t = work.lobes.even(int(question.get("profile", 22)), float(question.get("share", 0.95)))
        z = np.linspace(-0.5, 0.5, int(question.get("width", 5))) * work.spec.gear.b
        surplus = work.surplus_um(np.arange(float(work.spec.gear.zc)), t, z)
        return {"surplus_um": surplus.tolist(), "t": t.tolist(), "z": z.tolist()}


def _part_record(work: WorkPiece | None) -> dict[str, Any] | None:
    if work is None:
        return None
    return {"number": work.number, "spaces": len(work.spaces), "passes": work.passes, "finished": work.finished}
