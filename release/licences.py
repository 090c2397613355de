"""`python -m release.licences SBOM PAGE`: licences of a shop-floor PC, from a CycloneDX file to a page."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

HEAD = """# Licences of what is installed

For those responsible for the software in a plant: every package that `requirements.lock` installs on a
shop-floor PC with Linux, with its declared licence. On Windows colorama (BSD-3-Clause) is added. `make
sbom` writes this page and `dist/trueflank.cdx.json` (CycloneDX) from the installed packages.

trueflank's own licence: **the owner has not yet chosen one**. Until then nobody else may copy, change or
redistribute it.

asyncua is LGPL. It is used unchanged as a library and can be replaced by another version; this source contains none of
it. Anyone who redistributes a bundle also redistributes the licences: each wheel contains its own text.

The operator's page uses uplot and three. Their release files are in `gateway/web/vendor`, unchanged, with their
licences; `vendored.toml` there states version and hash.

| package | version | licence |
|---|---|---|
"""
NOT_NAMED = "not named by the package"


def licence(component: dict[str, Any]) -> str:
    """What a component says of its licence, in one line."""
    given = [one.get("expression") or one.get("license", {}) for one in component.get("licenses", [])]
    names = [one if isinstance(one, str) else str(one.get("id") or one.get("name") or "") for one in given]
    short = [" ".join(name.split()) for name in names if name]
    told = [name for name in dict.fromkeys(short) if len(name) < 80 and not name.startswith("declared license of")]
    return " / ".join(name.removeprefix("License :: ").removeprefix("OSI Approved :: ") for name in told) or NOT_NAMED


def page(bill: dict[str, Any]) -> str:
    """The page."""
    rows = sorted(bill["components"], key=lambda one: str(one["name"]).lower())
    return HEAD + "".join(f"| {one['name']} | {one['version']} | {licence(one)} |\n" for one in rows)


def main(arguments: list[str]) -> int:
    """Write the page; 1 where a package names no licence."""
    bill = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    Path(arguments[1]).write_text(page(bill), encoding="utf-8")
    unnamed = [one["name"] for one in bill["components"] if licence(one) == NOT_NAMED]
    for name in unnamed:
        print(f"licences: {name} names none")
    print(f"licences: {len(bill['components'])} packages in {arguments[1]}")
    return 1 if unnamed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
