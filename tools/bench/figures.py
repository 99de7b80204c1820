"""The one form in which every bench tells its figures.

Run as a program it runs every bench and writes docs/figures.md and the tables between marks in
the README (``make bench``).
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
    value: float | None
    """None where this machine can't measure it."""
    unit: str
    goal: float
    better: Literal["higher", "lower"]
    n: int
    """How many trials the value stands on."""
    peers: dict[str, float] = field(default_factory=dict)
    """The same measured on others in the same run."""
    reason: str = ""
    """What is lacking where there is no value."""

    @property
    def meets(self) -> bool:
        if self.value is None:
            return False
        return self.value >= self.goal if self.better == "higher" else self.value <= self.goal

    def to_dict(self) -> dict[str, Any]:
        return {**asdict(self), "meets": self.meets}


@dataclass(frozen=True, slots=True)
class Table:
    """What stands beside the figures, without goals."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str | float]]
    """A name and its numbers."""
    headline: Sequence[str] = ()
    """The names of those rows that the README shows."""


@dataclass(frozen=True, slots=True)
class Measured:
    """All that a bench has to say."""

    figures: Sequence[Figure]
    tables: Sequence[Table] = ()


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


def report(bench: str, measure: Callable[[bool], Measured]) -> None:
    """The whole command line of a bench: ``--quick`` takes fewer trials, ``--json`` prints one object."""
    parser = argparse.ArgumentParser(description=measure.__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer trials, under five minutes")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    told = as_json(bench, measure(options.quick))
    print(json.dumps(told) if options.json else as_markdown(told))


def as_json(bench: str, measured: Measured) -> dict[str, Any]:
    """The form that everything else is made from."""
    return {
        "bench": bench,
        "commit": commit(),
        "machine": machine(),
        "figures": [figure.to_dict() for figure in measured.figures],
        "tables": [asdict(table) for table in measured.tables],
    }


def as_markdown(told: dict[str, Any]) -> str:
    """One bench as a table, and those beside it."""
    lines = [
        f"## {told['bench']}",
        "",
        _origin(told),
        "",
        "| figure | value | goal | meets | n | peers |",
        "|---|---|---|---|---|---|",
    ]
    for figure in told["figures"]:
        sign = "≥" if figure["better"] == "higher" else "≤"
        peers = ", ".join(f"{name} {value:.4g}" for name, value in figure["peers"].items())
        lines.append(
            f"| `{figure['name']}` | {_value(figure)} | {sign} {figure['goal']:g} |"
            f" {'yes' if figure['meets'] else '**no**'} | {figure['n']} | {peers} |"
        )
    for table in told["tables"]:
        lines += ["", table["caption"], "", *_rows(table["head"], table["rows"])]
    return "\n".join(lines)


def _origin(told: dict[str, Any]) -> str:
    return f"`tools/bench/{told['bench']}.py` at {told['commit']} on {told['machine']}"


def _value(figure: dict[str, Any]) -> str:
    if figure["value"] is None:
        return f"not measurable here: {figure['reason']}"
    return f"{figure['value']:.4g} {figure['unit']}"


def _rows(head: Sequence[str], rows: Sequence[Sequence[str | float]]) -> list[str]:
    lines = [head, ["---"] * len(head), *([name, *map(_number, numbers)] for name, *numbers in rows)]
    return [f"| {' | '.join(map(str, cells))} |" for cells in lines]


def _number(value: str | float) -> str:
    if isinstance(value, str | int):
        return str(value)
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def with_headlines(readme: str, told: dict[str, Any]) -> str:
    """The README with what stands between this bench's two marks measured anew."""
    begin, end = f"<!-- {told['bench']}: written by make bench -->\n", f"<!-- {told['bench']}: end -->"
    before, found, rest = readme.partition(begin)
    if not found:
        return readme
    lines = [_origin(told) + "."]
    for table in told["tables"]:
        shown = [row for row in table["rows"] if row[0] in table["headline"]]
        if shown:
            lines += [table["caption"], "", *_rows(table["head"], shown)]
    return before + begin + "\n".join(lines) + "\n" + end + rest.partition(end)[2]


HEAD = """# Figures

Written by `make bench`; each figure has the bench that makes it, the commit and the machine it ran on.
"""


def main() -> None:
    """All benches, in the order of their names; options are handed on to each."""
    parts = [HEAD]
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for bench in sorted(Path(__file__).parent.glob("*.py")):
        if "report(" not in bench.read_text(encoding="utf-8") or bench == Path(__file__):
            continue  # a part of another one
        print(f"running {bench.name}", file=sys.stderr)
        command = [sys.executable, str(bench), "--json", *sys.argv[1:]]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        told = json.loads(done.stdout)
        parts.append(as_markdown(told) + "\n")
        readme = with_headlines(readme, told)
    (ROOT / "docs" / "figures.md").write_text("\n".join(parts), encoding="utf-8")
    (ROOT / "README.md").write_text(readme, encoding="utf-8")


if __name__ == "__main__":
    main()
