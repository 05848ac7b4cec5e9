"""Lets torchvision's wheel for CUDA be imported beside a torch for CPUs: import this first.

Its compiled operators cannot be loaded there, but its Python code registers more for them.
"""

from torch import library

for name in ("nms", "qnms"):
    library.define(
        f"torchvision::{name}", "(Tensor dets, Tensor scores, float iou_threshold) -> Tensor"
    )
