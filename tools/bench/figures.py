"""The one form in which every bench tells its figures.

Run as a program it runs every bench and writes docs/figures.md (``make bench``).
"""

import argparse
import json
import platform
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured number beside its goal."""

    name: str
    value: float
    unit: str
    goal: float
    better: Literal["higher", "lower"]
    n: int
    """How many trials the value stands on."""
    peers: dict[str, float] = field(default_factory=dict)
    """The same measured on others in the same run."""

    @property
    def meets(self) -> bool:
        return self.value >= self.goal if self.better == "higher" else self.value <= self.goal

    def to_dict(self) -> dict[str, Any]:
        return {**asdict(self), "meets": self.meets}


def machine() -> str:
    """Processor, cores and memory of the machine that measures."""
    cpuinfo = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next((line.split(":", 1)[1].strip() for line in cpuinfo if line.startswith("model name")), "?")
    cores = sum(line.startswith("processor") for line in cpuinfo)
    kilobytes = int(Path("/proc/meminfo").read_text(encoding="utf-8").split()[1])
    return f"{model}, {cores} cores, {kilobytes / 2**20:.0f} GiB, Python {platform.python_version()}"


def commit() -> str:
    """The commit that was measured, with a + if the tree differs from it."""
    told = subprocess.run(
        ["git", "describe", "--always", "--dirty=+", "--exclude=*"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return told.stdout.strip() or "unknown"


def report(bench: str, measure: Callable[[bool], Sequence[Figure]]) -> None:
    """The whole command line of a bench: ``--quick`` takes fewer trials, ``--json`` prints one object."""
    parser = argparse.ArgumentParser(description=measure.__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer trials, under five minutes")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    figures = [figure.to_dict() for figure in measure(options.quick)]
    told = {"bench": bench, "commit": commit(), "machine": machine(), "figures": figures}
    print(json.dumps(told) if options.json else as_markdown(told))


def as_markdown(told: dict[str, Any]) -> str:
    """One bench as a table."""
    lines = [
        f"## {told['bench']}",
        "",
        f"`tools/bench/{told['bench']}.py` at {told['commit']} on {told['machine']}",
        "",
        "| figure | value | goal | meets | n | peers |",
        "|---|---|---|---|---|---|",
    ]
    for figure in told["figures"]:
        sign = "≥" if figure["better"] == "higher" else "≤"
        peers = ", ".join(f"{name} {value:.4g}" for name, value in figure["peers"].items())
        lines.append(
            f"| `{figure['name']}` | {figure['value']:.4g} {figure['unit']} | {sign} {figure['goal']:g} |"
            f" {'yes' if figure['meets'] else '**no**'} | {figure['n']} | {peers} |"
        )
    return "\n".join(lines)


HEAD = """# Figures

Written by `make bench`; each figure has the bench that makes it, the commit and the machine it ran on.
"""


def main() -> None:
    """All benches, in the order of their names; options are handed on to each."""
    parts = [HEAD]
    for bench in sorted(Path(__file__).parent.glob("*.py")):
        if "report(" not in bench.read_text(encoding="utf-8") or bench == Path(__file__):
            continue  # a part of another one
        print(f"running {bench.name}", file=sys.stderr)
        command = [sys.executable, str(bench), "--json", *sys.argv[1:]]
        told = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        parts.append(as_markdown(json.loads(told.stdout)) + "\n")
    (ROOT / "docs" / "figures.md").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
