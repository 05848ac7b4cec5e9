"""An episode has the same bytes on every processor: no routine that depends on it is on the way."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy._core import _multiarray_umath
from support.places import TESTS
from support.processor_runs import CASES
from support.same_bytes import ALLOWED, PACKAGE, findings, path_modules
from support.scale import soak_only
from support.tiny_models import tiny_model

from grasp_factory.core.cache import VARIABLE

ASKED = ("default:4", "strong:2", "panda:2", "video:1", "wrist:1", "mixture:4")
"""A small form of what docs/reference/physics.md has figures of."""
SUPPORT = TESTS / "support"
OPENCV_FEATURES = "SSE4.1,SSE4.2,AVX,FP16,AVX2,AVX512-SKX"
"""All that OpenCV's wheels have code for beside the baseline; it only warns of other names."""


def can_be_trapped() -> bool:
    """Say whether NumPy is a wheel with OpenBLAS, on a processor that the trap is written for."""
    libraries = Path(np.__file__).parents[1] / "numpy.libs"
    is_wheel = any(libraries.glob("libscipy_openblas64_*"))
    return is_wheel and platform.machine() == "x86_64"


def dispatched() -> list[str]:
    """Return the features that this NumPy uses here beyond its baseline, by their names."""
    features = _multiarray_umath.__cpu_features__
    return [name for name in _multiarray_umath.__cpu_dispatch__ if features[name]]


@pytest.mark.parametrize("module", path_modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_on_the_way_names_nothing_that_depends_on_the_processor(module):
    name = module.relative_to(PACKAGE).as_posix()
    allowed = {finding for place, finding in ALLOWED if place == name}
    assert findings(module.read_text(encoding="utf-8")) == allowed


def test_the_way_is_found_through_the_imports():
    found = {module.relative_to(PACKAGE).as_posix() for module in path_modules()}
    expected = """
        sampling/spec.py simulation/rollout.py robots/ik.py labels/rule.py signals/grasp_crop.py
        policies/antipodal.py objects/solids.py core/textures.py simulation/world/client.py
        simulation/sensors/imu.py simulation/sensors/video.py
    """
    assert set(expected.split()) <= found


@pytest.mark.parametrize(
    ("code", "finding"),
    [
        ("a = b @ c", "@"),
        ("a @= c", "@"),
        ("a = b ** 2", "**"),
        ("a **= 2", "**"),
        ("np.linalg.norm(v)", "np.linalg"),
        ("np.sin(x)", "np.sin"),
        ("f = np.hypot", "np.hypot"),
        ("math.sin(x)", "math.sin"),
        ("a.dot(b)", ".dot"),
        ("rng.normal(size=3)", ".normal"),
        ("np.random.default_rng(0).standard_normal()", ".standard_normal"),
        ("import scipy.spatial", "import scipy"),
        ("def f():\n    from torch import nn", "import torch"),
        ("from math import sin", "from math"),
        ("from numpy import sin", "from numpy"),
        ("np.argsort(x)", "argsort without kind='stable'"),
        ("x.argsort(kind='quicksort')", "argsort without kind='stable'"),
        ("pow(x, 2)", "pow()"),
    ],
)
def test_the_rule_sees(code, finding):
    assert findings(code) == {finding}


@pytest.mark.parametrize(
    "code",
    [
        "a * b + c / d",
        "np.sqrt(x)",
        "2**31",
        "math.sqrt(x)",
        "corner.normal",
        "np.argsort(x, kind='stable')",
        "from numpy.typing import NDArray",
    ],
)
def test_the_rule_allows(code):
    assert findings(code) == set()


@cache
def run(*environment: tuple[str, str], trapped: bool = False) -> str:
    """Return what ``processor_runs`` prints under environment variables."""
    trap = "import same_bytes; same_bytes.trap()\n" if trapped else ""
    code = f"{trap}import runpy; runpy.run_path('processor_runs.py', run_name='__main__')"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-X", "faulthandler", "-c", code, *ASKED],
        env={**os.environ, **dict(environment)}, cwd=SUPPORT, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


@pytest.mark.skipif(not can_be_trapped(), reason="no OpenBLAS of a wheel, or not x86-64")
@pytest.mark.parametrize(
    "code", ["np.eye(3) @ np.eye(3)", "np.linalg.inv(np.eye(3))", "np.sin(1.0)"]
)
def test_the_trap_kills_who_calls_what_is_not_allowed(code):
    code = f"import numpy as np, same_bytes; same_bytes.trap(); {code}"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=SUPPORT, capture_output=True, check=False
    )
    assert done.returncode < 0 or b"was called on the way" in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(not can_be_trapped(), reason="no OpenBLAS of a wheel, or not x86-64")
def test_episodes_are_made_without_a_call_of_blas_or_of_numpys_functions():
    assert run(trapped=True) == run()


@pytest.mark.slow
@pytest.mark.parametrize("kernels", ["Haswell", *soak_only("Nehalem")])
def test_bytes_do_not_depend_on_the_kernels_of_blas(kernels):
    assert run(("OPENBLAS_CORETYPE", kernels)) == run()


@pytest.mark.slow
@pytest.mark.skipif(not dispatched(), reason="NumPy uses nothing beyond its baseline here")
def test_bytes_do_not_depend_on_what_numpy_and_opencv_find_in_the_processor():
    numpys = ("NPY_DISABLE_CPU_FEATURES", " ".join(dispatched()))
    opencvs = ("OPENCV_CPU_DISABLE", OPENCV_FEATURES)
    assert run(numpys, opencvs, ("OPENCV_IPP", "disabled")) == run()


def test_opencv_can_be_brought_to_its_baseline():
    code = "import cv2; print(cv2.getCPUFeaturesLine())"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "OPENCV_CPU_DISABLE": OPENCV_FEATURES},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "unknown" not in done.stderr
    beyond_baseline = [word for word in done.stdout.split() if word.startswith("*")]
    assert beyond_baseline
    assert all(word.endswith("?") for word in beyond_baseline)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("models") / "tiny.safetensors"
    file.write_bytes(tiny_model(3))
    return file


@pytest.mark.soak
@pytest.mark.slow
def test_learned_episodes_do_not_depend_on_the_kernels_of_torch(model):
    variants = [{}, {"ATEN_CPU_CAPABILITY": "default", "ONEDNN_MAX_CPU_ISA": "SSE41"}]
    found = [
        subprocess.run(
            [sys.executable, "processor_runs.py", str(model), "learned:3"],
            env={**os.environ, **variant, VARIABLE: str(model.parent)}, cwd=SUPPORT,
            capture_output=True, text=True, check=True,
        ).stdout
        for variant in variants
    ]  # fmt: skip
    assert found[0] == found[1]


def test_all_cases_are_run_here():
    assert {word.split(":")[0] for word in ASKED} | {"learned", "tiny", "large"} == set(CASES)
