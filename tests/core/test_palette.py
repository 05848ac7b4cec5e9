"""The colours of what people look at: told apart, legible, and defined in one place."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from support.places import REPOSITORY

from grasp_factory.apps.browse.palette_css import palette_css
from grasp_factory.core import palette
from grasp_factory.core.enums import Label, Outcome, Phase, names
from grasp_factory.core.geometry import Array
from grasp_factory.core.shown_units import SHOWN_UNITS

SIGHT = {
    "full": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
"""Linear RGB as it looks to people: Machado, Oliveira and Fernandes, "A Physiologically-based Model
for Simulation of Color Vision Deficiency", IEEE TVCG 15(6), 2009, table for severity 1.0."""
XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
"""CIE XYZ of linear sRGB with the white of D65 (IEC 61966-2-1)."""
WHITE, DARK_PANEL = "#ffffff", "#1a2027"
TINT = 0.12
"""Share of an outcome's colour in the ground of its badge, as in style.css."""
PACKAGE = REPOSITORY / "grasp_factory"
SCHEMES = ("light", "dark")


def linear(colors: Iterable[str]) -> Array:
    """Return linear RGB, (n, 3)."""
    parts = np.array([palette.rgb(color) for color in colors]) / 255.0
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def lab(rgb: Array) -> Array:
    """Return CIE L*a*b* (n, 3) of linear RGB."""
    t = (rgb @ XYZ.T) / XYZ.sum(axis=1)
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = f.T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)


def apart(colors: Sequence[str], sight: str) -> dict[tuple[str, str], float]:
    """Return the difference (CIE 1976) of each two colours; 2.3 can just be seen."""
    seen = lab(np.clip(linear(colors) @ SIGHT[sight].T, 0.0, 1.0))
    return {
        (colors[i], colors[j]): float(np.linalg.norm(seen[i] - seen[j]))
        for i, j in combinations(range(len(colors)), 2)
    }


def contrast(a: str, b: str) -> float:
    """Return the contrast ratio of WCAG 2.2."""
    low, high = sorted((linear([a, b]) @ XYZ[1]).tolist())
    return float((high + 0.05) / (low + 0.05))


def tinted(color: str, ground: str) -> str:
    mixed = TINT * np.array(palette.rgb(color)) + (1 - TINT) * np.array(palette.rgb(ground))
    return palette.hex_color(np.rint(mixed).tolist())


def outcomes(scheme: str) -> dict[str, str]:
    paints = {**palette.OUTCOMES, "quarantined": palette.QUARANTINED}
    return {word: getattr(paint, scheme) for word, paint in paints.items()}


def test_every_outcome_phase_and_label_has_a_colour_and_no_other_word_has() -> None:
    assert list(palette.OUTCOMES) == names(Outcome)
    assert list(palette.PHASES) == names(Phase)
    assert list(palette.LABELS) == names(Label)


@pytest.mark.parametrize("sight", SIGHT)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_outcomes_differ_for_all_eyes_and_success_differs_most(scheme: str, sight: str) -> None:
    colors = outcomes(scheme)
    found = apart(list(colors.values()), sight)
    assert min(found.values()) > 6.0
    success = [value for pair, value in found.items() if colors["success"] in pair]
    assert min(success) > 12.0


@pytest.mark.parametrize("sight", SIGHT)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_curves_phases_and_success_among_all_differ_for_all_eyes(scheme: str, sight: str) -> None:
    for paints in (
        palette.CURVES,
        tuple(palette.PHASES.values()),
        (palette.SUCCESS, palette.FAILURES),
    ):
        assert min(apart([getattr(p, scheme) for p in paints], sight).values()) > 15.0


@pytest.mark.parametrize("sight", SIGHT)
def test_robot_target_others_and_grasp_differ_for_all_eyes(sight: str) -> None:
    solid = [palette.LABELS[word] for word in ("table", "arm", "gripper", "target")]
    assert min(apart([*solid, *palette.OTHERS, palette.GRASP], sight).values()) > 14.0


def test_words_in_the_colour_of_an_outcome_can_be_read_on_its_badge() -> None:
    for scheme, ground in (("light", WHITE), ("dark", DARK_PANEL)):
        for color in outcomes(scheme).values():
            assert contrast(color, tinted(color, ground)) >= 4.5


def test_curves_stand_out_from_the_ground() -> None:
    for curve in palette.CURVES:
        assert contrast(curve.light, WHITE) >= 3.0
        assert contrast(curve.dark, DARK_PANEL) >= 3.0


@pytest.mark.parametrize("sight", SIGHT)
def test_depth_and_force_rise_evenly_in_lightness_for_all_eyes(sight: str) -> None:
    for colors in (palette.depth_colors(), palette.force_colors()):
        shown = [palette.hex_color(color) for color in colors[::16].tolist()]
        lightness = lab(np.clip(linear(shown) @ SIGHT[sight].T, 0.0, 1.0))[:, 0]
        assert (np.diff(lightness) > 0.0).all()
    depth = palette.depth_colors().tolist()
    assert palette.hex_color(depth[0]) != palette.NOTHING not in map(palette.hex_color, depth)


def test_no_other_place_has_a_colour_of_the_data_or_a_colour_map() -> None:
    ours = {
        *outcomes("light").values(),
        *outcomes("dark").values(),
        *(c for paint in (*palette.CURVES, *palette.PHASES.values()) for c in _both(paint)),
        *(palette.TARGET, palette.GRIPPER, palette.ARM, palette.GRASP, palette.NOTHING),
        *palette.OTHERS,
    }
    maps = re.compile(r"COLORMAP_|\bcolormaps\[|cmap=[\"']|(?i:turbo|viridis|magma|inferno|jet\b)")
    defined = re.compile(r"--(?:outcome|phase|curve|compare)-[\w-]+:\s*#|tab:\w+")
    for file in _sources():
        text = file.read_text(encoding="utf-8")
        where = file.relative_to(PACKAGE)
        assert not maps.search(text), where
        assert not defined.search(text), where
        used = {color.lower() for color in re.findall(r"#[0-9a-fA-F]{6}\b", text)}
        assert not used & ours, where


def test_every_variable_of_the_pages_is_defined() -> None:
    static = PACKAGE / "apps/browse/static"
    styles = palette_css() + "".join(file.read_text() for file in static.glob("*.css"))
    scripts = "".join(file.read_text() for file in static.glob("*.js"))
    named = re.findall(r"(?:var|cssColor)\(['\"]?(--[\w-]+)['\")]", styles + scripts)
    assert set(named) <= set(re.findall(r"(--[\w-]+)\s*:", styles))
    assert len(named) > 100


def test_a_quantity_has_one_unit_and_a_text_in_it() -> None:
    assert SHOWN_UNITS["lift_height"].text(0.0123) == "12.3 mm"
    assert SHOWN_UNITS["slip_angle"].text(np.pi / 2) == "90.0°"


def test_no_other_place_turns_metres_into_a_unit_of_its_own() -> None:
    other = re.compile(r"\b100(?:\.0)? ?\* ?\w*(?:lift|slip|height|width)|f\"[^\"]*\} cm")
    for file in _sources():
        assert not other.search(file.read_text(encoding="utf-8")), file.relative_to(PACKAGE)


def _both(paint: palette.Paint) -> tuple[str, str]:
    return paint.light, paint.dark


def _sources() -> list[Path]:
    files = [*PACKAGE.rglob("*.py"), *(PACKAGE / "apps/browse/static").glob("*.*s")]
    return [file for file in files if file != PACKAGE / "core/palette.py"]
