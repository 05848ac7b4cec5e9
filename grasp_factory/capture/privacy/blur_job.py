"""The work of the process that blurs a session: search, cover, compare."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from grasp_factory.capture.consent import Consent
from grasp_factory.capture.privacy.blur_report import BlurredCamera, BlurReport, UsedModel
from grasp_factory.capture.privacy.blur_settings import BlurSettings
from grasp_factory.capture.privacy.comparing import check_copy
from grasp_factory.capture.privacy.covering import Covered, ImageCover
from grasp_factory.capture.privacy.detections import Detector
from grasp_factory.capture.privacy.face_model import FaceDetector
from grasp_factory.capture.privacy.plate_model import PlateDetector
from grasp_factory.capture.privacy.searching import SearchedTopic, search
from grasp_factory.capture.session_copy import SessionCopy
from grasp_factory.capture.session_reader import MCAP_FILE, SessionReader, opened_session
from grasp_factory.core.executors import SendMessage

STAGES = ("searching", "covering", "comparing")
"""In this order; each reports its progress in per cent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BlurJob:
    """What to blur."""

    session: Path
    folder: Path
    """An empty folder that gets the session's file."""
    settings: BlurSettings
    consent: Consent
    left_out: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BlurResult:
    """What was done, with examples."""

    report: BlurReport
    pictures: tuple[Covered, ...]


def blur(job: BlurJob, report: SendMessage) -> BlurResult:
    """Write the blurred file of a session; report ``(stage, percent)``.

    Raises:
        CaptureError: if the session is damaged or cannot be blurred.
        MissingLibraryError: if the face model is not installed.
        UsageError: if the plate model cannot be read.
        OSError: if the file cannot be written.
    """
    detectors = detectors_of(job.settings)
    with opened_session(job.session) as reader:
        searched = search(reader, detectors, job.settings, _Steps(reader, STAGES[0], report).count)
        cover = ImageCover(searched=searched, detectors=detectors, settings=job.settings)
        copy = SessionCopy(reader, cover.covered)
        sha256 = _sha256(reader)
        steps = _Steps(reader, STAGES[1], report)
        event = event_of(_report(job, detectors, sha256, searched, cover))
        copy.write(job.folder / MCAP_FILE, steps.count, event)
        found = _report(job, detectors, sha256, searched, cover)
        with opened_session(job.folder) as new:
            steps = _Steps(reader, STAGES[2], report)
            check_copy(reader, new, cover.changed, steps.count)
    return BlurResult(report=found, pictures=tuple(cover.pictures))


def detectors_of(settings: BlurSettings) -> list[Detector]:
    """Return the detectors of some settings.

    Raises:
        MissingLibraryError: if the face model is not installed.
        UsageError: if the plate model cannot be read.
        CaptureError: if the plate model has another input or output.
    """
    detectors: list[Detector] = [FaceDetector(settings.face_threshold, settings.scale)]
    if settings.plates is not None:
        detectors.append(PlateDetector(settings.plates, settings.plate_threshold))
    return detectors


def event_of(report: BlurReport) -> dict[str, object]:
    """Return the event that says that a session was blurred, and by what."""
    return {
        "event": "blurred",
        "original_sha256": report.sha256,
        "models": [
            {"what": m.what, "file": m.file, "sha256": m.sha256, "threshold": m.threshold}
            for m in report.models
        ],
        "found": {model.what: report.total(model.what) for model in report.models},
    }


def _report(
    job: BlurJob,
    detectors: list[Detector],
    sha256: str,
    searched: Mapping[str, SearchedTopic],
    cover: ImageCover,
) -> BlurReport:
    models = tuple(
        UsedModel(what=d.what, file=d.model, sha256=d.sha256, threshold=d.threshold)
        for d in detectors
    )
    whats = [detector.what for detector in detectors]
    return BlurReport(
        session=job.session.name,
        sha256=sha256,
        consent=job.consent,
        models=models,
        margin=job.settings.margin,
        carry_frames=job.settings.carry_frames,
        scale=job.settings.scale,
        cameras=tuple(_camera(name, searched[name], cover, whats) for name in sorted(searched)),
        depth_topics=tuple(sorted(cover.depth_topics)),
        left_out=job.left_out,
    )


def _camera(name: str, topic: SearchedTopic, cover: ImageCover, whats: list[str]) -> BlurredCamera:
    left = cover.left.get(name, Counter())
    return BlurredCamera(
        topic=name,
        device=topic.device,
        images=len(topic.boxes),
        found={what: sum(frame.found.get(what, 0) for frame in topic.frames) for what in whats},
        changed=cover.changed[name],
        left={what: left.get(what, 0) for what in whats},
        smallest={what: round(min(heights), 1) for what, heights in topic.heights.items()},
        frames=tuple(topic.frames),
    )


def _sha256(reader: SessionReader) -> str:
    digest = hashlib.sha256()
    reader.stream.seek(0)
    while part := reader.stream.read(2**20):
        digest.update(part)
    return digest.hexdigest()


@dataclass(slots=True)
class _Steps:
    """Reports how much of a file is read, in per cent."""

    reader: SessionReader
    stage: str
    report: SendMessage
    last: int = field(default=-1)

    def count(self) -> None:
        """Note a message."""
        done = min(99, 100 * self.reader.position // max(self.reader.size, 1))
        if done > self.last:
            self.last = done
            self.report((self.stage, done))
