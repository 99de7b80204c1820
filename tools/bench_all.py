"""Run every bench and write docs/figures.md (``make bench``)."""

import json
import subprocess
import sys

from bench.figures import ROOT, as_markdown

HEAD = """# Figures

Written by `make bench`; every figure has the bench that makes it, the commit and the machine it ran on.
"""


def main() -> None:
    """All of tools/bench, in the order of their names."""
    parts = [HEAD]
    for bench in sorted((ROOT / "tools" / "bench").glob("*.py")):
        if bench.name == "figures.py":
            continue
        print(f"running {bench.name}", file=sys.stderr)
        told = subprocess.run(
            [sys.executable, bench, "--json", *sys.argv[1:]], stdout=subprocess.PIPE, text=True, check=True
        )
        parts.append(as_markdown(json.loads(told.stdout)) + "\n")
    (ROOT / "docs" / "figures.md").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
