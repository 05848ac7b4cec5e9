from __future__ import annotations

import numpy as np
import pytest

from grasp_factory.core.textures import SIDE, TEXTURES, texture_image
from grasp_factory.errors import UnknownNameError


@pytest.mark.parametrize("texture", TEXTURES)
class TestTexture:
    def test_it_is_an_image_that_is_the_same_each_time(self, texture: str) -> None:
        image = texture_image(texture)
        assert image.shape == (SIDE, SIDE, 3)
        assert image.dtype == np.uint8
        np.testing.assert_array_equal(image, texture_image(texture))

    def test_it_has_a_pattern_and_stays_pale_enough_to_show_a_color(self, texture: str) -> None:
        image = texture_image(texture)
        assert image.std(axis=(0, 1)).max() > 4.0
        assert image.min() >= 0.25 * 255 - 1
        assert image.max() > 150


def test_all_differ() -> None:
    assert len({texture_image(texture).tobytes() for texture in TEXTURES}) == len(TEXTURES)


def test_an_unknown_texture_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown texture 'wood/99'"):
        texture_image("wood/99")
