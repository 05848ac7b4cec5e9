"""Annotations: what people say of episodes, in a log inside the store that only grows.

Nothing here is derived: no index, no repair and no new run makes it again, and none removes it.
"""

from __future__ import annotations

from grasp_factory.dataset.annotations.carrying import carry
from grasp_factory.dataset.annotations.folding import fold
from grasp_factory.dataset.annotations.log import AnnotationLog, default_who
from grasp_factory.dataset.annotations.records import Annotation, Change, Mark
from grasp_factory.dataset.annotations.values import KINDS

__all__ = ["KINDS", "Annotation", "AnnotationLog", "Change", "Mark", "carry", "default_who", "fold"]
