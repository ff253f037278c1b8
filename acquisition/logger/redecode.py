"""``seatrial redecode``: the channels of a recording anew from its raw input, with a corrected configuration.

The raw input is copied as it is, and so is what people and the recorder noted and what was foretold; everything
else (channels, fixes, what decoding told) comes from decoding again.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from seatrial.acquisition.config.configuration import CONFIGURATION, PACK_ENDING, TrialConfig, parse_config
from seatrial.acquisition.config.sections import Carried
from seatrial.acquisition.core.actuators import from_text
from seatrial.acquisition.core.channels import is_ship_known
from seatrial.acquisition.core.errors import InputError, StorageError
from seatrial.acquisition.core.files import atomic_file, expect_suffix
from seatrial.acquisition.core.frames import Frame
from seatrial.acquisition.core.progress import Progress
from seatrial.acquisition.logger.health import Health
from seatrial.acquisition.logger.pipeline import health_of
from seatrial.acquisition.logger.processing import DECODED, FrameProcessor
from seatrial.acquisition.recording.messages import encode
from seatrial.acquisition.recording.reader import MessageEntry, MessageStream, read_trial
from seatrial.acquisition.recording.schemas import EVENT_TOPIC, PREDICTED_TRACK_TOPIC, PREDICTION_TOPIC, RAW_PREFIX
from seatrial.acquisition.recording.writer import RecordingWriter

_FLUSH_EVERY = 10_000  # messages, some megabytes; what is not flushed is in memory


@dataclass(slots=True)
class RedecodeSummary:
    """What was decoded again: raw frames in, samples out, and frames of sources that are not configured.

    ``left_out`` counts predictions of a version that made others.
    """

    health: Health
    frames: int = 0
    left_out: int = 0
    unknown: dict[str, int] = field(default_factory=dict)


def redecode(
    paths: list[Path], target: Path, config: TrialConfig | None = None, progress: Progress | None = None
) -> RedecodeSummary:
    """Decode the raw input of a recording's parts, given in order, into ``target``.

    Without ``config`` the recording's own serves: the same decoding with today's software. Raises
    :class:`InputError` for recordings without raw input or configuration, :class:`StorageError`.
    """
    expect_suffix(target, ".mcap")
    if target.exists():
        raise StorageError("already exists", where=str(target), fix="choose another file, or delete it")
    with tempfile.TemporaryDirectory(prefix="seatrial-redecode-") as scratch:
        config = config or own_configuration(paths[0], Path(scratch))
        with atomic_file(target) as partial:
            with RecordingWriter(partial, config.trial, config.attachments) as writer:
                result = _decode_all(paths, config, writer, progress or (lambda share: None))
            if result.frames == 0:
                raise InputError("contains no raw input to decode", where=str(paths[0]))
    return result


def own_configuration(path: Path, scratch: Path) -> TrialConfig:
    """The configuration that a recording carries, its DBC files laid out in ``scratch``."""
    stream = MessageStream(path)
    next(iter(stream), None)
    text = stream.attachments.get(CONFIGURATION)
    if text is None:
        fix = "give one with --config, as `seatrial record` takes it"
        raise InputError("contains no configuration", where=str(path), fix=fix)
    files: dict[str, Path] = {}
    packs: dict[str, str] = {}
    for attachment, data in stream.attachments.items():
        name, dot, ending = attachment.rpartition(".")
        if ending == "dbc":
            files[name] = scratch / f"{len(files)}.dbc"
            files[name].write_bytes(data)
        elif dot + ending == PACK_ENDING:
            packs[name] = data.decode("utf-8", "replace")
    run_sheet = read_trial(path)
    is_known = is_ship_known(run_sheet.vessel, run_sheet.actuators)
    carried = Carried(files, packs, from_text(run_sheet.actuators), ship_is_known=is_known)
    config = parse_config(text.decode("utf-8", "replace"), path, carried)
    if config.trial.origin is not None or run_sheet.origin is None:
        return config
    latitude_deg, longitude_deg = run_sheet.origin  # of a fix in an earlier part of the recording
    trial = replace(config.trial, origin_latitude_deg=latitude_deg, origin_longitude_deg=longitude_deg)
    return replace(config, trial=trial)


def _decode_all(
    paths: list[Path], config: TrialConfig, writer: RecordingWriter, progress: Progress
) -> RedecodeSummary:
    result = RedecodeSummary(health_of(config))
    processing = FrameProcessor(config, writer, result.health)
    last_ns = 0
    for number, entry in enumerate(_entries(paths, progress), start=1):
        if number % _FLUSH_EVERY == 0:
            writer.flush()
        if number == 1:
            result.health.started_ns = entry.log_ns
        result.health.ended_ns = last_ns = max(last_ns, entry.log_ns)
        if entry.topic.startswith(RAW_PREFIX):
            frame = _frame(entry, paths)
            if frame.origin in result.health.sources:
                result.health.sources[frame.origin].count_in(1, frame.monotonic_ns)
                processing.process(frame)
                result.frames += 1
            else:
                writer.write_raw(frame)
                result.unknown[frame.origin] = result.unknown.get(frame.origin, 0) + 1
        elif _is_kept(entry):
            result.left_out += not _renew(entry, writer)
    processing.report_handovers()
    names = ", ".join(path.name for path in paths)
    processing.note(f"decoded again from {names}", last_ns)
    if result.left_out:
        processing.note(f"{result.left_out:,} predictions of another version were left out", last_ns, "warning")
    return result


def _renew(entry: MessageEntry, writer: RecordingWriter) -> bool:
    """Write a message as it is written today; False for one of another version, which does not fit."""
    try:
        data = encode(entry.topic, entry.body())
    except (KeyError, TypeError, ValueError):
        return False
    writer.write(entry.topic, data, entry.log_ns, entry.publish_ns)
    return True


def _is_kept(entry: MessageEntry) -> bool:
    """Whether a message was no product of decoding: what was noted, and what was foretold at the time."""
    if entry.topic == EVENT_TOPIC:
        return bool(entry.body().get("name") != DECODED)
    return entry.topic in (PREDICTION_TOPIC, PREDICTED_TRACK_TOPIC)


def _entries(paths: list[Path], progress: Progress) -> Iterator[MessageEntry]:
    for number, path in enumerate(paths):
        yield from MessageStream(path)
        progress((number + 1) / len(paths))


def _frame(entry: MessageEntry, paths: list[Path]) -> Frame:
    try:
        return entry.frame()
    except (ValueError, KeyError, TypeError) as error:
        what = f"topic {entry.topic} contains a message that is not a raw input of Seatrial"
        where, why = ", ".join(map(str, paths)), f"{type(error).__name__} {error}"
        raise InputError(what, where=where, why=why) from error
