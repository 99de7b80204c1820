"""All commands together, and what becomes of their errors."""

import json
import os
import sys
from typing import cast

import typer

from recorder.cli import commands_drive, commands_felics, commands_record, commands_service
from recorder.errors import RecorderError

_USAGE_ERROR = cast(type[Exception], typer.BadParameter.__mro__[2])
"""Click's ``ClickException``; newer versions of typer carry a click of their own."""

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Records a train's cameras and GNSS receiver: lossless, every stamp and every gap accounted for.",
    epilog="Exit codes: 0 done, sound or healthy; 1 failed, damaged or degraded; 2 bad input; 3 not running.",
)
commands_record.register(app)
commands_service.register(app)
commands_drive.register(app)
commands_felics.register(app)


def main(arguments: list[str] | None = None) -> None:
    """Run one command and exit with its code; an error becomes one line on standard error."""
    arguments = sys.argv[1:] if arguments is None else arguments
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123
        else:
            getattr(sys, name).reconfigure(errors="replace")  # a terminal may not know ± or the table's lines
    sys.exit(_run(arguments))


def _run(arguments: list[str]) -> int:
    if any(0xDC80 <= ord(letter) <= 0xDCFF for argument in arguments for letter in argument):
        return _fail("a path that is not UTF-8 cannot be used; rename it", 2, arguments)
    try:
        code = app(arguments, standalone_mode=False)
        sys.stdout.flush()
    except RecorderError as error:
        return _fail(str(error), error.exit_code, arguments)
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted", 1, arguments)
    except BrokenPipeError:
        _give_up_output()  # the reader has gone (a pager, head)
        return 1
    except OSError as error:
        _give_up_output()
        return _fail(f"{error.filename or 'standard output'}: {error.strerror or error}", 1, arguments)
    except _USAGE_ERROR as error:
        return _fail(_usage(error), 2, arguments)
    except Exception as error:
        if os.environ.get("RECORDER_DEBUG"):
            raise
        line = f"unexpected {type(error).__name__}: {error}; a fault of ours, RECORDER_DEBUG=1 tells more"
        return _fail(line, 1, arguments)
    return int(code or 0)


def _give_up_output() -> None:
    """Nothing more may be written to standard output, not even what is buffered."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _usage(error: Exception) -> str:
    """A wrong call in one line."""
    message = error.format_message() if hasattr(error, "format_message") else str(error)
    return " ".join(message.replace("Value error, ", "").split())


def _fail(line: str, code: int, arguments: list[str]) -> int:
    if "--json" in arguments:
        print(json.dumps({"error": line, "exit_code": code}))
    if line:
        print(f"recorder: {line}", file=sys.stderr)
    return code
