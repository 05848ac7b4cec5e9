from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from grasp_factory.apps.pictures import preview
from grasp_factory.apps.pictures.preview import CAPTION, MOST, TILE_WIDTH, draw_preview
from grasp_factory.apps.pictures.tiles import GAP
from grasp_factory.cli.main import cli
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS
from grasp_factory.errors import RecipeError, UsageError

CONFIG = FactoryConfig(resolution=(64, 48))
TILE = (round(TILE_WIDTH * 48 / 64) + CAPTION, TILE_WIDTH)


def tile(image: np.ndarray, row: int, column: int) -> np.ndarray:
    top, left = GAP + row * (TILE[0] + GAP), GAP + column * (TILE[1] + GAP)
    return image[top : top + TILE[0] - CAPTION, left : left + TILE[1]]


def test_it_is_a_grid_of_scenes_that_differ() -> None:
    drawn: list[None] = []
    image = draw_preview(CONFIG, 5, lambda: drawn.append(None))
    assert len(drawn) == 5
    assert image.shape == (2 * (TILE[0] + GAP) + GAP, 3 * (TILE[1] + GAP) + GAP, 3)
    tiles = [tile(image, i // 3, i % 3) for i in range(6)]
    assert len({t.tobytes() for t in tiles}) == 6
    assert tiles[5].std(axis=(0, 1)).max() == 0.0  # the sixth place is empty


def test_it_shows_the_scene_that_the_attempt_starts_from() -> None:
    """The table takes the color that the recipe draws."""
    plain = draw_preview(CONFIG, 1, lambda: None)
    varied = FactoryConfig(resolution=(64, 48), randomize=RANDOMIZE_PRESETS["strong"])
    strong = draw_preview(varied, 1, lambda: None)
    assert not np.array_equal(plain, strong)


def test_a_scene_that_cannot_be_built_stays_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RecipeError("its mesh is gone")

    monkeypatch.setattr(preview, "build_scene", broken)
    image = draw_preview(CONFIG, 1, lambda: None)
    assert tile(image, 0, 0).std(axis=(0, 1)).max() == 0.0


@pytest.mark.parametrize("n", [0, -1, MOST + 1])
def test_a_number_of_scenes_that_makes_no_picture_is_refused(n: int) -> None:
    with pytest.raises(UsageError, match=f"{n} scenes: valid: 1 to {MOST}"):
        draw_preview(CONFIG, n, lambda: None)


class TestCommand:
    def test_it_writes_a_picture(self, tmp_path: Path) -> None:
        out = tmp_path / "scenes.png"
        args = ["preview", str(out), "--n", "2", "--randomize", "light", "--clutter", "2"]
        result = CliRunner().invoke(cli, [*args, "--resolution", "64x48"])
        assert result.exit_code == 0, result.output
        assert result.stdout.strip() == str(out)
        assert cv2.imread(str(out)) is not None

    @pytest.mark.parametrize("name", ["scenes.jpg", "nowhere/scenes.png"])
    def test_a_place_for_no_picture_is_refused_before_anything_is_simulated(
        self, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(preview, "World", None)
        result = CliRunner().invoke(cli, ["preview", str(tmp_path / name)])
        assert isinstance(result.exception, UsageError)
        assert list(tmp_path.iterdir()) == []
