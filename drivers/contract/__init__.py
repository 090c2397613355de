"""What every controller behind the port must do, as checks that anybody can run on a control of their own.

A check is a coroutine function of a `Subject`: an open controller on a machine (better: on its double) where one table
may be written, and somebody who acts there as a person would. It returns nothing, or raises `ContractBroken` naming
the rule; what the port itself raises passes on. Checks may be run in any order, each on a fresh subject. They know no
test framework: `for check in CHECKS: await check(subject)`. Here nothing is asked of one maker.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

from drivers.contract.loading import (
    loads_and_acts,
    refuses_what_it_cannot_hold,
    restores,
    stays_off_where_told,
    switches_as_declared,
)
from drivers.contract.reading import (
    bounds_its_tables,
    means_what_the_proof_says,
    names_its_machine,
    says_what_it_can,
    shows_what_acts,
)
from drivers.contract.subject import Subject

Check = Callable[[Subject], Coroutine[Any, Any, None]]

CHECKS: tuple[Check, ...] = (
    says_what_it_can,
    names_its_machine,
    bounds_its_tables,
    shows_what_acts,
    means_what_the_proof_says,
    loads_and_acts,
    stays_off_where_told,
    restores,
    refuses_what_it_cannot_hold,
    switches_as_declared,
)
