"""Baselines without images: the share of successes, and a logistic regression on the pose."""

from __future__ import annotations

import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from grasp_factory.apps.learning.examples import Examples
from grasp_factory.core.geometry import Array


def majority(train: Examples, test: Examples) -> Array:
    """Return the share of successes in ``train`` for each of ``test``, (K,)."""
    return np.full(len(test), train.success.mean())


def pose_only(train: Examples, test: Examples) -> Array:
    """Return the probabilities (K,) of a logistic regression on pose and width.

    The regression also uses the squares and products of these features.
    """
    model = make_pipeline(
        StandardScaler(), PolynomialFeatures(2), StandardScaler(), LogisticRegression(max_iter=2000)
    )
    model.fit(_pose_features(train), train.success)
    return np.asarray(model.predict_proba(_pose_features(test))[:, 1])


def _pose_features(examples: Examples) -> Array:
    """Return (K, 8): position, x and y of the approach, cosine and sine of twice the yaw, width.

    The yaw is doubled because half a turn of the gripper changes nothing.
    """
    T = examples.T_world_tcp
    yaw = np.arctan2(T[:, 1, 1], T[:, 0, 1])
    turned = np.column_stack([np.cos(2.0 * yaw), np.sin(2.0 * yaw)])
    return np.column_stack([T[:, :3, 3], T[:, :2, 2], turned, examples.width])
