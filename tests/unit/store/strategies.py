"""Hypothesis strategies for every record, built from the declared types."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
from collections.abc import Mapping
from enum import Enum
from types import ModuleType, NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import drivers.types
import gateway.domain
from drivers.message import Form, Message, Moment, Quantity

FLOATS = st.floats(allow_nan=True, allow_infinity=True)
TEXT = st.text(max_size=8)


def _modules(package: ModuleType) -> list[ModuleType]:
    """The modules of a package."""
    found = pkgutil.iter_modules(package.__path__, f"{package.__name__}.")
    return [importlib.import_module(one.name) for one in found]


def all_records() -> list[type]:
    """Every dataclass of the two modules whose records are stored."""
    found = {}
    for module in (*_modules(drivers.types), *_modules(gateway.domain)):
        for _name, item in inspect.getmembers(module, inspect.isclass):
            if dataclasses.is_dataclass(item) and item is not Message:
                found[item.__name__] = item
    return [found[name] for name in sorted(found)]


def of_type(hint: Any) -> st.SearchStrategy[Any]:
    """Values of a declared type."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is np.ndarray:
        kind = get_args(inner[1])[0]
        whole = st.integers(-(2**63), 2**63 - 1)
        elements = st.booleans() if kind is np.bool_ else whole if kind is np.int64 else FLOATS
        return hnp.arrays(
            np.dtype(kind),
            hnp.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=3),
            elements=elements,
        )
    if origin is Literal:
        return st.sampled_from(inner)
    if origin in (Union, UnionType):
        return st.one_of(*[st.none() if item is NoneType else of_type(item) for item in inner])
    if origin is tuple and len(inner) == 2 and inner[1] is Ellipsis:
        return st.lists(of_type(inner[0]), max_size=3).map(tuple)
    if origin is tuple:
        return st.tuples(*[of_type(item) for item in inner])
    if origin is Mapping:
        return st.dictionaries(TEXT, of_type(inner[1]), max_size=3)
    if hint is object:
        return anything()
    if issubclass(hint, Enum):
        return st.sampled_from(list(hint))
    if hint is Message:
        return messages()
    if dataclasses.is_dataclass(hint):
        hints = get_type_hints(hint)
        return st.builds(hint, **{item.name: of_type(hints[item.name]) for item in dataclasses.fields(hint)})
    return {float: FLOATS, int: st.integers(-(2**53), 2**53), bool: st.booleans(), str: TEXT}[hint]


def messages() -> st.SearchStrategy[Message]:
    """Messages with fields of every kind, messages within them too."""
    plain = st.one_of(st.none(), st.booleans(), st.integers(-(2**53), 2**53), FLOATS, TEXT)
    quantities = st.builds(Quantity, FLOATS, TEXT, st.none() | st.integers(0, 6), st.booleans())
    leaves = st.one_of(plain, quantities, st.builds(Moment, TEXT))
    made = lambda inner: st.builds(  # noqa: E731 - used twice below
        Message, TEXT, st.dictionaries(TEXT, inner, max_size=3), st.sampled_from(Form), TEXT
    )
    return made(st.recursive(leaves, lambda inner: st.one_of(made(inner), st.lists(inner).map(tuple)), max_leaves=4))


def anything() -> st.SearchStrategy[Any]:
    """Scalars, tuples, lists, mappings and arrays, nested."""
    leaves = st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-(2**53), 2**53),
        FLOATS,
        TEXT,
        hnp.arrays(np.float64, 2, elements=FLOATS),
    )
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.lists(inner, max_size=3),
            st.lists(inner, max_size=3).map(tuple),
            st.dictionaries(TEXT, inner, max_size=3),
        ),
        max_leaves=6,
    )


def same(one: Any, two: Any) -> bool:
    """Equal in type and value, NaN equal to NaN, -0.0 unlike 0.0."""
    if type(one) is not type(two):
        return False
    if isinstance(one, np.ndarray):
        return (
            one.dtype == two.dtype
            and one.shape == two.shape
            and np.array_equal(one, two, equal_nan=one.dtype.kind == "f")
        )
    if isinstance(one, float):
        return repr(one) == repr(two)
    if dataclasses.is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(two, f.name)) for f in dataclasses.fields(one))
    if isinstance(one, (tuple, list)):
        return len(one) == len(two) and all(map(same, one, two))
    if isinstance(one, dict):
        return one.keys() == two.keys() and all(same(one[key], two[key]) for key in one)
    return bool(one == two)
