"""The installed command as a user runs it."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Ran:
    """What a command said and how it ended."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        told = json.loads(self.out)
        assert isinstance(told, dict)
        return told

    @property
    def drive(self) -> Path:
        """The last line on standard output."""
        return Path(self.out.strip().splitlines()[-1])

    @property
    def problem(self) -> str:
        """The one line on standard error; fails if there is another, or a traceback."""
        lines = self.err.strip().splitlines()
        assert len(lines) == 1, self.err
        assert lines[0].startswith("recorder: "), self.err
        return lines[0]


def recorder(*arguments: str | Path, cwd: Path | None = None, timeout: float = 120) -> Ran:
    """Run ``recorder`` to its end."""
    command = [sys.executable, "-m", "recorder", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, cwd=cwd, check=False)
    assert "Traceback" not in done.stderr, done.stderr
    return Ran(done.returncode, done.stdout, done.stderr)
