"""The reducer that discs make: its transmission error, lost motion and stiffness, and which discs belong together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.message import Message, words
from drivers.units import deg_to_rad, rad_to_deg
from gateway.correct.outlook.drive_outlook import drawn_apart, drawn_flanks
from gateway.correct.outlook.flank_uncertainty import FlankDoubts
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.reducer import records
from gateway.reducer.figures import Transmission
from gateway.reducer.figures import transmission as worked
from gateway.reducer.pairing import Matching, Pair
from gateway.reducer.pairing import match as matched
from gateway.reducer.uncertainty import Draw, DriveUncertainty
from gateway.reducer.uncertainty import uncertainty as drawn
from gateway.study.inputs import gear_of
from gateway.tooth import FlankMap
from trueflank.frames import frame
from trueflank.given import of_kind, wholes_given
from trueflank.tooth import Flank, Gear

PARTS: Mapping[str, Any] = {
    "pins": records.Pins,
    "output": records.Cranks,
    "contact": records.Contact,
    "first_stage": records.FirstStage,
    "tolerances": records.Tolerances,
}


@dataclass(frozen=True, slots=True, repr=False)
class Reducer:
    """A drive: ring pins, one to three discs with crank phase and mark, cranks or output pins, contact, tolerances.

    Lengths in mm, errors and clearances in um, stiffness in N/mm, torque in Nm, angles in deg; names carry the unit.
    ``data.datum`` is what the flank deviations of its discs are measured from. ``data`` has every value.
    """

    data: records.Reducer

    @classmethod
    def shipped(cls, name: str, *, datum: str, **changes: Any) -> Reducer:
        """ "RV-20E-like", "RV-40E-like", "RV-320E-like" or "cycloid-like": literature sizes, no maker's data.

        ``datum`` of the flank deviations: "crank-holes", "bore" or "best-fit". ``changes`` as in `but`. Raises
        ModelError (E-REDUCER-DATUM, E-REDUCER-NAME), ConfigError (E-LIBRARY-KIND).
        """
        return cls(records.shipped(name, _datum(datum))).but(**changes)

    @classmethod
    def of(cls, gear: Gear, *, datum: str, **changes: Any) -> Reducer:
        """Two discs of a gear on two cranks, mm, um, N, Nm; defaults scale with its size; ``changes`` as in `but`.

        Raises ModelError (E-REDUCER-...), ConfigError (E-LIBRARY-KIND).
        """
        of_kind(gear, Gear, "Reducer.of")
        return cls(records.for_gear(gear_of(gear.data), _datum(datum), name=gear.data.name)).but(**changes)

    def but(self, **changes: Any) -> Reducer:
        """The drive with other values, mm, um, N, Nm: ``rated_nm``, ``interference_um``, ``marks``, or parts.

        ``marks`` is a tooth position per disc; a part is a dictionary of what differs: ``pins``, ``output``,
        ``contact``, ``first_stage``, ``tolerances``, as in ``pins={"radius_um": [0.5] * 40}`` (one value per pin).
        Raises ConfigError (E-LIBRARY-KIND) for a key that there is none, ModelError (E-REDUCER-...).
        """
        told = dict(changes)
        drive = self.data if "marks" not in told else self.data.with_marks(told.pop("marks"))
        for name, one in told.items():
            known = [field.name for field in fields(records.Reducer) if field.name not in ("gear", "discs", "datum")]
            if name not in known:
                _unknown(name, known)
            drive = replace(drive, **{name: self._part(drive, name, one) if name in PARTS else one})
        return Reducer(drive)

    @staticmethod
    def _part(drive: records.Reducer, name: str, one: Any) -> Any:
        part = getattr(drive, name)
        if not isinstance(one, Mapping):
            _unknown(name, [words("W-LIB-DIFFERS")])
        known = [field.name for field in fields(part)]
        for key in one:
            if key not in known:
                _unknown(f"{name}.{key}", known)
        return replace(part, **{key: _tuples(value) for key, value in one.items()})

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {field.name: _plain(getattr(self.data, field.name)) for field in fields(self.data)}

    def plot(self) -> Any:
        """The drive along its axis in mm: ring pins, discs on their eccentrics, cranks; a matplotlib figure."""
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.drives import reducer_sheet

        return new_sheet((7.0, 6.6), lambda figure: reducer_sheet(figure, self.data))

    def __repr__(self) -> str:
        d = self.data
        return f"Reducer({d.name}: {d.pins.number} pins, {len(d.discs)} discs, {d.rated_nm:g} Nm, datum {d.datum})"


@dataclass(frozen=True, slots=True, repr=False)
class Drive:
    """The figures of one drive, arcsec; without friction, predicted and not tested.

    ``found`` has all curves (N,) over one output turn. ``u`` where it was asked for: mean, standard uncertainty and 95
    % interval of ``error_arcsec``, ``rms_arcsec`` and ``lost_motion_arcsec``.
    """

    found: Transmission
    u: DriveUncertainty | None = None

    @property
    def error(self) -> float:
        """Transmission error under load, arcsec peak to peak over one output turn, the worse sense of torque."""
        return self.found.error_arcsec

    @property
    def lost_motion(self) -> float:
        """Output angle at +3 % less that at -3 % of rated torque, input locked; mean over the turn, arcsec."""
        return self.found.lost_motion

    def curve(self, sense: int = 1, *, loaded: bool = True) -> FloatArray:
        """Transmission error (N,) in arcsec over one output turn, mean removed, + counter-clockwise.

        ``sense`` +1 is a torque that turns the output counter-clockwise, -1 the other; not ``loaded``: 0.03 % of rated.
        """
        return (self.found.loaded if loaded else self.found.unloaded)[0 if sense > 0 else 1].error_arcsec

    def to_dict(self) -> dict[str, Any]:
        """Plain data: figures, orders by cause, and u by figure."""
        f = self.found
        told: dict[str, Any] = {
            "reducer": f.drive.name,
            "torque_nm": f.torque_nm,
            "error_arcsec": f.error_arcsec,
            "unloaded_error_arcsec": f.unloaded_arcsec,
            "rms_arcsec": f.rms_arcsec,
            "lost_motion_arcsec": f.lost_motion,
            "backlash_arcsec": f.backlash,
            "stiffness_nm_arcmin": f.stiffness_nm_arcmin,
            "pins_touching": f.touching.mean(axis=0).tolist(),
            "largest_force_n": float(f.force_n.max()),
            "largest_pressure_mpa": float(f.pressure_mpa.max()),
            "interference_um": f.interference_um,
            "orders": [
                {"order": one.number, "amplitude_arcsec": one.amplitude_arcsec, "cause": one.cause}
                for one in f.orders()
            ],
        }
        if self.u is not None:
            told["expected"] = {name: _plain(one) for name, one in self.u.figures.items()}
            told["trials"] = self.u.trials
        return told

    def to_pandas(self) -> Any:
        """One row a crank angle: output angle in deg, errors of both senses, lost motion, backlash in arcsec.

        Raises ConfigError (E-LIBRARY-PANDAS).
        """
        f = self.found
        turned = rad_to_deg(f.crank_rad) / f.drive.gear.zc
        columns = {
            "output_deg": turned,
            "lost_motion_arcsec": f.lost_motion_arcsec,
            "backlash_arcsec": f.backlash_arcsec,
        }
        names = ("loaded_plus", "loaded_minus", "unloaded_plus", "unloaded_minus")
        curves = zip(names, (*f.loaded, *f.unloaded), strict=True)
        return frame({**columns, **{f"{name}_arcsec": one.error_arcsec for name, one in curves}})

    def plot(self) -> Any:
        """The error over one output turn in arcsec, its orders by cause, lost motion, backlash; a matplotlib figure."""
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.drives import drive_sheet

        expected = "" if self.u is None else f"; expected {_said(self.u)} arcsec"
        return new_sheet((10.0, 6.0), lambda figure: drive_sheet(figure, self.found, expected))

    def __repr__(self) -> str:
        f = self.found
        sure = "" if self.u is None else f", expected {_said(self.u)}"
        return (
            f"Drive({f.drive.name}: transmission error {f.error_arcsec:.1f} arcsec{sure}, lost motion "
            f"{f.lost_motion:.1f} arcsec, {f.stiffness_nm_arcmin:.4g} Nm/arcmin, without friction)"
        )


def transmission(
    reducer: Reducer,
    discs: Flank | Sequence[Flank | None] | None = None,
    *,
    torque_nm: float | None = None,
    steps: int | None = None,
    uncertainty: bool = False,
    seed: int = 1,
) -> Drive:
    """The figures of a drive by the full model. ``discs``: one flank (um) for all discs, one each, or none.

    Errors in arcsec, ``torque_nm`` in Nm, rated unless given. ``steps`` per crank turn: 24, 96 for fewer than 24 pins,
    unless given. ``uncertainty`` draws pins, cranks and datum by their tolerances, and each flank by how its machine's
    errors may be wrong where its `doubts` say so (half a minute for 40 pins). Raises ConfigError (E-LIBRARY-KIND),
    ModelError (E-REDUCER-...).
    """
    _reducer_given(reducer, "transmission")
    wholes_given("transmission", seed=seed)
    parts = _parts(reducer.data, discs, "transmission")
    found = worked(reducer.data, parts, torque_nm=torque_nm, steps=steps)
    if not uncertainty:
        return Drive(found)
    return Drive(found, drawn(reducer.data, _drawn(parts, discs), torque_nm=torque_nm, steps=steps, seed=seed))


@dataclass(frozen=True, slots=True, repr=False)
class Matched:
    """Discs in pairs, by their numbers (from 0) in the order given, and what pairing is worth; arcsec peak to peak."""

    found: Matching

    @property
    def pairs(self) -> list[dict[str, Any]]:
        """A dictionary a pair: ``first``, ``second``, ``mark`` of the second, ``error_arcsec``, ``first_order_arcsec``.

        ``error_arcsec`` is the full model's, peak to peak; the first order chose the pair. ``assembles`` is False where
        the parts have more surplus (``interference_um``) than assembly may squeeze (``limit_um``).
        """
        return [_pair(pair) for pair in self.found.pairs]

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        f = self.found
        return {
            "pairs": self.pairs,
            "as_they_come": [_pair(pair) for pair in f.as_they_come],
            "left_over": list(f.left_over),
            "mean_arcsec": f.mean_arcsec,
            "as_they_come_arcsec": f.as_they_come_arcsec,
            "worth_arcsec": f.worth_arcsec,
        }

    def to_pandas(self) -> Any:
        """One row a pair. Raises ConfigError (E-LIBRARY-PANDAS)."""
        return frame({key: [pair[key] for pair in self.pairs] for key in self.pairs[0]})

    def plot(self) -> Any:
        """Every pair's transmission error in arcsec, matched and as the discs came; a matplotlib figure."""
        from gateway.study.plots.charts import new_sheet
        from gateway.study.plots.drives import pairs_sheet

        return new_sheet((9.0, 4.2), lambda figure: pairs_sheet(figure, self.found))

    def __repr__(self) -> str:
        f = self.found
        tight = sum(not pair.assembles for pair in f.pairs)
        return (
            f"Matched({len(f.pairs)} drives: mean error {f.mean_arcsec:.1f} arcsec, {f.as_they_come_arcsec:.1f} as the "
            f"discs come; pairing is worth {f.worth_arcsec:.1f}{f'; {tight} cannot be assembled' if tight else ''})"
        )


def match(
    reducer: Reducer,
    discs: Sequence[Flank],
    *,
    marks: Sequence[int] | None = None,
    torque_nm: float | None = None,
    steps: int | None = None,
) -> Matched:
    """Which two of N discs (flanks in um) make a drive, and in which tooth position, for the least error in all.

    The error is the transmission error, arcsec peak to peak. ``marks``: the tooth positions of the second disc that its
    holes allow, all unless given. ``torque_nm``: rated unless given.
    Raises ConfigError (E-LIBRARY-KIND), ModelError (E-REDUCER-MATCH, E-REDUCER-FLANK).
    """
    _reducer_given(reducer, "match")
    parts = [_map(one, "match") for one in discs]
    return Matched(matched(reducer.data, parts, marks=marks, torque_nm=torque_nm, steps=steps))


def _pair(pair: Pair) -> dict[str, Any]:
    return {**_plain(pair), "assembles": pair.assembles}


def _parts(drive: records.Reducer, discs: Flank | Sequence[Flank | None] | None, call: str) -> list[FlankMap | None]:
    if discs is None or isinstance(discs, Flank):
        return [None if discs is None else _map(discs, call)] * len(drive.discs)
    if len(discs) != len(drive.discs):
        raise ModelError("E-REDUCER-COUNT", drive.name, key="discs", given=len(discs), wanted=len(drive.discs))
    return [None if one is None else _map(one, call) for one in discs]


def _drawn(parts: list[FlankMap | None], discs: Flank | Sequence[Flank | None] | None) -> Draw | list[FlankMap | None]:
    """Discs that are drawn by how their machines' errors may be wrong, where that is known.

    Discs with the same patterns are one machine's, and so are wrong together; others are wrong each for itself.
    """
    each = [discs] * len(parts) if isinstance(discs, Flank) or discs is None else list(discs)
    draws: list[tuple[FlankDoubts, Draw]] = []
    for one in each:
        doubt = None if one is None else one.doubts
        if doubt is not None and not any(_same(doubt, known) for known, _ in draws):
            alone = [part if _of(other, doubt) else None for other, part in zip(each, parts, strict=True)]
            draws.append((doubt, drawn_flanks(alone, doubt.places, doubt.patterns)))
    return drawn_apart(parts, [one for _, one in draws]) if draws else parts


def _of(one: Flank | None, doubt: FlankDoubts) -> bool:
    return one is not None and one.doubts is not None and _same(one.doubts, doubt)


def _same(one: FlankDoubts, other: FlankDoubts) -> bool:
    return one is other or (one.sources == other.sources and np.array_equal(one.patterns, other.patterns))


def _map(one: Flank, call: str) -> FlankMap:
    of_kind(one, Flank, call)
    return FlankMap(deg_to_rad(one.angle), one.height, np.asarray(one.deviation, dtype=np.float64))


def _reducer_given(one: Any, call: str) -> None:
    of_kind(one, Reducer, call)


def _datum(name: str) -> records.Datum:
    if name not in records.DATUMS:
        raise ModelError("E-REDUCER-DATUM", "reducer", datum=name, known=", ".join(records.DATUMS))
    return name


def _unknown(given: str, known: Sequence[str]) -> None:
    how = f"one of {', '.join(known)}"
    raise ConfigError(
        "E-LIBRARY-KIND", "Reducer", call="tf.Reducer", wanted=Message.of("W-LIB-DRIVE-VALUE"), given=given, how=how
    )


def _tuples(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return tuple(_tuples(one) for one in value) if isinstance(value, list | tuple) else value


def _plain(one: Any) -> Any:
    if hasattr(one, "__dataclass_fields__"):
        return {field.name: _plain(getattr(one, field.name)) for field in fields(one)}
    return [_plain(part) for part in one] if isinstance(one, tuple) else one


def _said(u: DriveUncertainty) -> str:
    one = u.figures["error_arcsec"]
    return f"{one.mean:.1f} ± {one.u:.1f} (u)"
