"""The process of the ``grasp-factory`` command: one-line errors and exit codes."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
import warnings
from collections.abc import Iterator
from typing import Any, NoReturn

import click

from grasp_factory.cli.signal_handling import leave, signals_as_exceptions
from grasp_factory.core.os_errors import MACHINE_ERRNOS
from grasp_factory.core.text_format import escaped
from grasp_factory.errors import (
    EXIT_DONE,
    EXIT_FAILURE,
    EXIT_INTERRUPTED,
    EXIT_TERMINATED,
    EXIT_USAGE,
    GraspFactoryError,
    GraspFactoryWarning,
    Terminated,
    UsageError,
)

LONGEST_MESSAGE = 1000
_IN_THE_WAY = {
    errno.ENOENT,
    errno.EISDIR,
    errno.ENOTDIR,
    errno.EEXIST,
    errno.ENOTEMPTY,
    errno.ENAMETOOLONG,
}
"""Error numbers of a file that was removed, or a folder where a file should be, and of names."""


def main() -> NoReturn:
    """Run the command and exit: 0 done, 1 failure, 2 wrong usage, 130 Ctrl-C, 143 SIGTERM.

    An expected error prints one line on stderr; a bug prints its traceback.
    """
    _open_standard_streams()
    try:
        with signals_as_exceptions(), _warnings_as_lines():
            from grasp_factory.cli.main import cli  # noqa: PLC0415 - slow: Ctrl-C may come

            code = cli.main(prog_name="grasp-factory", standalone_mode=False) or EXIT_DONE
        sys.stdout.flush()
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else EXIT_DONE
    except click.ClickException as error:
        code = _print_error(error.format_message(), error.exit_code)
    except UsageError as error:
        code = _print_error(str(error), EXIT_USAGE)
    except GraspFactoryError as error:
        code = _print_error(str(error), EXIT_FAILURE)
    except (click.Abort, KeyboardInterrupt) as error:
        terminated = isinstance(error.__cause__ or error, Terminated)
        code = _print_error("stopped", EXIT_TERMINATED if terminated else EXIT_INTERRUPTED)
    except BrokenPipeError:  # the reader of the output is gone
        code = EXIT_FAILURE
    except OSError as error:
        if error.errno not in MACHINE_ERRNOS | _IN_THE_WAY:
            raise
        where = f"{error.filename}: " if error.filename else ""
        code = _print_error(f"{where}{error.strerror}", EXIT_FAILURE)
    _drop_output_that_cannot_be_written()
    leave(code)


def _drop_output_that_cannot_be_written() -> None:
    """Empty stdout, so that Python's own end does not fail at it and change the exit code."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _open_standard_streams() -> None:
    """Make stdin, stdout and stderr usable, however the process was started.

    A closed stream (``>&-``) is opened on /dev/null. Otherwise the next file that is opened would
    get its number, and with it the output. Characters that the terminal's encoding lacks, such as
    those of a path of arbitrary bytes, are printed as escapes.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            os.set_inheritable(number, True)  # worker processes need it, too
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "r" if number == 0 else "w", closefd=False))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


@contextlib.contextmanager
def _warnings_as_lines() -> Iterator[None]:
    """Print each warning of this package as one line on stderr.

    NumPy's warnings of odd numbers are left out: a store may have any numbers.
    """
    with warnings.catch_warnings():
        shown = warnings.showwarning

        def show(message: Any, category: type[Warning], *where: Any, **more: Any) -> None:
            if issubclass(category, GraspFactoryWarning):
                click.echo(f"Warning: {_in_one_line(str(message))}", err=True)
            elif not issubclass(category, RuntimeWarning):
                shown(message, category, *where, **more)

        warnings.simplefilter("always", GraspFactoryWarning)
        warnings.showwarning = show
        yield


def _print_error(message: str, code: int) -> int:
    click.echo(f"Error: {_in_one_line(message)}", err=True)
    return code


def _in_one_line(message: str) -> str:
    line = escaped(" ".join(message.split()))
    if len(line) > LONGEST_MESSAGE:
        half = LONGEST_MESSAGE // 2
        line = f"{line[:half]} ... {line[-half:]}"
    return line


if __name__ == "__main__":
    main()
