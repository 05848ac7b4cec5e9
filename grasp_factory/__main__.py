"""The process around the ``grasp-factory`` command: errors as one line, and exit codes."""

from __future__ import annotations

import errno
import os
import sys
from typing import NoReturn

import click

from grasp_factory.cli import EXIT_DONE, EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_USAGE, cli
from grasp_factory.errors import GraspFactoryError, UsageError

DISK_TROUBLE = {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS}


def main() -> NoReturn:
    """Run the command and exit: 0 done, 1 failure, 2 usage, 130 stopped by Ctrl-C.

    An error that we foresaw is one line on stderr; a bug keeps its traceback.
    """
    try:
        code = cli.main(prog_name="grasp-factory", standalone_mode=False) or EXIT_DONE
        sys.stdout.flush()
    except click.ClickException as error:
        code = _complain(error.format_message(), error.exit_code)
    except UsageError as error:
        code = _complain(str(error), EXIT_USAGE)
    except GraspFactoryError as error:
        code = _complain(str(error), EXIT_FAILURE)
    except (click.Abort, KeyboardInterrupt):
        code = _complain("stopped", EXIT_INTERRUPTED)
    except BrokenPipeError:  # the reader of our output left: nobody to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_FAILURE
    except OSError as error:
        if error.errno not in DISK_TROUBLE:
            raise
        code = _complain(f"{error.strerror} {error.filename or ''}", EXIT_FAILURE)
    sys.exit(code)


def _complain(message: str, code: int) -> int:
    click.echo("Error: " + " ".join(message.split()), err=True)
    return code


if __name__ == "__main__":
    main()
