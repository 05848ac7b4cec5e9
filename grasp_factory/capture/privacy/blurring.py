"""Blurring a session into a new one; the original is removed on request alone, at the end."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from grasp_factory.capture.consent import Consent, consent_of
from grasp_factory.capture.privacy.blur_job import BlurJob, BlurResult, blur
from grasp_factory.capture.privacy.blur_report import BlurReport
from grasp_factory.capture.privacy.blur_settings import BlurSettings
from grasp_factory.capture.privacy.face_model import face_model_file
from grasp_factory.capture.session_reader import (
    CALIBRATION_FOLDER,
    MCAP_FILE,
    RECOVERED_FILE,
    SETTINGS_FILE,
    SUMMARY_FILE,
)
from grasp_factory.capture.session_series import SESSION_LIMITS
from grasp_factory.capture.session_settings import session_settings
from grasp_factory.core.atomic_file import fsync
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.output_folder import check_free, publish
from grasp_factory.core.place import Place, place_at, place_of
from grasp_factory.core.place_tree import entries, files_below, fsync_tree
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import CaptureError, ConfigError, StoreError, UsageError

REPORT_FILE = "privacy.json"
_WHAT = "a blur"
_LONGEST_PREFIX = 40
"""Characters of the name that the hidden scratch folder repeats: file systems limit its length."""


def blur_session(
    session: Path,
    out: Path,
    settings: BlurSettings,
    *,
    delete_original: bool = False,
    on_progress: Callable[[tuple[str, int]], None] = lambda progress: None,
) -> BlurResult:
    """Write a new session without the faces and plates that are found in its images.

    All else is copied byte for byte. ``out`` appears when it is complete and was compared with the
    original; after an error it does not exist.

    Args:
        session: the folder of a session.
        out: the folder to create. It must not exist.
        settings: what is blurred, and how.
        delete_original: remove ``session`` when ``out`` is complete and on the disk.
        on_progress: called with the stage (one of ``blur_job.STAGES``) and per cent.

    Raises:
        UsageError: for a place that is taken, or a plate model that cannot be read.
        MissingLibraryError: if the face model is not installed.
        CaptureError: if the session is damaged, or has images that cannot be blurred.
        StoreError: if it needs too much memory or time, or the disk fails.
    """
    face_model_file()
    consent = _consent(session)
    check_free(out, _WHAT)
    _check_apart(session, out)
    try:
        copied, left_out = _files(session)
        prefix = f"{out.name[:_LONGEST_PREFIX]}.blurring"
        with scratch_folder(out.parent, prefix) as scratch:
            built = scratch / "out"
            built.mkdir()
            job = BlurJob(
                session=session,
                folder=built,
                settings=settings,
                consent=consent,
                left_out=tuple(left_out),
            )
            found: BlurResult = in_import_process(
                blur, job, session, on_progress, limits=SESSION_LIMITS
            )
            _copy(copied, built)
            _write_report(built, found.report)
            fsync_tree(place_at(built))
            publish(built, out, _WHAT)
            fsync([out.parent])
        if delete_original:
            place_at(session).rmtree()
    except OSError as error:
        raise StoreError(f"{out} cannot be written: {error.strerror or error}") from None
    return found


def _consent(session: Path) -> Consent:
    try:
        return consent_of(session_settings(session))
    except ConfigError as error:
        raise CaptureError(f"{session / SETTINGS_FILE}: {error}") from None


def _check_apart(session: Path, out: Path) -> None:
    """Refuse an output inside of the session, which --delete-original would remove with it."""
    if session.resolve() in out.resolve().parents:
        raise UsageError(f"{out} is inside of {session}: choose a folder beside it")


def _files(session: Path) -> tuple[list[Place], list[str]]:
    """Return the files that are copied as they are, and the names that are left out.

    Raises:
        IrregularFileError: if one is a link, or no regular file.
    """
    place = place_of(session)
    found = entries(place)
    kept = {SETTINGS_FILE, SUMMARY_FILE}
    copied = [place / name for name in (*found.files, *found.others) if name in kept]
    if CALIBRATION_FOLDER in (*found.folders, *found.others):
        copied += files_below(place / CALIBRATION_FOLDER)
        kept.add(CALIBRATION_FOLDER)
    left_out = {*found.files, *found.folders, *found.others} - {*kept, MCAP_FILE, RECOVERED_FILE}
    return copied, sorted(left_out)


def _copy(files: list[Place], built: Path) -> None:
    for file in files:
        target = built / file.inner
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(file.read_bytes(DOCUMENT))


def _write_report(built: Path, report: BlurReport) -> None:
    text = json.dumps(to_plain(report), indent=1)
    (built / REPORT_FILE).write_text(text + "\n", encoding="utf-8")
