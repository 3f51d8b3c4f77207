"""Known vulnerabilities of the installed packages, by pip-audit: `python .ci/audit.py`, in the environment to check.

Ends with 0 where there are none, 1 where there are some, and 2 where that cannot be known: pip-audit itself reports a
package that its registry does not answer for as skipped, and no vulnerability.
"""

import json
import subprocess
import sys
from typing import Any

OURS = "tensegraph"
COMMAND = ("-m", "pip_audit", "--format", "json", "--progress-spinner", "off")


def audited() -> list[dict[str, Any]]:
    """Return what pip-audit says of each package.

    Raises:
        LookupError: when it is not installed, or does not answer.
    """
    done = subprocess.run([sys.executable, *COMMAND], capture_output=True, text=True, check=False)
    if "No module named" in done.stderr:
        raise LookupError("pip-audit is not installed: pip install pip-audit")
    try:
        packages: list[dict[str, Any]] = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError) as error:
        *_, reason = done.stderr.strip().splitlines() or ["it says nothing"]
        raise LookupError(f"the registry of vulnerabilities cannot be reached: {reason}") from error
    return [package for package in packages if package["name"] != OURS]


def report(packages: list[dict[str, Any]]) -> tuple[list[str], int]:
    """Return the lines to print, and the exit code."""
    known = [package for package in packages if "skip_reason" not in package]
    if not known:
        return [f"the registry of vulnerabilities answers for none of {len(packages)} packages"], 2
    found = [
        f"{package['name']} {package['version']}: {bug['id']}, mended in: {', '.join(bug['fix_versions']) or 'none'}"
        for package in known
        for bug in package["vulns"]
    ]
    skipped = [package["name"] for package in packages if "skip_reason" in package]
    lines = [f"{len(known)} packages, {len(found)} known vulnerabilities", *found]
    if skipped:
        lines.append(f"not known to the registry: {', '.join(skipped)}")
    return lines, 1 if found else 2 if skipped else 0


if __name__ == "__main__":
    try:
        lines, code = report(audited())
    except LookupError as error:
        lines, code = [str(error)], 2
    print(*lines, sep="\n")
    sys.exit(code)
