from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pybullet
import pybullet_data
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp_factory.core.geometry import rotation_about, rotation_vector, transform
from grasp_factory.robots.kinematics import Chain

DATA = Path(pybullet_data.getDataPath())
IIWA = DATA / "kuka_iiwa/model.urdf"
PANDA = DATA / "franka_panda/panda.urdf"
ODD_ARM = """<robot name="odd">
  <link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="e"/><link name="f"/>
  <joint name="ab" type="revolute"><parent link="a"/><child link="b"/>
    <origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.7 1.9"/><axis xyz="0.6 0 -0.8"/>
    <limit lower="-1" upper="2" effort="1" velocity="3"/></joint>
  <joint name="bc" type="fixed"><parent link="b"/><child link="c"/>
    <origin xyz="0 0.2 0.1" rpy="-1.2 0.3 0.5"/></joint>
  <joint name="cd" type="revolute"><parent link="c"/><child link="d"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 0 -1"/>
    <limit lower="-2" upper="0.5" effort="1" velocity="4"/></joint>
  <joint name="de" type="revolute"><parent link="d"/><child link="e"/>
    <origin xyz="0 0 0.25" rpy="0 1.1 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="5"/></joint>
  <joint name="ef" type="prismatic"><parent link="e"/><child link="f"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.1" effort="1" velocity="1"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def odd_arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("urdf") / "odd.urdf"
    path.write_text(ODD_ARM)
    return path


@pytest.fixture(scope="module")
def iiwa() -> Chain:
    return Chain.from_urdf(IIWA, "lbr_iiwa_link_0", "lbr_iiwa_link_7")


def random_postures(chain: Chain, count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform(chain.lower, chain.upper, (count, len(chain.lower)))


@contextmanager
def bullet_link_frame(path: Path, chain: Chain, tip: str) -> Iterator[Callable[..., np.ndarray]]:
    """Yield a function from joint angles to PyBullet's frame (4, 4) of the link ``tip``."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
        count = pybullet.getNumJoints(body, physicsClientId=client)
        infos = [pybullet.getJointInfo(body, j, physicsClientId=client) for j in range(count)]
        joints = {info[1].decode(): info[0] for info in infos}
        links = {info[12].decode(): info[0] for info in infos}

        def frame(q: np.ndarray) -> np.ndarray:
            for name, angle in zip(chain.joint_names, q, strict=True):
                pybullet.resetJointState(body, joints[name], angle, physicsClientId=client)
            state = pybullet.getLinkState(
                body, links[tip], computeForwardKinematics=1, physicsClientId=client
            )
            R = np.reshape(pybullet.getMatrixFromQuaternion(state[5]), (3, 3))
            return transform(R, state[4])

        yield frame
    finally:
        pybullet.disconnect(client)


@pytest.mark.parametrize(
    ("path", "base", "tip"),
    [
        (IIWA, "lbr_iiwa_link_0", "lbr_iiwa_link_7"),
        (PANDA, "panda_link0", "panda_grasptarget"),
        (PANDA, "panda_link0", "panda_hand"),
    ],
)
def test_forward_kinematics_is_where_pybullet_puts_the_link(
    path: Path, base: str, tip: str
) -> None:
    chain = Chain.from_urdf(path, base, tip)
    postures = random_postures(chain, 100)
    with bullet_link_frame(path, chain, tip) as frame:
        expected = np.array([frame(q) for q in postures])
    np.testing.assert_allclose(chain.fk(postures), expected, atol=2e-6)  # PyBullet's float poses


def test_forward_kinematics_follows_any_joint_axis(odd_arm: Path) -> None:
    chain = Chain.from_urdf(odd_arm, "a", "e")
    postures = random_postures(chain, 50)
    with bullet_link_frame(odd_arm, chain, "e") as frame:
        expected = np.array([frame(q) for q in postures])
    np.testing.assert_allclose(chain.fk(postures), expected, atol=2e-6)


def test_a_chain_knows_its_joints_and_their_limits(odd_arm: Path) -> None:
    chain = Chain.from_urdf(odd_arm, "a", "e")
    assert chain.joint_names == ("ab", "cd", "de")
    np.testing.assert_array_equal(chain.lower, [-1, -2, -3])
    np.testing.assert_array_equal(chain.upper, [2, 0.5, 3])
    np.testing.assert_array_equal(chain.velocity_limits, [3, 4, 5])


def test_a_chain_may_start_and_end_inside_the_robot(odd_arm: Path) -> None:
    whole = Chain.from_urdf(odd_arm, "a", "e")
    near = Chain.from_urdf(odd_arm, "a", "c")
    far = Chain.from_urdf(odd_arm, "c", "e")
    q = np.array([0.3, -1.1, 2.0])
    np.testing.assert_allclose(near.fk(q[:1]) @ far.fk(q[1:]), whole.fk(q), atol=1e-12)


def test_a_prismatic_joint_on_the_way_is_refused_with_what_is_valid(odd_arm: Path) -> None:
    with pytest.raises(ValueError, match=r"'ef' .* 'prismatic' \(valid: 'revolute', 'fixed'\)"):
        Chain.from_urdf(odd_arm, "a", "f")


def test_an_unknown_tip_is_refused_with_the_links_there_are(odd_arm: Path) -> None:
    with pytest.raises(ValueError, match=r"'a' to 'gripper' \(links: a, b, c, d, e, f\)"):
        Chain.from_urdf(odd_arm, "a", "gripper")


def test_a_base_that_is_not_above_the_tip_is_refused(odd_arm: Path) -> None:
    with pytest.raises(ValueError, match="no joints lead from 'd' to 'b'"):
        Chain.from_urdf(odd_arm, "d", "b")


def test_a_chain_without_joints_is_refused(odd_arm: Path) -> None:
    with pytest.raises(ValueError, match="no revolute joint between 'b' and 'c'"):
        Chain.from_urdf(odd_arm, "b", "c")


def test_a_revolute_joint_without_limits_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "endless.urdf"
    path.write_text(ODD_ARM.replace('<limit lower="-2" upper="0.5" effort="1" velocity="4"/>', ""))
    with pytest.raises(ValueError, match="'cd' has no <limit>"):
        Chain.from_urdf(path, "a", "e")


def test_a_tool_moves_the_tip_and_nothing_else() -> None:
    panda = Chain.from_urdf(PANDA, "panda_link0", "panda_hand")
    T_tip_tool = transform(rotation_about([0, 0, 1], 0.5), [0.01, 0.02, 0.2])
    tooled = panda.with_tool(T_tip_tool)
    q = random_postures(panda, 5)
    np.testing.assert_allclose(tooled.fk(q), panda.fk(q) @ T_tip_tool, atol=1e-12)
    assert tooled.joint_names == panda.joint_names


def test_the_jacobian_is_the_derivative_of_the_tip_pose(odd_arm: Path, iiwa: Chain) -> None:
    h = 1e-6
    for chain in (iiwa, Chain.from_urdf(odd_arm, "a", "e")):
        for q in random_postures(chain, 10):
            T, J = chain.fk_and_jacobian(q)
            np.testing.assert_array_equal(T, chain.fk(q))
            for j, dq in enumerate(h * np.eye(len(q))):
                after, before = chain.fk(q + dq), chain.fk(q - dq)
                linear = (after[:3, 3] - before[:3, 3]) / (2 * h)
                angular = rotation_vector(after[:3, :3] @ before[:3, :3].T) / (2 * h)
                np.testing.assert_allclose(J[:, j], [*linear, *angular], atol=1e-8)


def test_leading_axes_are_a_batch(iiwa: Chain) -> None:
    q = random_postures(iiwa, 6).reshape(2, 3, 7)
    T, J = iiwa.fk_and_jacobian(q)
    assert T.shape == (2, 3, 4, 4)
    assert J.shape == (2, 3, 6, 7)
    for i in np.ndindex(2, 3):
        T_one, J_one = iiwa.fk_and_jacobian(q[i])
        np.testing.assert_allclose(T[i], T_one, atol=1e-14)
        np.testing.assert_allclose(J[i], J_one, atol=1e-14)
    np.testing.assert_array_equal(iiwa.fk(q), T)
    assert iiwa.fk(q[:0]).shape == (0, 3, 4, 4)


@settings(deadline=None)
@given(q=st.lists(st.floats(-10, 10), min_size=7, max_size=7))
def test_every_posture_is_a_rigid_transform_within_reach(iiwa: Chain, q: list[float]) -> None:
    T = iiwa.fk(q)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    first_joint = [0.0, 0.0, 0.1575]
    assert np.linalg.norm(T[:3, 3] - first_joint) <= iiwa.reach + 1e-12


def test_the_reach_is_not_much_longer_than_the_stretched_arm(iiwa: Chain) -> None:
    stretched = iiwa.fk(np.zeros(7))
    assert stretched[2, 3] - 0.1575 <= iiwa.reach + 1e-12 <= stretched[2, 3] - 0.1575 + 1e-9
