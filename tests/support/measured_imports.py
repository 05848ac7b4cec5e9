"""All that commands import, for the server of ``measured_commands``."""

from __future__ import annotations

import importlib
import pkgutil

import sklearn.linear_model
import torch

import grasp_factory
import grasp_factory.cli.main

__all__ = ["grasp_factory", "sklearn", "torch"]

for module in pkgutil.walk_packages(grasp_factory.__path__, "grasp_factory."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
