"""Where jobs run: in this process, or in worker processes that each own whole jobs."""

from __future__ import annotations

from grasp_factory.core.executors.base import (
    Check,
    Executor,
    ExecutorKind,
    ExecutorSettings,
    InlineExecutor,
    LostNode,
    Recover,
    SendMessage,
    Silence,
    Task,
    go_on,
)
from grasp_factory.core.executors.kinds import (
    EXECUTORS,
    executor_kind,
    make_executor,
)
from grasp_factory.core.executors.limited import LimitedExecutor, ProcessLimits
from grasp_factory.core.executors.pool import ProcessExecutor
from grasp_factory.core.executors.sharing import SharingExecutor
from grasp_factory.core.executors.team import JOBS_PER_PROCESS
from grasp_factory.core.executors.worker import Worker, early_workers

__all__ = [
    "EXECUTORS",
    "JOBS_PER_PROCESS",
    "Check",
    "Executor",
    "ExecutorKind",
    "ExecutorSettings",
    "InlineExecutor",
    "LimitedExecutor",
    "LostNode",
    "ProcessExecutor",
    "ProcessLimits",
    "Recover",
    "SendMessage",
    "SharingExecutor",
    "Silence",
    "Task",
    "Worker",
    "early_workers",
    "executor_kind",
    "go_on",
    "make_executor",
]
