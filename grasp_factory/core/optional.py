"""Checks that optional libraries are installed, with messages that say how to install them."""

from __future__ import annotations

from importlib.util import find_spec

from grasp_factory.errors import MissingLibraryError


def require(*modules: str, extra: str) -> None:
    """Check that optional libraries are installed, without importing them.

    Args:
        modules: their import names.
        extra: the optional dependency group of this package that installs them.

    Raises:
        MissingLibraryError: naming the missing libraries and the command that installs them.
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise missing_libraries(*missing, extra=extra)


def missing_libraries(*modules: str, extra: str) -> MissingLibraryError:
    """Return the error for optional libraries that are not installed."""
    verb = "is" if len(modules) == 1 else "are"
    return MissingLibraryError(
        f"this needs {', '.join(modules)}, which {verb} not installed:"
        f" pip install 'grasp-factory[{extra}]'"
    )


def require_pybullet() -> None:
    """Check that PyBullet is installed, without importing it.

    Raises:
        MissingLibraryError: naming the command that installs it.
    """
    if find_spec("pybullet") is None:
        raise MissingLibraryError(
            "this simulates or reads PyBullet's models and needs pybullet, which is not installed:"
            " pip install 'grasp-factory[simulation]' (wheels: CPython up to 3.11 on x86-64 Linux;"
            " elsewhere first pip install numpy setuptools wheel, then add --no-build-isolation,"
            " for GCC 14 after CFLAGS=-Wno-error=incompatible-pointer-types)"
        )
