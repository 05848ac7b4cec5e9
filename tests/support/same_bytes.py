"""What may not stand between a seed and stored bytes: found in the code, and trapped as it runs."""

from __future__ import annotations

import ast
import ctypes
import mmap
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

import grasp_factory
from grasp_factory.core.sensors import SENSORS

PACKAGE = Path(grasp_factory.__file__).parent

STARTS = ("sampling/spec.py", "simulation/rollout.py")
"""From (config, seed, index) to a recipe, and from a recipe to an episode."""
APART = {
    "objects/importing": "it runs at import; datasets carry what it made, by its hash",
}
"""Packages that are imported from there but have no part in an episode's bytes."""
ALLOWED = {
    ("core/elementary.py", ".standard_normal"): "rounded to single precision",
    ("policies/networks/loading.py", "import torch"): "answers are rounded (GraspModel.log_odds)",
    ("policies/networks/model.py", "import torch"): "as above",
    ("policies/networks/nets.py", "import torch"): "as above",
}
"""By module and finding, with the reason."""

NUMPY = frozenset(
    "dot vdot inner outer matmul tensordot einsum einsum_path kron convolve correlate linalg fft"
    " sin cos tan arcsin arccos arctan arctan2 asin acos atan atan2 sinh cosh tanh arcsinh arccosh"
    " arctanh exp exp2 expm1 log log2 log10 log1p logaddexp logaddexp2 power float_power pow cbrt"
    " hypot sinc i0 polyfit polyval polynomial roots cov corrcoef vander geomspace logspace unwrap"
    " argpartition longdouble vecdot matvec vecmat".split()
)
"""BLAS, LAPACK, and what NumPy has in variants for processors or takes from the C library."""
METHODS = frozenset(
    "argpartition beta binomial chisquare dirichlet dot exponential gamma geometric gumbel"
    " hypergeometric laplace logistic lognormal logseries multinomial multivariate_hypergeometric"
    " multivariate_normal negative_binomial noncentral_chisquare noncentral_f pareto poisson"
    " power rayleigh standard_cauchy standard_exponential standard_gamma standard_normal standard_t"
    " triangular vonmises wald weibull zipf".split()
)
"""Methods of arrays, and distributions that take logarithms, exponentials or powers."""
NORMAL_OF = frozenset({"rng", "generator", "random"})
"""What ``normal`` is a distribution of; elsewhere it is a direction."""
MATH = frozenset(
    "ceil comb copysign fabs factorial floor frexp fsum gcd inf isclose isfinite isinf isnan lcm"
    " ldexp nan pi prod radians sqrt tau trunc".split()
)
"""All else in ``math`` is the C library's, or differs between versions of Python."""
LIBRARIES = frozenset({"cmath", "scipy", "sklearn", "torch"})


def path_modules() -> list[Path]:
    """Return the modules that lead from a seed to an episode, each by the imports of another."""
    seen: set[Path] = set()
    todo = [PACKAGE / start for start in STARTS]
    for model in SENSORS.values():  # the simulation loads them by name
        module = model.implementation.partition(":")[0].partition(".")[2]
        todo.append(PACKAGE / f"{module.replace('.', '/')}.py")
    while todo:
        module = todo.pop()
        if module in seen or any(module.is_relative_to(PACKAGE / part) for part in APART):
            continue
        seen.add(module)
        todo += _imported(module)
    return sorted(seen)


def _imported(module: Path) -> Iterator[Path]:
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{a.name}" for a in node.names] + [str(node.module)]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            top, *parts = name.split(".")
            place = PACKAGE.joinpath(*parts)
            files = (place.with_suffix(".py"), place / "__init__.py") if parts else ()
            if top == "grasp_factory":
                yield from (file for file in files if file.is_file())


def findings(source: str) -> set[str]:
    """Return the names of everything in a module that is not allowed on the way."""
    return {found for node in ast.walk(ast.parse(source)) for found in _in_node(node)}


def _in_node(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.BinOp | ast.AugAssign):
        yield from _in_operation(node)
    elif isinstance(node, ast.Attribute):
        yield from _in_attribute(node)
    elif isinstance(node, ast.Import | ast.ImportFrom):
        yield from _in_import(node)
    elif isinstance(node, ast.Call):
        yield from _in_call(node)


def _in_operation(node: ast.BinOp | ast.AugAssign) -> Iterator[str]:
    if isinstance(node.op, ast.MatMult):
        yield "@"
    if isinstance(node.op, ast.Pow):
        sides = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.value, None)
        if not all(isinstance(s, ast.Constant) and isinstance(s.value, int) for s in sides):
            yield "**"


def _in_attribute(node: ast.Attribute) -> Iterator[str]:
    owner = node.value.id if isinstance(node.value, ast.Name) else ""
    if owner == "np":
        if node.attr in NUMPY:
            yield f"np.{node.attr}"
    elif owner == "math":
        if node.attr not in MATH:
            yield f"math.{node.attr}"
    elif node.attr in METHODS or (node.attr == "normal" and owner in NORMAL_OF):
        yield f".{node.attr}"


def _in_import(node: ast.Import | ast.ImportFrom) -> Iterator[str]:
    if isinstance(node, ast.Import):
        tops = {alias.name.split(".")[0] for alias in node.names}
    else:
        tops = {str(node.module).split(".")[0]}
        if node.module == "math" or (tops == {"numpy"} and node.module != "numpy.typing"):
            yield f"from {node.module}"  # the rules above would not see its names
    yield from (f"import {top}" for top in tops & LIBRARIES)


def _in_call(node: ast.Call) -> Iterator[str]:
    is_method = isinstance(node.func, ast.Attribute)
    name = node.func.attr if is_method else getattr(node.func, "id", "")
    kinds = [word.value for word in node.keywords if word.arg == "kind"]
    if name == "argsort" and "stable" not in [getattr(kind, "value", "") for kind in kinds]:
        yield "argsort without kind='stable'"
    if name == "pow":
        yield "pow()"


def trap() -> None:
    """Make BLAS and NumPy's functions fail, from now on and in this process.

    The first instruction of each entry of OpenBLAS becomes an illegal one, so that a call kills the
    process wherever it comes from, ``@`` included; NumPy's functions raise. On x86-64 only.
    """
    for name in ("cblas_dgemm", "cblas_sgemm", "cblas_dgemv", "cblas_sgemv", "cblas_ddot",
                 "cblas_sdot", "cblas_dsyrk", "cblas_ssyrk", "dgesv_", "dgesdd_", "dgeev_",
                 "dsyevd_", "dgetrf_", "dpotrf_", "dgelsd_", "dgeqrf_"):  # fmt: skip
        _break(name)
    for owner in (np, np.linalg):
        for name in dir(owner):
            if callable(getattr(owner, name)) and (owner is np.linalg or name in NUMPY):
                setattr(owner, name, _refused(f"{owner.__name__}.{name}"))


def _break(name: str) -> None:
    address = ctypes.cast(_entry(name), ctypes.c_void_p).value
    assert address is not None
    page = mmap.PAGESIZE
    libc = ctypes.CDLL(None, use_errno=True)
    start, span = ctypes.c_void_p(address - address % page), ctypes.c_size_t(2 * page)
    if libc.mprotect(start, span, mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC):
        raise OSError(ctypes.get_errno(), "mprotect")
    ctypes.memmove(address, b"\x0f\x0b", 2)  # ud2


def _entry(name: str) -> Any:
    (library,) = (Path(np.__file__).parents[1] / "numpy.libs").glob("libscipy_openblas64_*")
    return getattr(ctypes.CDLL(str(library)), f"scipy_{name}64_")


def _refused(name: str) -> Any:
    def refuse(*args: object, **kwargs: object) -> NoReturn:
        raise AssertionError(f"{name} was called on the way from a seed to stored bytes")

    return refuse
