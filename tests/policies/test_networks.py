"""Networks: what they are shown, that symmetry and batches change nothing, and their files."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import pickle
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.tiny_models import tiny_model
from support.views import brick, photograph

from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.enums import Label, Phase
from grasp_factory.core.episode import CameraImage
from grasp_factory.core.geometry import Array, inverse, rotation_about, transform
from grasp_factory.core.optional import require
from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.policies.networks import (
    KINDS,
    TOUCH,
    GraspModel,
    TouchWindow,
    image_of,
    load_model,
    mirrored,
    save_model,
    take,
    touch_of,
    width_of,
)
from grasp_factory.policies.networks.inputs import DEEPEST, HEIGHT_UNIT, IMAGE, WIDTH
from grasp_factory.policies.networks.known_answers import known_log_odds
from grasp_factory.policies.networks.model import CHUNK, STEP
from grasp_factory.policies.networks.nets import GraspNet
from grasp_factory.signals.grasp_crop import CropShape, GraspCrop, grasp_crop

SHAPE = CropShape()
Inputs = dict[str, NDArray[np.float32]]


def random_inputs(count: int, seed: int = 0, size: int = 8) -> Inputs:
    rng = np.random.default_rng(seed)
    shapes = {IMAGE: (3, size, size), WIDTH: (1,), TOUCH: (2, 6, 60)}
    return {n: rng.normal(size=(count, *s)).astype(np.float32) for n, s in shapes.items()}


def same(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    return a.keys() == b.keys() and all(a[n].tobytes() == b[n].tobytes() for n in a)


sides = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=5).map(np.array)


class TestMirroring:
    @given(which=sides, seed=st.integers(0, 9))
    def test_twice_gives_back_the_very_same(self, which: NDArray[np.bool_], seed: int) -> None:
        inputs = random_inputs(len(which), seed)
        once = mirrored(inputs, *which.T)
        assert same(mirrored(once, *which.T), inputs)
        for k, (x, y) in enumerate(which.tolist()):
            assert (once[IMAGE][k].tobytes() != inputs[IMAGE][k].tobytes()) == (x or y)
        assert once[WIDTH].tobytes() == inputs[WIDTH].tobytes()
        assert {values.dtype for values in once.values()} == {np.dtype(np.float32)}

    @given(which=sides)
    def test_along_both_is_one_after_the_other(self, which: NDArray[np.bool_]) -> None:
        inputs, (x, y), no = random_inputs(len(which)), which.T, np.zeros(len(which), bool)
        both = mirrored(inputs, x, y)
        assert same(mirrored(mirrored(inputs, x, no), no, y), both)
        assert same(mirrored(mirrored(inputs, no, y), x, no), both)

    @pytest.mark.parametrize(("x", "y"), [(True, False), (False, True), (True, True)])
    @pytest.mark.parametrize("camera", ["front", "overhead"])
    def test_of_the_inputs_is_mirroring_of_the_scene(self, camera: str, x: bool, y: bool) -> None:
        others = [(transform(np.eye(3), (0.60, 0.0, 0.02)), (0.03, 0.05, 0.04), 6)]
        image = photograph(CAMERAS[camera].config, brick(0.52, 0.05, 0.3) + others, (320, 240))
        R = rotation_about((0.0, 0.0, 1.0), 0.8) @ np.diag([1.0, -1.0, -1.0])
        T_world_tcp = transform(R, (0.53, 0.04, 0.03))
        there = mirror_world(image, T_world_tcp, x, y)
        plain, seen = (image_of(grasp_crop([each], T_world_tcp)) for each in (image, there))
        out = mirrored({IMAGE: plain[None]}, np.array([x]), np.array([y]))[IMAGE][0]
        agree = np.isclose(out, seen, atol=1e-4)
        assert agree.mean() > 0.995, "all but points on the border of two cells"
        assert np.isclose(plain, seen, atol=1e-4).mean() < 0.98

    @given(seed=st.integers(0, 99))
    def test_of_touch_is_mirroring_of_points_and_forces(self, seed: int) -> None:
        """Forces at points of the pads, whose torques are about the pads' middles."""
        rng = np.random.default_rng(seed)
        point, force = rng.normal(size=(2, 2, 60, 3))

        def touch(points: Array, forces: Array) -> NDArray[np.float32]:
            wrench = np.concatenate([forces, np.cross(points, forces)], axis=-1)
            return wrench.transpose(0, 2, 1)[None].astype(np.float32)

        before = {TOUCH: touch(point, force)}
        for x, y in ((True, False), (False, True), (True, True)):
            flip = np.array([-1.0 if x else 1.0, -1.0 if y else 1.0, 1.0])
            pads = slice(None, None, -1 if y else 1)
            want = touch(point[pads] * flip, force[pads] * flip)
            out = mirrored(before, np.array([x]), np.array([y]))[TOUCH]
            np.testing.assert_allclose(out, want, rtol=1e-6)


def mirror_world(image: CameraImage, T_world_tcp: Array, x: bool, y: bool) -> CameraImage:
    """Return what the mirrored camera sees of the scene mirrored across the TCP's planes.

    One mirroring makes of the image's columns their reverse; two are a turn and leave it.
    """
    sides = np.diag([-1.0 if x else 1.0, -1.0 if y else 1.0, 1.0, 1.0])
    T_tcp_camera = inverse(T_world_tcp) @ image.T_world_camera
    if x and y:
        T = T_world_tcp @ sides @ T_tcp_camera
        return dataclasses.replace(image, T_world_camera=T)
    reverse = np.diag([-1.0, 1.0, 1.0, 1.0])
    K = image.intrinsics.copy()
    K[0, 2] = image.depth.shape[1] - 1 - K[0, 2]
    return dataclasses.replace(
        image,
        depth=image.depth[:, ::-1],
        segmentation=image.segmentation[:, ::-1],
        intrinsics=K,
        T_world_camera=T_world_tcp @ sides @ T_tcp_camera @ reverse,
    )


class TestInputs:
    def test_an_image_is_height_in_50_mm_what_is_seen_and_the_target(self) -> None:
        height = np.full((8, 8), 0.025, np.float32)
        height[0], height[1], height[2] = np.nan, 1.0, -1.0
        label = np.full((8, 8), Label.TABLE, np.uint8)
        label[0], label[4], label[5] = 0, Label.TARGET, Label.TARGET + 1
        crop = GraspCrop(height=height, label=label, rgb=np.zeros((8, 8, 3), np.uint8))
        image = image_of(crop)
        assert (image.dtype, image.shape) == (np.float32, (3, 8, 8))
        deepest = np.float32(DEEPEST / HEIGHT_UNIT)
        np.testing.assert_allclose(image[0, :4, 0], [-deepest, deepest, -deepest, 0.5])
        np.testing.assert_array_equal(image[1], np.isfinite(height))
        np.testing.assert_array_equal(np.flatnonzero(image[2].any(axis=1)), [4])

    def test_a_width_is_in_decimetres(self) -> None:
        np.testing.assert_allclose(width_of(np.array([0.05, 0.1])), [[0.5], [1.0]])

    def test_touch_is_what_was_felt_before_the_lift(self) -> None:
        count, hz = 120, 120.0
        time = np.arange(count) / hz
        phase = np.where(time < 0.75, Phase.CLOSE, Phase.LIFT)
        wrench = np.zeros((count, 2, 6), np.float32)
        wrench[:, 0, 0], wrench[:, 1, 3] = 10.0 * time, 0.1 * time
        wrench[phase == Phase.LIFT] = 1e6
        streams = {"timestamp": time, "phase": phase, "tactile_wrench": wrench}
        touch = touch_of(streams, TouchWindow(seconds=0.5, samples=4))
        at = np.array([0.25, 0.375, 0.5, 0.625])
        np.testing.assert_allclose(touch[0, 0], at, rtol=1e-5)
        np.testing.assert_allclose(touch[1, 3], at, rtol=1e-5)
        assert np.count_nonzero(touch.any(axis=2)) == 2

    def test_before_the_first_record_nothing_was_felt(self) -> None:
        streams = {
            "timestamp": np.arange(5) / 10.0,
            "phase": np.array([2, 2, 2, 2, 3]),
            "tactile_wrench": np.full((5, 2, 6), 7.0, np.float32),
        }
        touch = touch_of(streams, TouchWindow(seconds=0.8, samples=8))
        assert not touch[:, :, :4].any()
        assert touch[:, :, 4:].all()

    def test_an_attempt_that_did_not_lift_has_no_touch(self) -> None:
        streams = {
            "timestamp": np.arange(3.0),
            "phase": np.array([0, 1, 2]),
            "tactile_wrench": np.zeros((3, 2, 6)),
        }
        with pytest.raises(ValueError, match="the attempt ended before the lift"):
            touch_of(streams, TouchWindow())

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"seconds": 0.0}, "seconds: got 0.0, valid: 0.01 to 10.0 s"),
            ({"samples": 1}, "samples: got 1, valid: 2 to 1024"),
        ],
    )
    def test_a_window_that_is_none_is_refused(
        self, settings: Mapping[str, Any], message: str
    ) -> None:
        with pytest.raises(ConfigError, match=message):
            TouchWindow(**settings)


MODELS = {kind: load_model(tiny_model(3, kind), kind) for kind in KINDS}
each_kind = pytest.mark.parametrize("kind", KINDS)


class TestPredictions:
    @each_kind
    def test_are_probabilities_that_hang_on_every_input(self, kind: str) -> None:
        model, inputs = MODELS[kind], random_inputs(20)
        holds = model.predict(inputs)
        assert holds.shape == (20,)
        assert ((holds > 0.0) & (holds < 1.0)).all()
        assert len(np.unique(holds)) == 20
        for name in KINDS[kind]:
            other = inputs | {name: inputs[name][::-1]}
            assert not np.allclose(model.predict(other), holds, atol=0.0)

    @each_kind
    @settings(max_examples=8)
    @given(count=st.integers(1, 2 * CHUNK + 3), seed=st.integers(0, 99))
    def test_do_not_hang_on_what_else_is_asked_nor_on_the_order(
        self, kind: str, count: int, seed: int
    ) -> None:
        model, inputs = MODELS[kind], random_inputs(count, seed)
        holds = model.predict(inputs)
        order = np.random.default_rng(seed).permutation(count)
        assert model.predict(take(inputs, order)).tobytes() == holds[order].tobytes()
        some = order[: max(1, count // 3)]
        assert model.predict(take(inputs, some)).tobytes() == holds[some].tobytes()
        alone = model.predict(take(inputs, some[:1]))
        assert alone.tobytes() == holds[some[:1]].tobytes()

    @each_kind
    def test_do_not_hang_on_the_number_of_threads_and_leave_it(self, kind: str) -> None:
        model, inputs = MODELS[kind], random_inputs(CHUNK + 1)
        before, answers = torch.get_num_threads(), []
        try:
            for threads in (1, 2, 3):
                torch.set_num_threads(threads)
                answers.append(model.predict(inputs).tobytes())
                assert torch.get_num_threads() == threads
        finally:
            torch.set_num_threads(before)
        assert len(set(answers)) == 1

    @each_kind
    def test_of_mirror_images_agree(self, kind: str) -> None:
        inputs = random_inputs(6)
        x, y = np.array([1, 0, 1, 0, 1, 0], bool), np.array([0, 1, 1, 0, 0, 1], bool)
        answers = [MODELS[kind].raw_logits(each) for each in (inputs, mirrored(inputs, x, y))]
        np.testing.assert_allclose(answers[1], answers[0], rtol=1e-12)

    def test_leave_alone_what_they_do_not_look_at(self) -> None:
        inputs = random_inputs(3)
        holds = MODELS["touch"].predict(inputs)
        assert MODELS["touch"].predict({TOUCH: inputs[TOUCH]}).tobytes() == holds.tobytes()

    def test_of_no_grasps_are_none(self) -> None:
        assert MODELS["vision"].predict(random_inputs(0)).shape == (0,)

    @given(slope=st.floats(0.1, 3.0), offset=st.floats(-2.0, 2.0))
    def test_are_calibrated_in_log_odds(self, slope: float, offset: float) -> None:
        inputs = random_inputs(4)
        model = dataclasses.replace(MODELS["touch"], slope=slope, offset=offset)
        holds = model.predict(inputs)
        odds = np.log(holds) - np.log1p(-holds)
        np.testing.assert_allclose(odds, slope * model.raw_logits(inputs) + offset, atol=1e-9)


class Noisy(torch.nn.Module):
    """A network whose answer is its input, with an error of single precision."""

    def __init__(self, error: float) -> None:
        super().__init__()
        self.error, self.scale = error, torch.nn.Parameter(torch.ones(1))

    def forward(self, tensors: Mapping[str, torch.Tensor]) -> torch.Tensor:
        answer = tensors[WIDTH][:, 0]
        return answer + (self.error if answer.dtype == torch.float32 else 0.0)


class TestLogOdds:
    """Answers of kernels that differ in the last bits become one."""

    @staticmethod
    def model(error: float, slope: float = 1.0) -> GraspModel:
        network: Any = Noisy(error)
        return dataclasses.replace(MODELS["vision"], network=network, slope=slope, offset=0.003)

    @pytest.mark.parametrize("slope", [1.0, 20.0])
    def test_are_the_same_with_any_error_of_single_precision(self, slope: float) -> None:
        inputs = random_inputs(30_000, size=1)
        few, more = (self.model(error, slope) for error in (-5e-6, 5e-6))
        assert few.log_odds(inputs).tobytes() == more.log_odds(inputs).tobytes()
        rounded = [
            np.rint((slope * model.raw_logits(inputs) + 0.003) / STEP) for model in (few, more)
        ]
        assert (rounded[0] != rounded[1]).any()  # what rounding alone would have let through

    def test_are_rounded_by_half_a_step_at_most(self) -> None:
        inputs = random_inputs(500)
        model = MODELS["vision"]
        found = model.log_odds(inputs)
        exact = model.slope * model.raw_logits(inputs) + model.offset
        assert np.abs(found - exact).max() <= STEP / 2.0 + 1e-3 * STEP
        np.testing.assert_allclose(found / STEP, np.rint(found / STEP), atol=1e-9)


class TestKnownAnswers:
    def test_are_the_same_each_time_and_of_many_kinds(self) -> None:
        found = known_log_odds()
        assert found.tobytes() == known_log_odds().tobytes()
        assert len(np.unique(found)) > 100

    def test_tell_kernels_that_are_not_exact_enough(self, monkeypatch: pytest.MonkeyPatch) -> None:
        exact = known_log_odds()
        answer = GraspNet.forward

        def coarse(net: GraspNet, inputs: Mapping[str, torch.Tensor]) -> torch.Tensor:
            return answer(net, {n: v.bfloat16().to(v.dtype) for n, v in inputs.items()})

        monkeypatch.setattr(GraspNet, "forward", coarse)
        assert known_log_odds().tobytes() != exact.tobytes()


def header_of(data: bytes) -> dict[str, Any]:
    length = int.from_bytes(data[:8], "little")
    header: dict[str, Any] = json.loads(data[8 : 8 + length])
    return header


def with_header(data: bytes, header: Mapping[str, Any]) -> bytes:
    length = int.from_bytes(data[:8], "little")
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + data[8 + length :]


def with_settings(data: bytes, change: Callable[[dict[str, Any]], object]) -> bytes:
    """Return a file whose settings were changed."""
    header = header_of(data)
    ours = json.loads(header["__metadata__"]["grasp_factory"])
    change(ours)
    header["__metadata__"]["grasp_factory"] = json.dumps(ours)
    return with_header(data, header)


def saved_by_torch() -> bytes:
    file = io.BytesIO()
    torch.save(MODELS["touch"].network.state_dict(), file)
    return file.getvalue()


def with_nan() -> bytes:
    model = load_model(tiny_model(3, "touch"), "touch")
    with torch.no_grad():
        next(iter(model.network.parameters())).view(-1)[0] = float("nan")
    return save_model(model)


class Opened:
    """A pickle that tells when it is loaded."""

    def __reduce__(self) -> Any:
        return (pytest.fail, ("the pickle was loaded",))


NOT_OURS = "it is no model of grasp-factory; `grasp-factory train` makes one"
TOUCH_FILE = tiny_model(3, "touch")


class TestFiles:
    @each_kind
    def test_come_back_as_the_same_model_and_the_same_bytes(self, kind: str) -> None:
        facts = {"episodes": 12, "splits": ["train", "val"], "loss": 0.5}
        model = dataclasses.replace(MODELS[kind], slope=1.25, offset=-0.5, facts=facts)
        data = save_model(model)
        again = load_model(data, kind)
        assert save_model(again) == data == save_model(model)
        assert again.sha256 == hashlib.sha256(data).hexdigest()
        for name in ("kind", "crop", "touch", "slope", "offset", "facts"):
            assert getattr(again, name) == getattr(model, name)
        inputs = random_inputs(5)
        assert again.predict(inputs).tobytes() == model.predict(inputs).tobytes()
        assert not again.network.training

    def test_of_any_kind_are_taken_when_none_is_named(self) -> None:
        assert {load_model(tiny_model(1, kind), "").kind for kind in KINDS} == set(KINDS)

    def test_of_another_kind_are_refused(self) -> None:
        with pytest.raises(UsageError) as caught:
            load_model(TOUCH_FILE)
        assert str(caught.value) == "it is a model of kind 'touch', valid: vision"

    @pytest.mark.parametrize(
        "data",
        [
            b"",
            b"\0" * 7,
            b"\0" * 64,
            b"\xff" * 64,
            b"PK\x03\x04 a zip file",
            TOUCH_FILE[:100],
            with_header(TOUCH_FILE, {}),
            with_header(TOUCH_FILE, {"__metadata__": {"grasp_factory": "[" * 100_000}}),
            with_header(TOUCH_FILE, {"__metadata__": {"grasp_factory": "7"}}),
            pickle.dumps(Opened()),
            saved_by_torch(),
        ],
        ids=lambda data: repr(data[:12]),
    )
    def test_of_others_are_refused_and_never_run(self, data: bytes) -> None:
        with pytest.raises(UsageError) as caught:
            load_model(data, "touch")
        assert str(caught.value) == NOT_OURS

    @pytest.mark.parametrize(
        ("data", "message"),
        [
            (TOUCH_FILE[:-4], "its contents do not fit a model of kind touch: "),
            (TOUCH_FILE + b"\0" * 8, "its contents do not fit a model of kind touch: "),
            (
                with_settings(TOUCH_FILE, lambda s: s.update(slope=10**400)),
                "its contents do not fit a model of kind touch: ",
            ),
            (with_settings(TOUCH_FILE, lambda s: s.update(kind="both")),
             "its contents do not fit a model of kind both: "),
            (with_settings(TOUCH_FILE, lambda s: s.update(crop={"size": 2})),
             "its contents do not fit a model of kind touch: crop"),
            (with_settings(TOUCH_FILE, lambda s: s.update(crop={"sise": 9})),
             "its contents do not fit a model of kind touch: unknown key 'crop.sise'"),
            (with_settings(TOUCH_FILE, lambda s: s.update(slope="steep")),
             "its contents do not fit a model of kind touch: "),
            (with_settings(TOUCH_FILE, lambda s: s.pop("offset")),
             "its contents do not fit a model of kind touch: 'offset'"),
            (with_settings(TOUCH_FILE, lambda s: s.update(format=2)),
             "it is a model of format 2, kind 'touch'; valid: format 1, kind vision or touch"),
            (with_settings(TOUCH_FILE, lambda s: (s.update(format=2), s.pop("kind"))),
             "it is no model of grasp-factory; "),
            (with_settings(TOUCH_FILE, lambda s: s.update(kind="smell")),
             "it is a model of format 1, kind 'smell'; valid: format 1, kind vision or touch"),
            (with_settings(TOUCH_FILE, lambda s: s.update(slope=float("inf"))),
             "its weights are not all finite numbers"),
            (with_settings(TOUCH_FILE, lambda s: s.update(facts=[1])),
             "its contents do not fit a model of kind touch: "),
            (with_nan(), "its weights are not all finite numbers"),
        ],
    )  # fmt: skip
    def test_that_are_damaged_say_what_is_wrong_in_one_line(
        self, data: bytes, message: str
    ) -> None:
        with pytest.raises(UsageError) as caught:
            load_model(data, "")
        assert str(caught.value).startswith(message)
        assert "\n" not in str(caught.value)

    @settings(max_examples=150)
    @given(data=st.data())
    def test_with_any_byte_changed_load_or_are_refused(self, data: st.DataObject) -> None:
        end = 8 + int.from_bytes(TOUCH_FILE[:8], "little")
        place = data.draw(st.integers(0, end - 1))
        broken = bytearray(TOUCH_FILE)
        broken[place] ^= data.draw(st.integers(1, 255))
        try:
            model = load_model(bytes(broken), "")
        except UsageError as error:
            assert "\n" not in str(error)
        else:
            assert isinstance(model, GraspModel)


def test_what_is_not_installed_is_named() -> None:
    with pytest.raises(UsageError) as caught:
        require("numpy", "no_such_one", "nor_this", extra="train")
    assert str(caught.value) == (
        "this needs no_such_one, nor_this, which are not installed:"
        " pip install 'grasp-factory[train]'"
    )
    require("numpy", extra="train")
