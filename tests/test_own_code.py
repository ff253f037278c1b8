"""Code of a user's own, as a user would write it: a calibrator, source, check and manoeuvre by name."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.named_code import UserCodeError, load
from seatrial.hybrid.calibrators import make_calibrator
from seatrial.hybrid.calibrators.own import OwnCalibrator, save
from seatrial.hybrid.calibrators.own import load as load_calibrator
from tests.conftest import Command, few_epochs
from tests.pages import block_of

PAGE = "howto/own_code.md"
CALIBRATOR, CHECK, MANOEUVRE, SOURCE = (
    block_of(PAGE, f"A {what}", "python") for what in ("calibrator", "check", "manoeuvre", "source")
)
CONFIGURATION = '[trial]\nname = "tilt"\n' + block_of(PAGE, "A source", "toml")

FAILING = """

class Failing:
    def fit(self, windows, track):
        self.half = len(windows) / 0  # line 5 from here

    def predict(self, windows):
        return windows.reference
"""
LOOSE_CABLE = """

class Inclinometer(Inclinometer):
    count = 0

    def read(self, timeout_s):
        self.count += 1
        if self.count == 4:
            raise OSError("the cable is out")
        return [super().read(timeout_s)]
"""
BROKEN = """

def broken(given):
    return given.bilge_level
"""

KEEPING = """
class Keeping:
    def fit(self, windows, track): ...
    def predict(self, windows): ...


class Telling(Keeping):
    def __getstate__(self):
        return {"model": sorted(self.model)}

    def __setstate__(self, state):
        self.model = set(state["model"])
"""


def line_of(text: str, code: str) -> str:
    """Where a line of code is, as an error tells it."""
    return f"line {[code in each for each in text.splitlines()].index(True) + 1}:"


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with a user's files."""
    texts = {
        "mine": CALIBRATOR + FAILING, "checks": CHECK + BROKEN, "turns": MANOEUVRE + BROKEN,
        "tilt": SOURCE + LOOSE_CABLE,
    }  # fmt: skip
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    (tmp_path / "tilt.toml").write_text(CONFIGURATION, encoding="utf-8")
    return tmp_path


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Networks beside a user's calibrator take seconds."""

    def made(method: str, seed: int = 0, plant: object = None) -> object:
        return (make_calibrator if ".py:" in method else few_epochs)(method, seed, plant)  # type: ignore[arg-type]

    for module in ("seatrial.hybrid.calibrators", "seatrial.hybrid.evaluation.study"):
        monkeypatch.setattr(f"{module}.make_calibrator", made)


@pytest.mark.usefixtures("quick")
def test_a_strangers_calibrator_is_benchmarked_in_one_table(own: Path, unseen: Path, command: Command) -> None:
    """It stands beside the paper's, has regions, and one that fails is left out with the line that failed."""
    done = command(
        "evaluate", unseen, "--vessel", "gunnerus_short", "--split", "leg", "--draws", "1", "--json",
        "--method", own / "mine.py:MeanMiss", "--method", own / "mine.py:Failing", "--method", "paper",
    )  # fmt: skip
    assert done.code == 0, done.err
    methods = done.json["splits"]["leg"]["methods"]
    mine, reference = (
        methods[name]["mean_distance_m"]["value"] for name in (f"{own}/mine.py:MeanMiss", "reference")
    )
    assert "paper" in methods
    assert mine < reference  # the ship is longer than her model: it misses the same way in many windows
    assert f"{own}/mine.py:Failing" not in methods
    assert line_of(CALIBRATOR + FAILING, "/ 0") in done.json["failed"][f"{own}/mine.py:Failing"]


@pytest.mark.usefixtures("quick")
def test_a_saved_calibrator_knows_the_code_that_made_it(own: Path, earlier: list[Path], unseen: Path) -> None:
    """It predicts as before it was saved, if its file is named; without it, or in another version, refused."""
    file, folder = own / "mine.py", own / "trained"
    name = f"{file}:MeanMiss"
    trained = st.train(earlier, "gunnerus_short", name)
    save(trained, folder)
    with pytest.raises(InputError, match=r"needs code of your own.*mine\.py:MeanMiss.*--method FILE\.py:CLASS"):
        load_calibrator(folder)
    before, after = (st.predict(unseen, "+60", each) for each in (trained, load_calibrator(folder, name)))
    np.testing.assert_allclose(after.track, before.track)
    assert after.region_m is not None
    assert (after.region_m[1:] > 0.0).all()
    moved = file.rename(own / "moved.py")
    with pytest.raises(InputError, match=r"no longer exists.*mine\.py:MeanMiss.*--method FILE\.py:CLASS"):
        load_calibrator(folder, name)
    again = st.predict(unseen, "+60", load_calibrator(folder, f"{moved}:MeanMiss"))
    np.testing.assert_allclose(again.track, before.track)
    file.write_text(CALIBRATOR + "# improved\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"another version.*SHA-256"):
        load_calibrator(folder, name)


def test_what_a_calibrator_keeps_is_saved_or_refused(own: Path) -> None:
    """Arrays, numbers and texts as they are; of other things the class has to say how."""
    (own / "kept.py").write_text(KEEPING, encoding="utf-8")
    calibrator = make_calibrator(f"{own}/kept.py:Keeping")
    assert isinstance(calibrator, OwnCalibrator)
    calibrator.range_, kept = np.zeros((2, 3)), vars(calibrator.own)
    kept |= {"gains": np.arange(4.0), "share": 0.5, "note": "by day"}
    again = make_calibrator(f"{own}/kept.py:Keeping").load_state_dict(calibrator.state_dict())
    assert isinstance(again, OwnCalibrator)
    assert {name: str(each) for name, each in vars(again.own).items()} == {
        name: str(each) for name, each in kept.items()
    }
    kept["model"] = {1.0, 2.0}
    with pytest.raises(ConfigurationError, match=r"keeps a set in model, which is not saved.*__getstate__"):
        calibrator.state_dict()
    told = make_calibrator(f"{own}/kept.py:Telling")
    assert isinstance(told, OwnCalibrator)
    told.range_, told.own.model = np.zeros((2, 3)), {1.0, 2.0}  # type: ignore[attr-defined]
    back = make_calibrator(f"{own}/kept.py:Telling").load_state_dict(told.state_dict())
    assert isinstance(back, OwnCalibrator)
    assert vars(back.own)["model"] == {1.0, 2.0}


def test_what_a_calibrator_may_know_ends_at_its_start(own: Path, unseen: Path) -> None:
    """Nothing that it is shown depends on what was measured after second 0."""
    from seatrial.hybrid.calibrators.own import window_inputs
    from seatrial.hybrid.prediction.dataset import load_dataset

    windows = load_dataset([unseen], 15, 5).windows
    reference = np.zeros_like(windows.track)
    shown = window_inputs(windows, reference)
    windows.track[:, 1:] += 1e6
    told = window_inputs(windows, reference)
    for name in ("start", "reference", "past", "commands"):
        np.testing.assert_array_equal(np.asarray(getattr(shown, name)), np.asarray(getattr(told, name)))
        assert np.nanmax(np.abs(np.asarray(getattr(told, name)))) < 1e5


def test_a_check_of_ones_own_stands_beside_ours(own: Path, unseen: Path, caplog: pytest.LogCaptureFixture) -> None:
    """One that fails is told with its line and traceback, and grades no channel."""
    fast = st.read(unseen)
    fast.loc[fast.index[100:110], "port_rpm"] = 260.0
    plain = st.check(fast)
    with caplog.at_level(logging.ERROR):
        found = st.check(fast, checks=[f"{own}/checks.py:{name}" for name in ("overspeed", "broken")])
    codes = {each.code: each for each in found.findings}
    assert codes["overspeed"].estimate["rpm"] == fast["port_rpm"].max()
    assert line_of(CHECK + BROKEN, "bilge") in codes["check_failed"].text
    assert {name: each.grade for name, each in found.channels.items() if name != "port_rpm"} == {
        name: each.grade for name, each in plain.channels.items() if name != "port_rpm"
    }
    assert "return given.bilge_level" in caplog.text


def test_a_manoeuvre_of_ones_own_stands_beside_ours(own: Path, unseen: Path) -> None:
    """Those found by us are as they were; a finder that fails takes nothing away."""
    plain = st.manoeuvres(unseen)
    found = st.manoeuvres(unseen, finders=[f"{own}/turns.py:{name}" for name in ("fastest_minute", "broken")])
    mine = found[found["kind"] == "fast_turn"]
    assert len(found) == len(plain) + 1
    table = st.read(unseen)
    most = np.abs(np.rad2deg(np.unwrap(np.deg2rad(table["heading_deg"].to_numpy()))))
    assert mine["value"].item() == pytest.approx(np.abs(most[60:] - most[:-60]).max(), rel=0.05)


def test_a_source_of_ones_own_is_recorded_and_opened_again(own: Path, command: Command) -> None:
    """What it tells becomes samples; the error in between is an event that names its line, and it goes on."""
    done = command("record", own / "tilt.toml", "-o", own / "out", "--duration", "2", "--json")
    assert done.code == 0, done.err
    assert line_of(SOURCE + LOOSE_CABLE, "raise OSError") in done.err
    assert "the cable is out" in done.err
    (recording,) = (own / "out").glob("*.mcap")
    table = st.read(recording)
    assert set(table["roll_deg"].dropna()) == {2.5}
    assert set(table["pitch_deg"].dropna()) == {-0.2}
    redecoded = own / "again.mcap"
    assert command("redecode", recording, "-o", redecoded).code == 0
    assert st.read(redecoded)["roll_deg"].count() == table["roll_deg"].count()


def test_an_installed_package_offers_what_it_has(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An entry point is a name like ours."""
    information = own / "stranger-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n", encoding="utf-8")
    (information / "entry_points.txt").write_text(
        "[seatrial.calibrators]\nmean_miss = mine:MeanMiss\n", encoding="utf-8"
    )
    monkeypatch.syspath_prepend(str(own))
    assert load("mean_miss", "calibrators").__name__ == "MeanMiss"
    with pytest.raises(ConfigurationError, match="did you mean mean_miss"):
        load("mean_mis", "calibrators")


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("nowhere.py:Mine", ConfigurationError, r"nowhere\.py: cannot be read: No such file"),
        ("mine.py:Mine", ConfigurationError, r"no Mine: it defines MeanMiss, Failing; write .*mine\.py:MeanMiss"),
        ("mine.py", ConfigurationError, r"which .* is meant .*MeanMiss"),
        ("checks.py:overspeed", ConfigurationError, r"is not a class"),
        ("empty.py:Empty", ConfigurationError, r"define fit\(self, windows, track\)"),
        ("few.py:Few", ConfigurationError, r"too many positional arguments; define fit\(self, windows, track\)"),
        ("syntax.py:Broken", UserCodeError, r"syntax\.py, line 2: .* failed: .*syntax"),
        ("absent.py:Mine", UserCodeError, r"absent\.py, line 1: .*ModuleNotFoundError: No module named 'no_such"),
        ("maker.py:Maker", UserCodeError, r"maker\.py, line 3: .*KeyError"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_said(own: Path, name: str, kind: type[Exception], words: str) -> None:
    """What, where, and what to do, in one line."""
    files = {
        "empty": "class Empty: ...\n",
        "few": "class Few:\n    def fit(self, windows): ...\n    def predict(self, windows): ...\n",
        "syntax": "x = 1\nclass Broken(:\n",
        "absent": "import no_such_module\n",
        "maker": "class Maker:\n    def __init__(self):\n        {}['x']\n"
        "    def fit(self, windows, track): ...\n    def predict(self, windows): ...\n",
    }
    for file, text in files.items():
        (own / f"{file}.py").write_text(text, encoding="utf-8")
    with pytest.raises(kind, match=words) as raised:
        make_calibrator(str(own / name))
    assert "\n" not in str(raised.value)
