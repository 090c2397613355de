"""The plan of set-ups: what a site file may say, what is inherited, and the order with the fewest remountings."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from drivers.errors import ConfigError
from gateway.workflow.errors21.setups import key_of, plan_setups, remountings, select_setups, spans
from tests.unit.components.site import SETUPS, setup, site_of


def test_the_whole_plan_comes_in_order_with_each_axis_own_positioning() -> None:
    plan = plan_setups(site_of())
    keys = [one.key for one in plan]
    assert sorted(keys) == sorted([*(key_of(one) for one in site_of().setups), "EXX-X1", "EZZ-Z1", "ECC-C1"])
    assert len(set(keys)) == len(keys)
    square = [keys.index(name) for name in ("B0Z-X1", "B0Z-Z1", "B0Z-R-X1", "B0Z-R-Z1")]
    assert square == list(range(square[0], square[0] + 4))
    assert keys.index("A0C-Z1-C1at180") == keys.index("A0C-Z1-C1at0") + 1


def test_no_other_order_of_these_set_ups_needs_fewer_remountings() -> None:
    live = [one for one in plan_setups(site_of(SETUPS[:8])) if one.setup.instrument in ("straightness", "level")]
    least = min(remountings(order) for order in itertools.permutations(live))
    assert remountings(live) == least


def test_what_is_not_said_is_as_the_axis_has_it() -> None:
    own = setup("EYX", "X1", repetitions=2, stable=0.2, targets={"first": -100.0, "last": 0.0, "count": 5})
    plan = {one.key: one for one in plan_setups(site_of([own, setup("EAX", "X1", "level")]))}
    short, inherited = plan["EYX-X1"].axis.measure, plan["EAX-X1"].axis.measure
    assert short.targets is not None
    assert (short.repetitions, short.stable, short.targets.count, short.component) == (2, 0.2, 5, "EYX")
    assert inherited.targets is not None
    assert (inherited.repetitions, inherited.targets.count, inherited.instrument) == (5, 11, "level")
    assert (plan["EYX-X1"].unit, plan["EAX-X1"].unit) == ("um", "arcsec")
    assert plan["EXX-X1"].positioning
    assert not plan["EYX-X1"].positioning


def test_uncertainties_of_instruments_are_given_or_usual() -> None:
    plan = {one.key: one for one in plan_setups(site_of([setup("EYX", "X1", U=0.8), setup("EAX", "X1", "level")]))}
    assert plan["EYX-X1"].systematic == pytest.approx(0.4)
    assert plan["EAX-X1"].systematic == pytest.approx(0.15)
    assert plan["EXX-X1"].systematic == pytest.approx((0.3 + 0.0015 * 400.0) / 2.0)
    assert plan["ECC-C1"].systematic == pytest.approx(0.5)


WRONG: list[tuple[dict[str, Any], str]] = [
    (setup("EYZ", "X1"), "belongs to axis Z, not X"),
    (setup("EYX", "X9"), "there is no axis of that name (known: C1, X1, Z1"),
    (setup("EYX", "X1", "nothing"), "no instrument of that name"),
    (setup("EYX", "X1", ""), "needs an instrument"),
    (setup("EYX", "X1", source="file"), "needs path and datum"),
    (setup("EYX", "X1", "", source="none"), "needs assumed"),
    (setup("A0C", "X1"), "measured as"),
    (setup("C0X", "X1"), "measured as"),
    (setup("A0C", "Z1", park={"Q": 0.0}), "park must name other axes"),
    (setup("A0C", "Z1", park={"Z1": 0.0}), "cannot be parked"),
    (setup("EXC", "C1", offset_mm=[1.0, 0.0, 0.0]), "along the axis"),
    (setup("straight", "X1"), "must be an error motion"),
    (setup("EYX", "X1", assumed=-1.0), "must be above 0"),
    (setup("EYX", "X1", offsett_mm=[1.0, 0.0, 0.0]), "did you mean offset_mm?"),
]


@pytest.mark.parametrize(("wrong", "why"), WRONG)
def test_what_a_plan_may_not_say(wrong: dict[str, Any], why: str) -> None:
    with pytest.raises(ConfigError) as caught:
        site_of([wrong])
    assert why in str(caught.value)


def test_a_set_up_may_not_be_there_twice_but_parked_elsewhere() -> None:
    with pytest.raises(ConfigError, match="twice"):
        site_of([setup("EYX", "X1"), setup("EYX", "X1", "level")])
    assert len(site_of(SETUPS).setups) == len(SETUPS)


def test_some_of_a_plan_can_be_asked_for() -> None:
    plan = plan_setups(site_of())
    assert [one.key for one in select_setups(plan, ("EAX", "A0C-Z1-C1at180"))] == ["EAX-X1", "A0C-Z1-C1at180"]
    assert len(select_setups(plan, ("B0Z",))) == 4
    assert len(select_setups(plan, ())) == len(plan) - 1
    for nobody in ("EBZ", "EYC"):
        with pytest.raises(ConfigError) as caught:
            select_setups(plan, (nobody,))
        assert caught.value.code == "E-SETUP-UNKNOWN"
    with pytest.raises(ConfigError) as caught:
        plan_setups(site_of([]))
    assert caught.value.code == "E-SETUP-NONE"
    assert spans(site_of()) == {"EBZ": 3.0}


def test_a_bar_knows_where_the_table_stood() -> None:
    plan = {one.key: one for one in plan_setups(site_of())}
    at, nothing = np.array([0.0, 300.0]), np.zeros((2, 1, 2))
    found = plan["A0C-Z1-C1at180"].measurement(at, nothing, ["C1"])
    assert (found.turned_deg, found.letter, found.is_motion) == (180.0, "Z", False)
    assert plan["EYX-X1"].measurement(at, nothing, ["C1"]).offset_mm == (0.0, 8.0, 12.0)
