"""What all tests share: the recorded data, if they are here; simulated voyages and a calibrator trained on them."""

from __future__ import annotations

import os

# Two processes share the cores: threads of BLAS would wait for each other, a tenth of the time and more under load.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gc
import json
import subprocess
import sys
from collections.abc import Callable, Generator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

import seatrial

if TYPE_CHECKING:
    from _pytest.mark.structures import ParameterSet

    from seatrial.hybrid.calibrators import TrainedCalibrator
    from seatrial.hybrid.calibrators.networks import NetworkCalibrator
    from seatrial.hybrid.vessel.plant import Plant

# How long an example takes is the machine's affair, and no finding. `make nightly` tries all examples.
for profile in ("day", "night"):
    settings.register_profile(profile, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("day")
SHARE_BY_DAY, LEAST_BY_DAY = 4, 10

ROOT = Path(__file__).resolve().parents[1]
COMPILED = "seatrial/compiled"  # in pytest's cache: what the kernels on the disk were compiled from
COMPILING = pytest.StashKey[subprocess.Popen[bytes]]()

Simulated = Callable[..., Path]
SMALL_HORIZON_S = 30


@dataclass(frozen=True, slots=True)
class Done:
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The one JSON object on stdout; NaN and Infinity are none."""

        def refuse(constant: str) -> None:
            raise ValueError(f"{constant} is no JSON")

        return json.loads(self.out, parse_constant=refuse)


Command = Callable[..., Done]


@pytest.hookimpl(trylast=True)  # after hypothesis has marked its own
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """By day a property is tried on a quarter of its examples, ten at least; they are others every day."""
    if settings.get_current_profile_name() == "night":
        return
    functions = {getattr(item, "obj", None) for item in items if item.get_closest_marker("hypothesis")}
    for function in functions:
        asked = function._hypothesis_internal_use_settings  # where hypothesis's own plugin reads and changes it
        few = min(asked.max_examples, max(LEAST_BY_DAY, asked.max_examples // SHARE_BY_DAY))
        function._hypothesis_internal_use_settings = settings(asked, max_examples=few)


def kernel_sources() -> str:
    """A digest of what kernels are compiled from; empty where none is on the disk."""
    if not any(Path(os.environ.get("NUMBA_CACHE_DIR", ROOT / "hybrid")).rglob("*.nbi")):
        return ""
    folders = [ROOT / name for name in ("acquisition/recording", "analysis", "hybrid")]
    sources = sorted(source for folder in folders for source in folder.rglob("*.py"))
    return sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is imported and collected stays; to look through it for garbage took a quarter of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config: pytest.Config) -> None:
    """Kernels that may be missing are compiled once, while the workers collect, and not by every worker."""
    if config.cache and config.cache.get(COMPILED, None) != kernel_sources():
        config.stash[COMPILING] = subprocess.Popen([sys.executable, "-m", "tests.kernels"], cwd=ROOT)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: Any) -> None:
    """No test begins before the kernels are there."""
    compiling = node.config.stash.get(COMPILING, None)
    if compiling and not compiling.wait() and node.config.cache:
        node.config.cache.set(COMPILED, kernel_sources())


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """``seatrial`` in this process: imports are paid once."""

    def run(*arguments: str | Path) -> Done:
        monkeypatch.setattr(sys, "argv", ["seatrial", *map(str, arguments)])
        monkeypatch.setattr(os, "nice", lambda _: 0, raising=False)  # all later tests would go on as idle ones
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            seatrial.main()
        out, err = capsys.readouterr()
        code = ended.value.code
        return Done(code if isinstance(code, int) else int(bool(code)), out, err)

    return run


@pytest.fixture(scope="session", autouse=True)
def without_progress_lines() -> Generator[None]:
    """However slow the machine is, what a command prints has no lines of progress among it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seatrial.acquisition.core.errors.PROGRESS_INTERVAL_S", float("inf"))
        yield


def nightly(*cases: object) -> list[ParameterSet]:
    """Further cases of a kind of which one runs by day; a tuple has the values of several parameters."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow) for case in cases]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded data; the test is skipped, saying so, where it is missing."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("SEATRIAL_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no recorded data at {folder}; set SEATRIAL_DATA to the folder that holds them")
    return folder


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """Recordings of the lengthened ship in the paper's manoeuvre; one that was asked for before is given again."""
    from seatrial.acquisition.core.trial import Trial
    from seatrial.acquisition.recording.writer import write_table
    from seatrial.hybrid.simulation.trial import simulate_trial

    folder = tmp_path_factory.mktemp("simulated")

    def recording(sea_state: str, seed: int, duration_s: float, rate_hz: float = 1.0) -> Path:
        path = folder / f"{sea_state}_{seed}_{duration_s:g}s_{rate_hz:g}Hz.mcap"
        if not path.exists():
            table, _ = simulate_trial("gunnerus_long", sea_state, "paper", duration_s, rate_hz, seed)
            write_table(table, path, Trial(name=path.stem, vessel="gunnerus_long"), source="simulated")
        return path

    return recording


@pytest.fixture(scope="session")
def earlier(simulated: Simulated) -> list[Path]:
    """The voyages that the small calibrator is trained on."""
    return [simulated("gentle", seed, 1200.0) for seed in range(4)]


@pytest.fixture(scope="session")
def unseen(simulated: Simulated) -> Path:
    """A voyage that the small calibrator has not seen."""
    return simulated("gentle", 100, 1200.0)


def few_epochs(method: str, seed: int = 0, plant: Plant | None = None, epochs: int = 120) -> NetworkCalibrator:
    """An untrained calibrator that takes seconds to train, not minutes."""
    from seatrial.hybrid.calibrators import networks

    kinds = {
        "paper": networks.PaperCalibrator,
        "data_driven": networks.DataDrivenCalibrator,
        "additive": networks.AdditiveCalibrator,
    }
    calibrator = kinds[method](seed, plant)
    calibrator.epochs, calibrator.batch = epochs, 128
    return calibrator


@pytest.fixture(scope="session")
def small(earlier: list[Path]) -> TrainedCalibrator:
    """A calibrator on the ship before she was lengthened, trained on little and for a short time."""
    from seatrial.hybrid.calibrators import train_calibrator
    from seatrial.hybrid.effects import vessel_plant
    from seatrial.hybrid.prediction.dataset import load_dataset
    from seatrial.hybrid.vessel.files import load_vessel

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seatrial.hybrid.calibrators.make_calibrator", few_epochs)
        dataset = load_dataset(earlier, SMALL_HORIZON_S, 5)
        return train_calibrator(dataset, "gunnerus_short", vessel_plant(load_vessel("gunnerus_short")), "paper")


@pytest.fixture(scope="session")
def small_folder(small: TrainedCalibrator, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small calibrator on disk."""
    from seatrial.hybrid.calibrators.own import save

    return save(small, tmp_path_factory.mktemp("calibrator") / "small").parent
