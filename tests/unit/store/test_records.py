"""Every record that a run stores comes back as it was; what does not fit is refused by name."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.types.identity import MachineIdentity
from drivers.types.sensing import Ambient
from drivers.types.tables import CompensationTable
from gateway.domain.figures import Component
from gateway.errors import CorruptRecord, FutureSchema, StoreError
from gateway.store import records
from tests.unit.store.strategies import all_records, anything, of_type, same

TABLE = CompensationTable("axis", "X1", "X1", -10.0, 10.0, 10.0, (0.0, 1.25, -0.0))


@pytest.mark.parametrize("kind", all_records(), ids=lambda kind: kind.__name__)
@settings(max_examples=5, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_round_trip(kind: type, data: st.DataObject) -> None:
    comes_back(kind, data)


@pytest.mark.long
@pytest.mark.parametrize("kind", all_records(), ids=lambda kind: kind.__name__)
@settings(max_examples=15, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_round_trip_of_more_values(kind: type, data: st.DataObject) -> None:
    comes_back(kind, data)


def comes_back(kind: type, data: st.DataObject) -> None:
    """A record of this kind is the same after it was stored."""
    record = data.draw(of_type(kind))
    encoded = records.encode(record, ("a" * 64,))
    back = records.decode(encoded, kind)
    assert same(record, back)
    assert records.encode(back, ("a" * 64,)) == encoded


@settings(max_examples=100, deadline=None, derandomize=True)
@given(anything())
def test_undeclared_values_round_trip(value: Any) -> None:
    stored = json.loads(records.canonical(records.plain(value)))
    assert same(value, records.from_plain(stored))


def test_at_least_the_records_of_a_run_are_covered() -> None:
    names = {kind.__name__ for kind in all_records()}
    assert {
        "Capture",
        "Evaluation",
        "Component",
        "Proposal",
        "PushRecord",
        "Verdict",
        "SignProof",
        "LiveSet",
    } <= names


def test_numpy_scalars_are_stored_as_numbers() -> None:
    record = dataclasses.replace(TABLE, deviations=(np.float64(1.5), np.float64(2.0), 3))
    back = records.decode(records.encode(record), CompensationTable)
    assert back.deviations == (1.5, 2.0, 3.0)
    assert all(type(value) is float for value in back.deviations)


def test_canonical_does_not_depend_on_the_order_of_keys() -> None:
    def component(parameters: dict[str, object]) -> Component:
        return Component("ECC", "C", "deg", "fourier", (0.0, 360.0), np.zeros(1), np.zeros((1, 1)), parameters)

    one = component({"a": 1, "b": (2.0, math.nan)})
    two = component({"b": (2.0, math.nan), "a": 1})
    assert records.encode(one) == records.encode(two)


def test_shape_of_an_empty_array_is_kept() -> None:
    stored = records.plain(np.zeros((0, 3)))
    assert records.from_plain(stored).shape == (0, 3)


@pytest.mark.parametrize("value", [object(), 1j, {1: 2}, np.array([1 + 2j]), b"bytes", {1, 2}])
def test_what_has_no_stored_form_is_refused(value: object) -> None:
    with pytest.raises(StoreError) as caught:
        records.plain(value)
    assert caught.value.code == "E-STORE-ENCODE"


@pytest.mark.parametrize(
    ("field", "value"),
    [("serial", 5), ("unit_system", "furlong"), ("axis_names", ("X1", 2)), ("axis_names", "X1")],
)
def test_a_wrong_type_is_refused_with_the_fields_name(field: str, value: object) -> None:
    good = {"serial": "s", "version": "v", "axis_names": ("X1",)}
    with pytest.raises(StoreError) as caught:
        records.encode(MachineIdentity(**{**good, field: value}))
    assert field in str(caught.value.fields["what"])


def test_a_class_is_no_record() -> None:
    with pytest.raises(StoreError):
        records.encode(MachineIdentity)
    with pytest.raises(StoreError):
        records.encode({"a": 1})


def _altered(change: Any) -> bytes:
    envelope = json.loads(records.encode(TABLE))
    change(envelope)
    return json.dumps(envelope).encode()


def test_newer_schema_is_refused_as_newer() -> None:
    with pytest.raises(FutureSchema) as caught:
        records.decode(_altered(lambda e: e.update(schema=records.SCHEMA + 1)), CompensationTable)
    assert caught.value.code == "E-STORE-FUTURE"


def test_unknown_field_comes_from_a_newer_program() -> None:
    with pytest.raises(FutureSchema) as caught:
        records.decode(_altered(lambda e: e["record"].update(colour="red")), CompensationTable)
    assert caught.value.fields["unknown"] == "colour"


def test_a_missing_field_takes_its_default_and_needs_one() -> None:
    older = _altered(lambda e: e["record"].pop("table_type"))
    assert records.decode(older, CompensationTable) == TABLE
    with pytest.raises(CorruptRecord):
        records.decode(_altered(lambda e: e["record"].pop("step")), CompensationTable)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda e: e.update(type="Capture"), "E-STORE-TYPE"),
        (lambda e: e.pop("schema"), "E-STORE-JSON"),
        (lambda e: e.pop("record"), "E-STORE-FIELD"),
        (lambda e: e["record"].update(step="wide"), "E-STORE-FIELD"),
        (lambda e: e["record"].update(step=True), "E-STORE-FIELD"),
        (lambda e: e["record"].update(modulo=1), "E-STORE-FIELD"),
        (lambda e: e["record"].update(index=1.5), "E-STORE-FIELD"),
        (lambda e: e["record"].update(kind="VCS"), "E-STORE-FIELD"),
        (lambda e: e["record"].update(deviations=5), "E-STORE-FIELD"),
        (lambda e: e.update(record=[]), "E-STORE-FIELD"),
        (lambda e: e.update(record=None), "E-STORE-FIELD"),
    ],
)
def test_damaged_records_are_refused(change: Any, code: str) -> None:
    with pytest.raises(StoreError) as caught:
        records.decode(_altered(change), CompensationTable)
    assert caught.value.code == code
    assert "<" not in caught.value.what


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.data())
def test_mutated_bytes_never_crash(data: st.DataObject) -> None:
    good = records.encode(Ambient(20.0, None, 45.5, (19.0, math.nan)))
    place = data.draw(st.integers(0, len(good) - 1))
    byte = data.draw(st.integers(0, 255))
    mutated = good[:place] + bytes([byte]) + good[place + 1 :]
    try:
        back = records.decode(mutated, Ambient)
    except StoreError:
        return
    assert isinstance(back, Ambient)


@pytest.mark.parametrize("data", [b"", b"[]", b"null", b"\xff\xfe", b'{"schema": "1"}', b"[" * 2000])
def test_what_is_no_envelope_is_corrupt(data: bytes) -> None:
    with pytest.raises(CorruptRecord):
        records.decode(data, Ambient)


@pytest.mark.parametrize("data", [{"$what": 1}, {"a": 1, "b": 2}, {"$array": {"dtype": "float64"}}, {"$map": 5}])
def test_wrong_tags_are_corrupt(data: object) -> None:
    with pytest.raises(CorruptRecord):
        records.from_plain(data)
