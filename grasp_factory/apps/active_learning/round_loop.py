"""The loop of rounds: generate with the last model, train on all stores so far, judge, repeat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.apps.active_learning.arm_evaluation import (
    ArmEvaluation,
    Tried,
    success_by_policy,
    success_gain,
    success_of,
)
from grasp_factory.apps.active_learning.files import make_folder, write_if_new
from grasp_factory.apps.active_learning.journal import Journal
from grasp_factory.apps.active_learning.judging import Judge, mistakes_of
from grasp_factory.apps.active_learning.learning import (
    VERSIONS,
    TrainingSet,
    held_out_examples,
    learn,
    together,
    training_set_of,
)
from grasp_factory.apps.active_learning.plot import picture_of
from grasp_factory.apps.active_learning.rounds import ArmState, Choice, ModelFacts, Round, gains_of
from grasp_factory.apps.active_learning.settings import ARMS, FlywheelSettings
from grasp_factory.apps.active_learning.stores import Make, complete, make_quietly, store_facts
from grasp_factory.apps.learning.progress_callback import ProgressWatch, unwatched
from grasp_factory.apps.learning.scores import LEVEL, RESAMPLES
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError
from grasp_factory.factory.name_check import check_names
from grasp_factory.factory.run_request import Request
from grasp_factory.policies import model_registry
from grasp_factory.policies.networks import GraspModel

PICTURE = "flywheel.png"


def run_rounds(
    settings: FlywheelSettings,
    folder: Path,
    workers: int = 2,
    *,
    make: Make = make_quietly,
    watch: ProgressWatch = unwatched,
) -> dict[str, Any]:
    """Make all rounds of a flywheel in a folder, or those that are missing.

    Each arm learns from round 0 and from its own rounds, and all are judged on the same held-out
    episodes. Existing files stay as they are. Missing files are made again with the same bytes.

    Args:
        settings: Everything that determines the content.
        folder: A new or empty folder, or one with the same settings.
        workers: Number of processes that make episodes.
        make: Makes the episodes.
        watch: Reports the progress of reading and training.

    Returns:
        Records by topic, as in flywheel.json: ``evaluation``, ``arms``, ``gains`` and ``tries``.

    Raises:
        UsageError: for an impossible request, or a folder with other settings.
        StoreError, WorkerError, FailuresError: as ``factory.generate`` does.
    """
    check_names(settings.start_config)
    check_names(settings.evaluation_config)
    settings.check_learned()
    Request(config=settings.config, workers=workers)
    wheel = _Flywheel(settings, folder, workers=workers, make=make, watch=watch)
    return wheel.turn()


class _Flywheel:
    """A flywheel's folder and its results so far."""

    def __init__(
        self,
        settings: FlywheelSettings,
        folder: Path,
        *,
        workers: int,
        make: Make,
        watch: ProgressWatch,
    ) -> None:
        self._settings, self._folder = settings, folder
        self._workers, self._make, self._watch = workers, make, watch
        self._journal = Journal(folder, settings)
        n = settings.evaluation
        self._evaluation = self._complete("evaluation.zarr", settings.evaluation_config, n)
        held_out = held_out_examples(self._evaluation, watch)
        self._judge = Judge(held_out)
        self._found: dict[str, Any] = {
            "evaluation": {
                "store": store_facts(folder, self._evaluation),
                "examples": len(held_out),
                "objects": len(np.unique(held_out.object_id)),
                "successes": int(held_out.success.sum()),
                "intervals": f"{LEVEL:.0%}, {RESAMPLES} resamples of objects and training seeds",
            }
        }

    def turn(self) -> dict[str, Any]:
        """Make all rounds and return the results."""
        start = self._start()
        stands = {arm: [start] for arm in self._settings.arms}
        self._note(stands)
        for number in range(1, self._settings.rounds + 1):
            for arm, line in stands.items():
                line.append(self._round(number, arm, line[-1]))
                self._note(stands)
        if self._settings.tries:
            last = {arm: line[-1].models[0].sha256 for arm, line in stands.items()}
            self._found["tries"] = self._tries(last)
        self._journal.finish(self._found)
        picture = picture_of(self._found["arms"], self._found["gains"])
        write_if_new(self._folder / PICTURE, picture)
        return self._found

    def _note(self, stands: Mapping[str, Sequence[ArmState]]) -> None:
        arms = {arm: [stand.turn for stand in line] for arm, line in stands.items()}
        gains = gains_of(*stands.values()) if len(stands) > 1 else []
        self._found |= {"arms": arms, "gains": gains}
        self._journal.note(self._found, sum(map(len, arms.values())))

    def _start(self) -> ArmState:
        config, n = self._settings.start_config, self._settings.start
        dataset = self._complete("round0.zarr", config, n)
        return self._state(0, self._folder, (self._training_set(dataset),), None)

    def _round(self, number: int, arm: str, before: ArmState) -> ArmState:
        sha256 = before.models[0].sha256
        make_folder(self._folder / arm)
        config, n = self._settings.round_config(number, arm, sha256), self._settings.budget
        dataset = self._complete(f"{arm}/round{number}.zarr", config, n)
        parts = (*before.parts, self._training_set(dataset))
        choice = Choice(model_sha256=sha256, prefer=ARMS[arm], mistakes=mistakes_of(dataset))
        return self._state(number, self._folder / arm, parts, choice)

    def _training_set(self, dataset: Dataset) -> TrainingSet:
        return training_set_of(dataset, store_facts(self._folder, dataset), self._watch)

    def _state(
        self, number: int, place: Path, parts: tuple[TrainingSet, ...], choice: Choice | None
    ) -> ArmState:
        """Train a round's networks, or read them from their files, and judge them."""
        training_set = together(parts)
        models, told = [], []
        for seed in range(self._settings.seeds):
            file = place / f"round{number}{f'.seed{seed}' if seed else ''}.safetensors"
            model = self._learned(file, training_set, seed, number)
            models.append(model)
            told.append(
                ModelFacts(
                    path=file.relative_to(self._folder).as_posix(),
                    sha256=model.sha256,
                    settings=model.facts["settings"],
                    versions=model.facts[VERSIONS],
                )
            )
            if not seed:
                model_registry.keep(file.read_bytes())  # for the policy `learned`
        judgement = self._judge.judge(models, self._watch)
        turn = Round(
            round=number,
            store=training_set.stores[-1],
            choice=choice,
            learned_from=tuple(store.path for store in training_set.stores),
            episodes=sum(store.episodes for store in training_set.stores),
            train_examples=len(training_set.train),
            val_examples=len(training_set.val),
            models=tuple(told),
            scores=judgement.scores(),
        )
        return ArmState(parts=parts, models=models, judgement=judgement, turn=turn)

    def _learned(self, file: Path, training_set: TrainingSet, seed: int, number: int) -> GraspModel:
        try:
            return learn(file, training_set, self._settings.training(seed), self._watch)
        except UsageError as error:
            raise UsageError(f"round {number}: {error}") from None

    def _tries(self, last: Mapping[str, str]) -> ArmEvaluation:
        """Let each arm's last model choose grasps in the scenes of the held-out episodes."""
        n = self._settings.tries
        made = {
            arm: self._complete(f"{arm}/tries.zarr", self._settings.tries_config(sha256), n)
            for arm, sha256 in last.items()
        }
        arms = {
            arm: Tried(
                model_sha256=last[arm],
                store=store_facts(self._folder, dataset),
                success=success_of(dataset),
            )
            for arm, dataset in made.items()
        }
        gain = success_gain(*made.values()) if len(made) > 1 else None
        return ArmEvaluation(arms=arms, gain=gain, policies=success_by_policy(self._evaluation))

    def _complete(self, name: str, config: FactoryConfig, n: int) -> Dataset:
        path = self._folder / name
        return complete(path, config, n, workers=self._workers, make=self._make)
