"""Tables acting on the commands: first order, second order and the exact flank, against code that shares nothing."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from gateway.correct.flank.tables import Product, Table, TableGrid, with_tables
from gateway.errors import ModelError
from gateway.gear.envelope import exact
from gateway.gear.first_order import bounded_first_order, first_order
from gateway.gear.grinding import Grinding
from gateway.gear.wheel_passage import contact_line
from gateway.model.error_model import yk7350b
from tests.unit.correct.machines import TURN, as_errors, corrected_flank, machine
from tests.unit.gear.machines import RV40E, Commands, slow_exact, spread

Z, C = np.linspace(-10.0, 10.0, 5), np.deg2rad(np.arange(0.0, 361.0, 45.0))
POINTS = [(0.0, 0.03, -3.0), (7.0, -0.05, 1.3), (31.0, 0.011, 4.4)]


def tables(seed: int, size: float = 1.0) -> tuple[list[Table], Product]:
    """X(Z), X(C), C(Z), C(C), Z(Z) and X(X) of a few um and arcsec times ``size``, and a product X(Z)*(C)."""
    rng = np.random.default_rng(seed)
    x = np.linspace(-200.0, 0.0, 11)
    wanted = [
        ("X", 0.003, "Z", Z, None),
        ("X", 0.003, "C", C, TURN),
        ("C", 4e-5, "Z", Z, None),
        ("C", 4e-5, "C", C, TURN),
    ]
    wanted += [("Z", 0.004, "Z", Z, None), ("X", 0.002, "X", x, None)]
    found = [
        Table.of(TableGrid(out, over, nodes, period), size * rng.normal(0.0, u, nodes.size - (period is not None)))
        for out, u, over, nodes, period in wanted
    ]
    over_z = Table(TableGrid("X", "Z", Z), size * rng.normal(0.0, 0.05, Z.size))
    over_c = Table.of(TableGrid("X", "C", C, TURN), rng.normal(0.0, 0.05, C.size - 1))
    return found, Product(over_z, over_c)


def moved(q: Commands, found: list[Table], product: Product | None = None) -> Commands:
    """Commands with tables added, by the text of their definition: broken lines, ends held, a turn repeats."""

    def read(table: Table) -> float:
        at = float(q[table.grid.over])
        nodes = table.grid.nodes
        if table.grid.period is not None:
            at = nodes[0] + (at - nodes[0]) % table.grid.period
        at = min(max(at, nodes[0]), nodes[-1])
        i = min(max(int(np.searchsorted(nodes, at)) - 1, 0), nodes.size - 2)
        share = (at - nodes[i]) / (nodes[i + 1] - nodes[i])
        return float((1.0 - share) * table.values[i] + share * table.values[i + 1])

    new = {name: float(value) for name, value in q.items()}
    for table in found:
        new[table.grid.out] += read(table)
    if product is not None:
        new[product.first.grid.out] += read(product.first) * read(product.second)
    return {name: np.asarray(value) for name, value in new.items()}


@pytest.mark.parametrize("seed", [2, 5])
def test_the_exact_flank_has_tables_and_products_in_its_commands(seed: int) -> None:
    grinding, _ = machine(seed)
    found, product = tables(seed)
    acting = with_tables(grinding, [*found, product])
    for k, theta, z in POINTS:
        slow = slow_exact(grinding, k, theta, z, lambda q: moved(q, found, product))
        assert float(exact(acting, k, theta, z)) == pytest.approx(slow, abs=1e-10)
        assert abs(slow - float(exact(grinding, k, theta, z))) > 1e-4


def test_first_order_in_the_tables_misses_nanometres_and_grows_with_their_square() -> None:
    """Tables taken as errors of the axes they are read at: that is what the exact flank was made of before."""
    grinding, _ = machine(3)
    t, z = spread(RV40E, 7)[:, None], np.array([-3.9, 1.3])
    missed = []
    for size in (1.0, 10.0):
        acting = with_tables(grinding, tables(3, size)[0][:4])
        missed.append(float(np.max(np.abs(exact(acting, 4.0, t, z) - exact(as_errors(acting), 4.0, t, z)))))
    assert 2e-7 < missed[0] < 1e-5
    assert 20.0 < missed[1] / missed[0] < 300.0


def test_first_order_is_that_of_tables_as_errors_of_the_axes_they_are_read_at() -> None:
    grinding, grid = machine(5)
    found, product = tables(5)
    acting = with_tables(grinding, found[:4])
    e1 = first_order(acting, grid.k, grid.theta, grid.z)
    np.testing.assert_allclose(np.broadcast_to(e1, grid.shape), corrected_flank(grinding, grid, found[:4]), atol=1e-12)
    np.testing.assert_allclose(e1, first_order(as_errors(acting), grid.k, grid.theta, grid.z), atol=1e-12)
    both = with_tables(acting, [product])
    whole = corrected_flank(grinding, grid, [*found[:4], product])
    e1 = first_order(both, grid.k, grid.theta, grid.z)
    np.testing.assert_allclose(np.broadcast_to(e1, grid.shape), whole, atol=1e-12)


def test_second_order_agrees_off_the_nodes() -> None:
    grinding, grid = machine(5)
    found, product = tables(5)
    acting = with_tables(grinding, [*found, product])
    second = bounded_first_order(acting, grid.k, grid.theta, 1.3).second
    np.testing.assert_allclose(exact(acting, grid.k, grid.theta, 1.3), second, atol=3e-6)


@pytest.mark.parametrize("seed", [1, 2])
def test_kinks_at_the_nodes_end_no_search(seed: int) -> None:
    """A table's kink holds the deepest cut of many heights; the whole flank is found, and no nanometre off it."""
    grinding, grid = machine(seed)
    found, product = tables(seed)
    acting = with_tables(grinding, [*found, product])
    whole = exact(acting, grid.k, grid.theta, np.linspace(-5.0, 5.0, 9))
    for i in (0, 5, 11):
        slow = slow_exact(grinding, 4.0, float(grid.thetas[i]), 0.0, lambda q: moved(q, found, product))
        assert whole[4, i, 4] == pytest.approx(slow, abs=1e-7)


def test_a_constant_is_a_machine_that_stands_elsewhere() -> None:
    """A zero moved by a table, and the same machine with its axis shifted as much."""
    zero = Table(TableGrid("X", "Z", np.zeros(1)), np.array([0.004]))
    grinding = Grinding(yk7350b({"B0Z": 3e-5}), RV40E, 160.0)
    shifted = replace(grinding, chain=yk7350b({"B0Z": 3e-5, "EXX": 0.004}))
    t, z = spread(RV40E, 5)[:, None], np.array([-4.0, 3.0])
    acting = with_tables(grinding, [zero])
    np.testing.assert_allclose(exact(acting, 3.0, t, z), exact(shifted, 3.0, t, z), atol=1e-12)
    line, same = contact_line(acting, 3.0, 1.0, t), contact_line(shifted, 3.0, 1.0, t)
    np.testing.assert_allclose(line.points, same.points, atol=1e-9)


def test_acting_tables_are_plain_data_of_axes_that_the_machine_has() -> None:
    grinding, _ = machine(1)
    acting = with_tables(grinding, tables(1)[0])
    again = copy.deepcopy(acting)
    assert float(exact(again, 1.0, 0.02, 1.0)) == float(exact(acting, 1.0, 0.02, 1.0))
    with pytest.raises(ModelError, match="E-CHAIN-AXIS"):
        with_tables(grinding, [Table(TableGrid("Y", "Z", Z), np.zeros(5))])
