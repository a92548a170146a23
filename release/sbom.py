"""What is in the program: a bill of materials (CycloneDX 1.5, JSON) of everything that Cargo.lock links into a crate.

    release/sbom.py CRATE >FILE

The same lock file gives the same bytes: no time, no random number.
"""

import json
import re
import subprocess
import sys
import tomllib
import uuid
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main():
    host = re.search(r"^host: (.*)$", run("rustc", "-vV"), re.MULTILINE)[1]
    metadata = json.loads(run("cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", host))
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text())
    sums = {(entry["name"], entry["version"]): entry.get("checksum") for entry in lock["package"]}
    root = next(key for key in metadata["workspace_members"] if packages[key]["name"] == sys.argv[1])

    reached, waiting = {}, [root]
    while waiting:
        key = waiting.pop()
        if key not in reached:
            reached[key] = linked(nodes[key])
            waiting += reached[key]
    components = {key: component(packages[key], sums) for key in reached}
    # Of what they are, not of where they lie on this machine.
    contents = json.dumps(sorted(components.values(), key=lambda found: found["bom-ref"]))
    print(json.dumps({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, contents)}",
        "version": 1,
        "metadata": {"component": {**components.pop(root), "type": "application"}},
        "components": sorted(components.values(), key=lambda found: found["bom-ref"]),
        "dependencies": sorted(
            ({"ref": reference(packages[key]), "dependsOn": sorted({reference(packages[to]) for to in linked})}
             for key, linked in reached.items()),
            key=lambda found: found["ref"],
        ),
    }, indent=2))


def run(*command):
    return subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout


def linked(node):
    """Dependencies that end up in the program: neither those of tests nor those of build scripts."""
    return [dep["pkg"] for dep in node["deps"] if any(kind["kind"] is None for kind in dep["dep_kinds"])]


def reference(package):
    return f"pkg:cargo/{package['name']}@{package['version']}"


def component(package, sums):
    found = {
        "type": "library",
        "bom-ref": reference(package),
        "name": package["name"],
        "version": package["version"],
        "purl": reference(package),
    }
    if package["license"]:
        # An older way to write `OR`.
        found["licenses"] = [{"expression": package["license"].replace("/", " OR ")}]
    checksum = sums.get((package["name"], package["version"]))
    if checksum:
        found["hashes"] = [{"alg": "SHA-256", "content": checksum}]
    return found


if __name__ == "__main__":
    main()
