"""``seatrial demo``: the whole chain on this machine, without hardware and without network.

A simulated ship sails a voyage; the emulator puts what her sensors would say onto a CAN bus, a serial line and
a MAVLink link; the recorder, a process of its own, records them; the recording is cut into held windows, a
calibrator that was trained on earlier voyages is judged on it, and a diagnosis names what the model lacks.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.errors import SourceError, bar
from seatrial.acquisition.core.files import write_text
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.emulator import NullModem, Playback, emulate
from seatrial.acquisition.recording.reader import Recording, read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.quality.check import DataQuality, check_recording
from seatrial.analysis.windows.held import HeldWindows, tables_of_recordings, windows_of_tables
from seatrial.hybrid.calibrators import TrainedCalibrator, train
from seatrial.hybrid.calibrators.own import save
from seatrial.hybrid.diagnosis.result import Diagnosis
from seatrial.hybrid.diagnosis.verdict import TOLERANCE
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.effects.catalogue import vessel_plant
from seatrial.hybrid.evaluation.validate import Validation, refuse_training_data, validate
from seatrial.hybrid.prediction.dataset import load_dataset
from seatrial.hybrid.report.folder import Choices, folder_report
from seatrial.hybrid.report.text import plain
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel, reference_model, trials_of
from seatrial.hybrid.workflows import diagnose_files, write_diagnosis

TEMPLATE = Path(__file__).resolve().parents[1] / "trials" / "demo.toml"
SHIP, MODEL, SEA_STATE = "gunnerus_long", "gunnerus_short", "gentle"
VOYAGE_S, TRAINING_VOYAGES, TRAINING_S = 1200.0, 6, 1800.0
SPEED = 24.0
HORIZON_S, STRIDE_S = 15, 5
_RECORDER_TIMEOUT_S = 30.0
_SILENCE_S = 5.0  # after which nothing more is on its way to a recording


@dataclass(frozen=True, slots=True)
class Demonstration:
    """What the demo made and found."""

    report: Path
    recording: Path
    played: Playback
    lost: dict[str, int]
    windows: HeldWindows
    validation: Validation
    diagnosis: Diagnosis


def demonstrate(folder: Path, seed: int, say: Callable[[str], None]) -> Demonstration:
    """Run the whole chain into ``folder``. ``say`` gets a line a step."""
    folder.mkdir(parents=True, exist_ok=True)
    say("1  simulate a voyage of the lengthened ship, as her sensors would report it")
    voyage = simulate_to(folder / "voyage.mcap", "voyage", VOYAGE_S, seed)
    say(f"2  play it {SPEED:g} times as fast onto a CAN bus, a serial line and MAVLink, and record them")
    played, recording_path = play_and_record(voyage, folder)
    recording = read_recording(recording_path)
    lost = lost_samples(played, recording)
    say(f"   {sum(played.counts.values()):,} values played, {sum(lost.values()):,} lost")
    say("3  check the data")
    quality = check_recording(recording)
    say(f"   {found_in(quality)}")
    say("4  bring it to 1 Hz and cut the windows in which the thrusters were held")
    tables = tables_of_recordings([recording_path])
    windows = windows_of_tables(tables, HORIZON_S, STRIDE_S)
    say(f"   {windows.kept} of {windows.candidates} windows held, dropped: {dropped_words(windows.dropped)}")
    say(f"5  train a calibrator on {TRAINING_VOYAGES} earlier voyages, on top of the model of the ship before")
    trained = train_on_earlier(folder, seed)
    say("6  validate it on the recorded voyage, which it has not seen")
    dataset = load_dataset([recording_path], HORIZON_S, STRIDE_S)
    refuse_training_data(dataset.sources, trained)
    model = reference_model(trials_of([recording_path]), MODEL)
    validation = replace(validate(dataset, vessel_plant(model.vessel), trained), model=model.said)
    say("7  diagnose what the model of the ship before lacks")
    diagnosis = diagnose_recording(recording_path, folder)
    for effect in diagnosis.effects:
        say(f"   {effect.sentence}")
    say("8  write the report")
    with bar("report") as progress:
        report, *_ = folder_report(folder, Choices(), progress, [recording_path])
    return Demonstration(report, recording_path, played, lost, windows, validation, diagnosis)


def diagnose_recording(recording: Path, folder: Path) -> Diagnosis:
    """Diagnose the recorded voyage against the model of the ship before; a report of its own in ``diagnosis``."""
    vessel, out = load_vessel(MODEL), folder / "diagnosis"
    out.mkdir(exist_ok=True)
    with bar("diagnosing") as progress:
        examined = diagnose_files([recording], vessel, TOLERANCE, CATALOGUE, progress=progress)
    write_diagnosis(examined, vessel, out)
    return examined.diagnosis


def dropped_words(dropped: Mapping[str, int]) -> str:
    """Why windows were dropped, in words."""
    return ", ".join(f"{count} {plain(reason)}" for reason, count in dropped.items()) or "none"


def found_in(quality: DataQuality) -> str:
    """The check in a line: how many channels are good and what was found."""
    good = sum(each.grade == "good" for each in quality.channels.values())
    codes = Counter(each.code for each in quality.findings)
    found = ", ".join(f"{count} {code.replace('_', ' ')}" for code, count in codes.items()) or "nothing found"
    return f"{good} of {len(quality.channels)} channels good; {found}"


def simulate_to(path: Path, manoeuvre: str, duration_s: float, seed: int) -> Path:
    """Simulate a trial of the lengthened ship and write it as a recording."""
    table, _ = simulate_trial(SHIP, SEA_STATE, manoeuvre, duration_s, 10.0, seed)
    origin = load_config(TEMPLATE).trial.origin
    latitude_deg, longitude_deg = origin or (None, None)
    trial = Trial(path.stem, SHIP, origin_latitude_deg=latitude_deg, origin_longitude_deg=longitude_deg)
    write_table(table, path, trial, source="simulated")
    return path


def play_and_record(voyage: Path, folder: Path) -> tuple[Playback, Path]:
    """Play a recording onto simulated lines while the recorder, a process of its own, records them."""
    port = _free_udp_port()
    with bar("recording") as progress, NullModem() as can, NullModem() as serial:
        sending = _configuration(folder / "emulator.toml", can.emulator_device, serial.emulator_device, port)
        receiving = _configuration(folder / "logger.toml", can.logger_device, serial.logger_device, port)
        recorder = _start_recorder(receiving, folder / "recordings")
        try:
            played = emulate(voyage, load_config(sending), SPEED, progress)
            _wait_for_all(folder / "recordings", played.counts)
        finally:
            recorder.send_signal(signal.SIGINT)
            stdout, stderr = recorder.communicate(timeout=_RECORDER_TIMEOUT_S)
    if recorder.returncode != 0:
        raise SourceError("the recorder failed", where="demo", why=stderr.strip())
    return played, Path(stdout.strip())


def _wait_for_all(folder: Path, counts: Mapping[str, int]) -> None:
    """Return when the recording holds all that was played, or has not grown for a while: then some are lost."""
    held, grown_s = -1, time.monotonic()
    while held < sum(counts.values()) and time.monotonic() - grown_s < _SILENCE_S:
        time.sleep(0.5)
        now = _held(folder, counts)
        if now > held:
            held, grown_s = now, time.monotonic()


def _held(folder: Path, names: Iterable[str]) -> int:
    """The number of values of these channels in the recording that a recorder is writing."""
    series = [read_recording(path).series for path in folder.glob("*.mcap")]
    return sum(each[name].value.size for each in series for name in names if name in each)


def _configuration(path: Path, can_device: str, serial_device: str, port: int) -> Path:
    """The demo's configuration with its cables and port filled in."""
    text = TEMPLATE.read_text(encoding="utf-8")
    dbc = TEMPLATE.parent / "vessels" / "thrusters.dbc"
    text = text.replace('"CAN_LINE"', f'"{can_device}"').replace('"SERIAL_LINE"', f'"{serial_device}"')
    text = text.replace("port = 14554", f"port = {port}").replace("vessels/thrusters.dbc", str(dbc))
    return write_text(path, text)


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _start_recorder(config: Path, folder: Path) -> subprocess.Popen[str]:
    """``seatrial record`` as a process, returned when its lines are open."""
    process = subprocess.Popen(
        [sys.executable, "-c", "import seatrial; seatrial.main()", "record", str(config), "-o", str(folder)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    said: list[str] = []
    while process.stderr is not None and (line := process.stderr.readline()):
        said.append(line)
        if line.startswith("recording to"):
            return process
    raise SourceError("the recorder did not start", where="demo", why=" ".join(said))


def lost_samples(played: Playback, recording: Recording) -> dict[str, int]:
    """How many of the played values of each channel the recording lacks."""
    return {
        name: count - (recording.series[name].value.size if name in recording.series else 0)
        for name, count in played.counts.items()
        if name in NAMES
    }


def train_on_earlier(folder: Path, seed: int) -> TrainedCalibrator:
    """Train on voyages of other days, on top of the model of the ship before she was lengthened."""
    paths = [
        simulate_to(folder / "training" / f"voyage_{number + 1}.mcap", "voyage", TRAINING_S, seed + 100 + number)
        for number in range(TRAINING_VOYAGES)
    ]
    plant = vessel_plant(load_vessel(MODEL))
    dataset = load_dataset(paths, HORIZON_S, STRIDE_S, shorter=True)
    with bar("training") as progress:
        trained = train(dataset, MODEL, plant, seed=seed, progress=progress)
    save(trained, folder / "calibrator")
    return trained
