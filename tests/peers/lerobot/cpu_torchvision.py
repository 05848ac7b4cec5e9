"""Lets torchvision's wheel for CUDA be imported beside a torch for CPUs: import this first.

Its library of operators cannot be loaded there, but its Python code registers more for them.
"""

from torch.library import Library

OPERATORS = Library("torchvision", "DEF")
for name in ("nms", "qnms"):
    OPERATORS.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
