from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.places import TINY

from grasp_factory.core.enums import Label
from grasp_factory.errors import UnknownNameError, UsageError
from grasp_factory.labels.rule import pad_normal_force
from grasp_factory.signals import (
    center_of_pressure,
    contact_values,
    net_wrench,
    taxel_centers,
    taxel_image,
)

Streams = dict[str, NDArray[Any]]

PAD = (0.02, 0.04)
T, P = 3, 5


def empty_streams() -> Streams:
    """Return records in which nothing touches, as they are stored."""
    streams: Streams = {"tactile_body": np.zeros((T, 2, P), np.uint8)}
    for name in ("position", "force", "normal"):
        streams[f"tactile_{name}"] = np.full((T, 2, P, 3), np.nan, np.float32)
    return streams


def press(streams: Streams, x: float, z: float, *, at: tuple[int, int, int] = (1, 0, 0),
          force: tuple[float, float, float] = (0.0, 2.0, 0.0),
          body: Label = Label.TARGET) -> Streams:  # fmt: skip
    """Let a body press along +y on a place of a pad; ``at`` is record, pad, slot."""
    streams["tactile_position"][at] = x, 0.0, z
    streams["tactile_force"][at] = force
    streams["tactile_normal"][at] = 0.0, 1.0, 0.0
    streams["tactile_body"][at] = body
    return streams


def random_streams(seed: int, reach: float) -> Streams:
    """Return contacts within ``reach`` times the pad, some slots empty."""
    rng = np.random.default_rng(seed)
    streams = empty_streams()
    for at in np.ndindex(T, 2, P):
        if rng.random() < 0.7:
            x, z = rng.uniform(-reach, reach, 2) * np.array(PAD) / 2
            press(streams, x, z, at=at, force=tuple(rng.uniform(0.1, 9.0, 3)))
    return streams


@pytest.fixture(scope="module")
def sample() -> Streams:
    """The touch streams of all episodes that ship with the repository, one after the other."""
    root = zarr.open_group(TINY, mode="r")
    lengths = np.asarray(root["episodes/n_steps"][:])
    names = [f"tactile_{name}" for name in ("position", "force", "normal", "body", "wrench")]
    return {
        name: np.concatenate([root[f"streams/{name}"][i, :n] for i, n in enumerate(lengths)])
        for name in names
    }


class TestTaxelImage:
    @given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.integers(2, 9))
    def test_force_and_centre_of_pressure_are_conserved_at_any_resolution(
        self, seed: int, rows: int, columns: int
    ) -> None:
        streams = random_streams(seed, reach=1.0)
        image = taxel_image(streams, PAD, rows, columns)
        assert image.shape == (T, 2, rows, columns)
        total = contact_values(streams).sum(axis=2)
        np.testing.assert_allclose(image.sum(axis=(2, 3)), total, rtol=1e-12)
        centers = taxel_centers(PAD, rows, columns)
        moment = np.einsum("tprc,rcd->tpd", image, centers)
        touched = total > 0
        expected = center_of_pressure(streams)[touched] * total[touched][:, None]
        # The stored places are float32: one at the very edge may lie 1e-9 m beyond it.
        np.testing.assert_allclose(moment[touched], expected, atol=1e-7)

    @given(st.integers(0, 2**32 - 1), st.sampled_from(["x", "y", "z"]))
    def test_every_component_of_the_force_is_conserved(self, seed: int, component: str) -> None:
        streams = random_streams(seed, reach=1.0)
        streams["tactile_force"] *= np.float32(-1)
        image = taxel_image(streams, PAD, 4, 3, component=component)
        force = np.nan_to_num(streams["tactile_force"][..., "xyz".index(component)])
        np.testing.assert_allclose(image.sum(axis=(2, 3)), force.sum(axis=2), rtol=1e-5)

    @given(st.integers(0, 2**32 - 1))
    def test_no_taxel_pulls(self, seed: int) -> None:
        assert (taxel_image(random_streams(seed, reach=2.0), PAD, 6, 4) >= 0).all()

    def test_a_force_on_a_taxels_centre_is_all_on_that_taxel(self) -> None:
        for row, column in np.ndindex(5, 3):
            x, z = taxel_centers(PAD, 5, 3)[row, column]
            image = taxel_image(press(empty_streams(), x, z), PAD, 5, 3)
            expected = np.zeros((T, 2, 5, 3))
            expected[1, 0, row, column] = 2.0
            np.testing.assert_allclose(image, expected, atol=1e-6)

    def test_a_force_between_four_taxels_is_shared_by_nearness(self) -> None:
        # Cells are 10 mm wide and 20 mm high; the force lies a quarter and a half into the last.
        streams = press(empty_streams(), 0.0025, 0.010)
        image = taxel_image(streams, PAD, 3, 3)[1, 0]
        expected = [[0, 0, 0], [0, 0.75, 0.25], [0, 0.75, 0.25]]
        np.testing.assert_allclose(image, expected, atol=1e-6)

    def test_rows_go_towards_the_fingertip_and_columns_along_x(self) -> None:
        image = taxel_image(press(empty_streams(), 0.010, 0.020), PAD, 4, 3)
        assert image[1, 0, 3, 2] == pytest.approx(2.0)
        np.testing.assert_allclose(taxel_centers(PAD, 4, 3)[3, 2], [0.010, 0.020])

    def test_a_force_beyond_the_pad_counts_at_the_nearest_place_on_its_edge(self) -> None:
        image = taxel_image(press(empty_streams(), 0.5, -0.3), PAD, 4, 3)
        assert image[1, 0, 0, 2] == 2.0
        assert image.sum() == 2.0

    def test_left_and_right_pad_have_their_own_image(self) -> None:
        streams = press(press(empty_streams(), 0, 0), 0, 0, at=(1, 1, 3), force=(0.0, 5.0, 0.0))
        np.testing.assert_allclose(taxel_image(streams, PAD, 3, 3)[1].sum(axis=(1, 2)), [2.0, 5.0])

    def test_only_contacts_with_the_asked_body_count(self) -> None:
        streams = press(empty_streams(), 0.0, 0.0)
        press(streams, 0.0, 0.0, at=(1, 0, 1), force=(0.0, 7.0, 0.0), body=Label.TABLE)
        for body, force in ((None, 9.0), (Label.TARGET, 2.0), (Label.TABLE, 7.0), (Label.ARM, 0.0)):
            assert taxel_image(streams, PAD, 4, 4, body=body).sum() == force

    def test_shear_is_signed_and_no_normal_force(self) -> None:
        streams = press(empty_streams(), 0.0, 0.0, force=(-1.0, 2.0, 0.5))
        sums = {c: taxel_image(streams, PAD, 3, 3, component=c).sum() for c in ("normal", *"xyz")}
        assert sums == {"normal": 2.0, "x": -1.0, "y": 2.0, "z": 0.5}

    @pytest.mark.parametrize(("rows", "columns"), [(1, 4), (4, 0), (-2, 4)])
    def test_fewer_than_two_rows_or_columns_are_refused(self, rows: int, columns: int) -> None:
        with pytest.raises(UsageError, match=r"taxels: (rows|columns) -?\d: valid: 2 or more"):
            taxel_image(empty_streams(), PAD, rows, columns)

    def test_an_unknown_component_is_named_with_the_valid_ones(self) -> None:
        with pytest.raises(UnknownNameError, match=r"'shear' \(valid: normal, x, y, z\)"):
            taxel_image(empty_streams(), PAD, 3, 3, component="shear")

    def test_no_records_give_no_images(self) -> None:
        streams = {name: values[:0] for name, values in empty_streams().items()}
        assert taxel_image(streams, PAD, 3, 4).shape == (0, 2, 3, 4)


class TestCenterOfPressure:
    def test_it_is_the_mean_of_the_points_weighted_by_normal_force(self) -> None:
        streams = press(empty_streams(), -0.01, 0.0, force=(9.0, 1.0, 9.0))
        press(streams, 0.01, 0.004, at=(1, 0, 1), force=(0.0, 3.0, 0.0))
        center = center_of_pressure(streams)
        assert center.shape == (T, 2, 2)
        np.testing.assert_allclose(center[1, 0], [0.005, 0.003], atol=1e-9)

    def test_without_contact_there_is_none(self) -> None:
        center = center_of_pressure(press(empty_streams(), 0.0, 0.0))
        assert np.isfinite(center[1, 0]).all()
        assert np.isnan(center).sum() == center.size - 2

    def test_the_table_can_be_left_out(self) -> None:
        streams = press(empty_streams(), 0.001, 0.002, body=Label.TABLE)
        assert np.isnan(center_of_pressure(streams, Label.TARGET)).all()


class TestNetWrench:
    def test_a_force_off_the_origin_turns_about_it(self) -> None:
        wrench = net_wrench([[0.0, 0.0, 0.5], [np.nan] * 3], [[2.0, 0.0, 0.0], [np.nan] * 3])
        np.testing.assert_allclose(wrench, [2.0, 0.0, 0.0, 0.0, 1.0, 0.0])

    def test_a_couple_has_a_moment_and_no_force(self) -> None:
        wrench = net_wrench(
            [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]], [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
        )
        np.testing.assert_allclose(wrench, [0.0, 0.0, 0.0, 0.0, 0.0, -2.0])


class TestStoredEpisodes:
    def test_the_contacts_give_the_stored_wrench_again(self, sample: Streams) -> None:
        whole = ~np.isfinite(sample["tactile_force"][..., -1, 0])  # with a slot to spare
        assert (whole & np.isfinite(sample["tactile_force"][..., 0, 0])).sum() > 50
        wrench = net_wrench(sample["tactile_position"], sample["tactile_force"])
        np.testing.assert_allclose(wrench[whole], sample["tactile_wrench"][whole], atol=1e-4)

    def test_the_image_carries_the_labels_normal_force(self, sample: Streams) -> None:
        pad_size = zarr.open_group(TINY, mode="r").attrs["robot"]["pad_size"]
        image = taxel_image(sample, tuple(pad_size), 12, 5, body=Label.TARGET)
        force = pad_normal_force(sample)
        assert force.max() > 1.0
        np.testing.assert_allclose(image.sum(axis=(2, 3)), force, atol=1e-9)
        # Points that lie beyond the pad by some micrometres are moved onto its edge.
        outside = np.abs(sample["tactile_position"][..., [0, 2]]) > np.array(pad_size) / 2
        inside = (force > 0) & ~outside.any(axis=(2, 3))
        moment = np.einsum("tprc,rcd->tpd", image, taxel_centers(tuple(pad_size), 12, 5))
        center = center_of_pressure(sample, Label.TARGET)
        mean = moment[inside] / force[inside][:, None]
        np.testing.assert_allclose(mean, center[inside], atol=1e-9)
