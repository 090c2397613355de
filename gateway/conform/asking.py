"""Puts the written questions to a site's control, and the recorded ones to the double."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from drivers import registry
from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.probes import Allowance, ProbedSession, Prober
from gateway.config import SiteFile
from gateway.say import Say

START_S = 900.0


def prober_of(site: SiteFile, clock: Clock) -> Prober:
    """Who asks this site's control. Raises ConfigError (E-CONFORM-DRIVER)."""
    control = site.controller
    name = f"{control.driver}-prober"
    if name not in registry.known("prober"):
        raise ConfigError("E-CONFORM-DRIVER", site.site.name, driver=control.driver)
    made: Any = registry.load(name, "prober")(site.site.name, control.url, dict(control.settings), clock)
    prober: Prober = made
    return prober


async def recorded(site: SiteFile, allow: Allowance, clock: Clock, say: Say) -> ProbedSession:
    """Ask a control everything within the allowance; raises what the wire raises, and where nobody starts a program."""
    prober = prober_of(site, clock)
    probes = prober.probes(allow)
    programs = sum(probe.act == "program" for probe in probes)
    say("P-CONFORM-ASK", who=site.site.name, count=len(probes), programs=programs)
    session = await prober.ask(probes, say, site.controller.timeout_s, START_S)
    return replace(session, about={**session.about, "allow": allow, "date": clock.utc().date().isoformat()})


async def replayed(site: SiteFile, session: ProbedSession, clock: Clock, say: Say) -> ProbedSession:
    """Ask the double at ``site`` what the control was asked and answered; what it was not asked is left out."""
    probes = tuple(answer.probe for answer in session.answers if answer.asked)
    say("P-CONFORM-ASK", who="the double", count=len(probes), programs=sum(one.act == "program" for one in probes))
    return await prober_of(site, clock).ask(probes, say, site.controller.timeout_s, START_S)
