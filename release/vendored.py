"""`python -m release.vendored SBOM`: vendored libraries of the page, checked by their hashes, into a CycloneDX file."""

from __future__ import annotations

import base64
import hashlib
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "gateway" / "web" / "vendor"
LIST = "vendored.toml"


def libraries(folder: Path = FOLDER) -> list[dict[str, Any]]:
    """Every library of the list."""
    found: list[dict[str, Any]] = tomllib.loads((folder / LIST).read_text(encoding="utf-8"))["library"]
    return found


def faults(folder: Path = FOLDER) -> list[str]:
    """Files that are not as their makers released them, that nobody listed, or that are not there."""
    wanted = {name: one["sha256"] for library in libraries(folder) for name, one in library["files"].items()}
    licences = {library["licence_file"] for library in libraries(folder)}
    there = {path.name for path in folder.iterdir() if path.is_file()}
    said = [f"{name}: is not in {LIST}" for name in sorted(there - set(wanted) - licences - {LIST})]
    said += [f"{name}: is missing" for name in sorted((set(wanted) | licences) - there)]
    for name in sorted(there & set(wanted)):
        if hashlib.sha256((folder / name).read_bytes()).hexdigest() != wanted[name]:
            said.append(f"{name}: differs from what was released")
    return said


def component(library: dict[str, Any]) -> dict[str, Any]:
    """A library as a CycloneDX component; the hash is that of its package."""
    kind, _, digest = str(library["integrity"]).partition("-")
    name, version = library["name"], library["version"]
    return {
        "type": "library",
        "bom-ref": f"pkg:npm/{name}@{version}",
        "name": name,
        "version": version,
        "purl": f"pkg:npm/{name}@{version}",
        "licenses": [{"license": {"id": library["licence"]}}],
        "hashes": [{"alg": kind.upper().replace("SHA", "SHA-"), "content": base64.b64decode(digest).hex()}],
        "externalReferences": [{"type": "distribution", "url": library["package"]}],
        "properties": [
            {"name": f"trueflank:file:{file}", "value": f"sha256:{one['sha256']}"}
            for file, one in library["files"].items()
        ],
    }


def main(arguments: list[str]) -> int:
    """Add them to the bill; 1 where a file is not as released."""
    if said := faults():
        for one in said:
            print(f"vendored: {one}")
        return 1
    path = Path(arguments[0])
    bill = json.loads(path.read_text(encoding="utf-8"))
    own = [component(one) for one in libraries()]
    known = {one["bom-ref"] for one in own}
    bill["components"] = [one for one in bill["components"] if one.get("bom-ref") not in known] + own
    path.write_text(json.dumps(bill, indent=2) + "\n", encoding="utf-8")
    print(f"vendored: {len(own)} libraries of the page in {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
