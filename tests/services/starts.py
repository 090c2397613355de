"""Starts the service as a program of its own and looks at it once: `python starts.py SITE TOKEN NAME`.

Prints, as one line of JSON: ``pid``, ``url``, the ``first`` picture, and how long after the start it was there:
``took_s`` by the clock, ``waited_s`` of it ready and without a processor, which other programs had. Nothing of ours is
imported, and nothing else is done here. Ends with the service.
"""
# ruff: noqa: TID251, S310

from __future__ import annotations

import json
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

SITE, TOKEN, NAME = sys.argv[1:]


def waited_s(pid: int | str) -> float:
    """How long a process's first thread was ready and got no processor so far, s."""
    return int(Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()[1]) / 1e9


def main() -> None:
    """Start, look, tell, wait."""
    begun, own = time.monotonic(), waited_s("self")
    words = [sys.executable, "-m", "gateway.cli", "serve", SITE, "--port", "0"]
    child = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    url = next((word for word in child.stdout.readline().split() if word.startswith("http")), "")
    head = {"Authorization": f"Bearer {Path(TOKEN).read_text(encoding='ascii').strip()}"}
    asked = urllib.request.Request(f"{url}api/v1/sites/{NAME}/status", headers=head)
    with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(asked, timeout=60.0) as answer:
        first = json.load(answer)
    told = {"took_s": time.monotonic() - begun, "waited_s": waited_s(child.pid) + waited_s("self") - own}
    print(json.dumps({"pid": child.pid, "url": url, "first": first, **told}), flush=True)
    child.wait()


main()
