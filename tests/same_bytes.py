"""What may not stand between a seed and stored bytes, found in the code."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import grasp_factory

PACKAGE = Path(grasp_factory.__file__).parent

STARTS = ("sampling.py", "rollout.py")
"""From (config, seed, index) to a recipe, and from a recipe to an episode."""
APART = {
    "meshes": "runs at import; datasets carry what it made, by its hash",
}
"""Packages that are reached from there but have no part in an episode's bytes."""

NUMPY = frozenset(
    "dot vdot inner outer matmul tensordot einsum einsum_path kron convolve correlate linalg fft"
    " sin cos tan arcsin arccos arctan arctan2 asin acos atan atan2 sinh cosh tanh arcsinh arccosh"
    " arctanh exp exp2 expm1 log log2 log10 log1p logaddexp logaddexp2 power float_power pow cbrt"
    " hypot sinc i0 polyfit polyval polynomial roots cov corrcoef vander geomspace logspace unwrap"
    " argpartition longdouble vecdot matvec vecmat".split()
)
"""BLAS, LAPACK, and what NumPy has in variants for processors or takes from the C library."""
METHODS = frozenset(
    "dot standard_normal exponential standard_exponential gamma standard_gamma beta chisquare"
    " dirichlet f gumbel hypergeometric laplace logistic lognormal logseries multinomial"
    " multivariate_normal negative_binomial noncentral_chisquare noncentral_f pareto poisson power"
    " rayleigh standard_cauchy standard_t triangular vonmises wald weibull zipf binomial geometric"
    " multivariate_hypergeometric argpartition".split()
)
"""Methods of arrays, and distributions that take logarithms, exponentials or powers."""
MATH = frozenset(
    "sqrt fabs floor ceil trunc copysign isfinite isnan isinf ldexp frexp gcd lcm pi inf"
    " nan tau radians degrees prod factorial fsum isclose comb".split()
)
"""All else in ``math`` is the C library's, or another version's of Python."""
LIBRARIES = frozenset({"scipy", "sklearn", "torch"})


def path_modules() -> list[Path]:
    """Return the modules that lead from a seed to an episode, each by the imports of another."""
    seen: set[Path] = set()
    todo = [PACKAGE / start for start in STARTS]
    while todo:
        module = todo.pop()
        if module in seen or module.relative_to(PACKAGE).parts[0] in APART:
            continue
        seen.add(module)
        todo += _imported(module)
    return sorted(seen)


def _imported(module: Path) -> Iterator[Path]:
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{a.name}" for a in node.names] + [str(node.module)]
        else:
            continue
        for name in names:
            parts = name.split(".")
            if parts[0] != "grasp_factory":
                continue
            place = PACKAGE.joinpath(*parts[1:])
            if place.with_suffix(".py").is_file() and len(parts) > 1:
                yield place.with_suffix(".py")
            elif (place / "__init__.py").is_file() and len(parts) > 1:
                yield place / "__init__.py"


def findings(source: str) -> list[tuple[int, str]]:
    """Return line and name of everything in a module that is not allowed on the way."""
    return sorted(set(_findings(ast.parse(source))))


def _findings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp | ast.AugAssign):
            if isinstance(node.op, ast.MatMult):
                yield node.lineno, "@"
            if isinstance(node.op, ast.Pow) and not _is_whole(node):
                yield node.lineno, "**"
        elif isinstance(node, ast.Attribute):
            owner = node.value.id if isinstance(node.value, ast.Name) else ""
            if owner == "np":
                if node.attr in NUMPY:
                    yield node.lineno, f"np.{node.attr}"
            elif owner == "math":
                if node.attr not in MATH:
                    yield node.lineno, f"math.{node.attr}"
            elif node.attr in METHODS:
                yield node.lineno, f".{node.attr}"
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] in LIBRARIES | {"cmath"}:
                    yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            top = str(node.module).split(".")[0]
            if top in LIBRARIES or (top in ("math", "cmath", "numpy") and _is_code(node)):
                yield node.lineno, f"from {node.module}"
        elif isinstance(node, ast.Call):
            if _name(node.func) in ("argsort", "sort") and not _is_stable(node):
                yield node.lineno, "argsort without kind='stable'"
            if _name(node.func) == "pow":
                yield node.lineno, "pow()"


def _name(function: ast.expr) -> str:
    if isinstance(function, ast.Attribute):
        return function.attr if function.attr != "sort" else ""
    return function.id if isinstance(function, ast.Name) else ""


def _is_stable(call: ast.Call) -> bool:
    return any(
        word.arg == "kind" and isinstance(word.value, ast.Constant) and word.value.value == "stable"
        for word in call.keywords
    )


def _is_whole(node: ast.BinOp | ast.AugAssign) -> bool:
    if isinstance(node, ast.AugAssign):
        return False
    return all(
        isinstance(side, ast.Constant) and isinstance(side.value, int)
        for side in (node.left, node.right)
    )


def _is_code(node: ast.ImportFrom) -> bool:
    return str(node.module) != "numpy.typing"
