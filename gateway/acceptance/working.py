"""Where a check works: the site, its devices opened for the check alone; and how one ended."""

from __future__ import annotations

from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from drivers.clock import Clock
from gateway.acceptance.results import seen
from gateway.config import SiteFile
from gateway.say import Say
from gateway.workflow.run.context import RunContext, open_context, run_or_look


class NotHere(Exception):
    """A check that this site has nothing for; ``why`` says it."""

    def __init__(self, key: str, /, **fields: object) -> None:
        """The line by its key and fields, as `seen` has them."""
        super().__init__(key)
        self.why = seen(key, **fields)


@dataclass(frozen=True, slots=True)
class SiteDesk:
    """A site under acceptance. Whoever makes one has the consent that its checks need."""

    site: SiteFile
    site_path: Path
    clock: Clock
    say: Say

    @asynccontextmanager
    async def bench(self, instruments: Collection[str] = ()) -> AsyncIterator[RunContext]:
        """The control and these instruments, open; a run folder is left only where an instrument was at work."""
        state = "accepting"
        with run_or_look(self.site, self.site_path, state, look=not instruments) as folder:
            at = open_context(
                self.site,
                self.site_path,
                folder=folder,
                clock=self.clock,
                say=self.say,
                instruments=tuple(instruments),
            )
            async with at as opened:
                yield opened
            folder.set_state("accepted")
