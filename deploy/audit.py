"""`make audit`: known advisories of packages in requirements.lock, by pip-audit.

Where its data cannot be reached it says so, and exits with 3: silence is no all-clear.
Then the review that docs/security.md records is what there is. Standard library only.
"""

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path

CHECKOUT = Path(__file__).parent.parent
LOCK = CHECKOUT / "requirements.lock"
TOOL = "pip-audit==2.10.1"
PATIENCE_S = 300
SOURCES = ("pypi", "osv")


def report(source: str) -> list[dict[str, object]] | None:
    """Return pip-audit's result by dependency; None if it could not be run."""
    uv = shutil.which("uv", path=str(Path(sys.executable).parent)) or "uv"
    command = [
        *(uv, "tool", "run", TOOL, "--requirement", str(LOCK), "--no-deps"),
        *("--disable-pip", "--progress-spinner", "off", "--timeout", "15"),
        *("--vulnerability-service", source, "--format", "json"),
    ]
    try:
        done = subprocess.run(
            command, check=False, capture_output=True, timeout=PATIENCE_S
        )
        dependencies = json.loads(done.stdout)["dependencies"]
    except (OSError, ValueError, KeyError, subprocess.TimeoutExpired):
        return None
    return list(dependencies)


def lines_of(dependencies: list[dict[str, object]]) -> list[str]:
    lines = []
    for package in dependencies:
        advisories = package.get("vulns", [])
        assert isinstance(advisories, list)  # noqa: S101 - what pip-audit promises
        for advisory in advisories:
            better = ", ".join(advisory["fix_versions"]) or "nothing yet"
            names = ", ".join((advisory["id"], *advisory.get("aliases", ())))
            lines.append(
                f"{package['name']} {package['version']}: {names}; mended in {better}"
            )
    return lines


def main() -> int:
    argparse.ArgumentParser(description=__doc__).parse_args()
    for source in SOURCES:
        dependencies = report(source)
        if dependencies is None:
            continue
        skipped = [str(each["name"]) for each in dependencies if "skip_reason" in each]
        lines = lines_of(dependencies)
        if len(skipped) == len(dependencies):
            continue
        sys.stdout.write("\n".join(lines) + "\n" if lines else "")
        n_looked_up = len(dependencies) - len(skipped)
        sys.stdout.write(
            f"{n_looked_up} asked about at {source}, {len(lines)} advisories\n"
        )
        if skipped:
            sys.stdout.write(f"not to be found there: {', '.join(skipped)}\n")
        return 1 if lines else 3 if skipped else 0
    sys.stdout.write(
        f"nobody could be asked ({', '.join(SOURCES)} not reached from here); "
        "the last review by hand is in docs/security.md\n"
    )
    return 3


if __name__ == "__main__":
    sys.exit(main())
