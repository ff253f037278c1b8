"""A batch of recordings in an object store, and results in one: the same files as on the disk."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

import seatrial
from seatrial import app
from seatrial.acquisition.core import stores
from seatrial.acquisition.core.errors import InputError, StorageError
from seatrial.analysis.batch import BatchJob, BatchSummary, process_into_store, run_batch
from tests.analysis.small_batch import QUICK, cluster, hashes, local_cluster, sailed, write_batch
from tests.stores import BUCKET, clear_connections, every_tenth_fails, needs_store, object_store, put

pytestmark = needs_store
SEASON, RESULTS = f"s3://{BUCKET}/season", f"s3://{BUCKET}/results"


@pytest.fixture(autouse=True)
def own_connections() -> Iterator[None]:
    """A connection keeps what a test has put in the place of its requests."""
    yield
    clear_connections()


@pytest.fixture(scope="module")
def store() -> Iterator[str]:
    with object_store() as address:
        yield address


@pytest.fixture(scope="module")
def season(store: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three sound recordings and a text, in a folder and in the store."""
    folder = tmp_path_factory.mktemp("voyages") / "season"
    write_batch(folder, [sailed(60, 1.0, seed, yaw_rate_dps=seed - 1.0) for seed in range(3)], 3)
    (folder / "text.mcap").write_text("time,heading_deg\n")
    for path in sorted(folder.rglob("*.mcap")):
        put(path, f"season/{path.relative_to(folder).as_posix()}")
    return folder


@pytest.fixture(scope="module")
def scheduler(store: str) -> Iterator[str]:
    """The address of a worker that has the credentials of the store."""
    with local_cluster(workers=1) as address:
        yield address


@pytest.fixture(scope="module")
def both(
    season: Path, scheduler: str, tmp_path_factory: pytest.TempPathFactory
) -> tuple[BatchSummary, BatchSummary, Path]:
    """The batch on the disk, the one in the store, and the folder of the first."""
    out = tmp_path_factory.mktemp("out")
    local = run_batch(season, out, scheduler=scheduler, options=QUICK)
    return local, run_batch(SEASON, RESULTS, scheduler=scheduler, options=QUICK), out


def stored(prefix: str, folder: Path) -> Path:
    """A copy of all files below a place in the bucket, to be compared."""
    import_module("fsspec").filesystem("s3").get(f"{BUCKET}/{prefix}/", str(folder) + "/", recursive=True)
    return folder


def test_results_in_a_store_equal_those_on_the_disk_byte_for_byte(
    both: tuple[BatchSummary, BatchSummary, Path], tmp_path: Path
) -> None:
    local, remote, out = both
    assert (remote.done, remote.failed, remote.reused) == (3, 1, 0)
    assert remote.rows == local.rows
    assert remote.failures == local.failures
    assert stores.place_name(remote.index) == f"{RESULTS}/index.html"
    assert hashes(stored("results", tmp_path)) == hashes(out)


def test_a_batch_resumes_from_the_results_in_the_store(
    both: tuple[BatchSummary, BatchSummary, Path], season: Path, scheduler: str, tmp_path: Path
) -> None:
    put(season / "day_01" / "trial_001.mcap", "later/extra.mcap")
    place = f"s3://{BUCKET}/later"
    result = CliRunner().invoke(
        app, ["batch", SEASON, "-o", RESULTS, "--scheduler", scheduler, "--no-smooth", "--no-pictures", "--json"]
    )
    assert result.exit_code == 1  # the text is no recording
    answer = json.loads(result.stdout)
    assert (answer["done"], answer["reused"], answer["failed"]) == (3, 3, 1)
    summary = run_batch(place, tmp_path / "mixed", scheduler=scheduler, options=QUICK)
    assert (summary.done, summary.failed) == (1, 0)


def test_a_store_that_fails_every_tenth_request_gives_the_same_result(
    both: tuple[BatchSummary, BatchSummary, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(stores, "_FIRST_PAUSE_S", 0.0)
    clear_connections()
    failures = every_tenth_fails(monkeypatch)
    for number in (1, 2, 3):
        name = f"day_01/trial_{number:03d}"
        job = BatchJob(name, f"{SEASON}/{name}.mcap", str(tmp_path / "marks"), QUICK, store=f"{RESULTS}_again")
        assert process_into_store(job)["status"] == "done"
    assert len(failures) >= 3
    monkeypatch.undo()
    clear_connections()
    again = hashes(stored("results_again", tmp_path / "again"))
    assert again == {name: digest for name, digest in hashes(both[2]).items() if name.startswith("day_01/")}


def test_a_sample_tells_what_the_rest_takes_and_is_not_done_twice(season: Path, scheduler: str) -> None:
    """The plan by the listing alone: nothing is fetched but the sample."""
    sizes = [path.stat().st_size for path in sorted(season.rglob("*.mcap"))]
    results = f"s3://{BUCKET}/sampled"
    options = ["--sample", "2", "--scheduler", scheduler, "--no-smooth", "--no-pictures", "--json"]
    printed = CliRunner().invoke(app, ["batch", SEASON, "-o", results, *options])
    remainder = json.loads(printed.stdout)["remainder"]
    assert f"{len(sizes)} recordings, {sum(sizes) / 1e6:.1f} MB" in printed.stderr
    assert f"{len(sizes) - 2} recordings, " in printed.stderr
    assert "remain: at this pace" in printed.stderr
    assert remainder["recordings"] == len(sizes) - 2
    assert remainder["bytes"] == sum(sizes[1:-1])
    assert remainder["estimate_s"] > 0.0
    whole = run_batch(SEASON, results, scheduler=scheduler, options=QUICK)
    assert (whole.reused, whole.done, whole.remainder) == (1, 3, None)
    again = run_batch(SEASON, results, scheduler=scheduler, options=QUICK, sample=1).remainder
    assert again is not None
    assert again.estimate_s is None


@pytest.mark.slow
def test_a_cluster_of_other_processes_works_from_store_to_store(
    both: tuple[BatchSummary, BatchSummary, Path], tmp_path: Path
) -> None:
    """Scheduler and workers started by dask's own commands, each with the credentials in its environment."""
    local, _, out = both
    with cluster(workers=2) as address:
        summary = run_batch(SEASON, f"s3://{BUCKET}/clustered", scheduler=address, options=QUICK)
    assert (summary.done, summary.failed) == (local.done, local.failed)
    assert hashes(stored("clustered", tmp_path / "fetched")) == hashes(out)


def test_export_into_a_store_and_import_from_it_are_a_round_trip(season: Path, tmp_path: Path) -> None:
    recording, table = f"{SEASON}/day_01/trial_001.mcap", f"s3://{BUCKET}/tables/trial.csv"
    for arguments in (
        ["export", recording, "-o", table, "--rate", "1"],
        ["import", table, "-o", f"s3://{BUCKET}/tables/trial.mcap", "--yes"],
        ["windows", f"s3://{BUCKET}/tables/trial.mcap", "-o", f"s3://{BUCKET}/tables/windows.parquet"],
        ["check", f"s3://{BUCKET}/tables/trial.mcap", "-o", f"s3://{BUCKET}/tables/quality"],
    ):
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 0, result.output
    assert set(hashes(stored("tables", tmp_path))) == {
        "trial.csv", "trial.csv.json", "trial.mcap", "windows.parquet", "windows.starts.parquet",
        "quality/quality.json", "quality/flags.parquet", "quality/quality.html",
    }  # fmt: skip
    original = seatrial.prepare(season / "day_01" / "trial_001.mcap")
    back = seatrial.prepare(tmp_path / "trial.mcap")
    pd.testing.assert_frame_equal(back[original.columns], original, atol=1e-6)


def test_what_a_store_refuses_to_take_leaves_nothing(season: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def refuse(*arguments: object, **options: object) -> None:
        if str(arguments[1:]).find("trial.csv.json") < 0:  # the table's own file comes last
            raise PermissionError("Access Denied")
        return await put_file(*arguments, **options)

    system = import_module("s3fs").S3FileSystem
    put_file = system._put_file
    monkeypatch.setattr(system, "_put_file", refuse)
    clear_connections()
    with pytest.raises(StorageError, match="refused by its store: Access Denied"):
        seatrial.export(season / "day_01" / "trial_001.mcap", f"s3://{BUCKET}/refused/trial.csv")
    assert stores.files_below(f"s3://{BUCKET}/refused") == []


def test_wrong_places_are_one_line(season: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no-such-bucket: is in no such bucket"):
        run_batch("s3://no-such-bucket", tmp_path / "out", workers=1)
    recording = season / "day_01" / "trial_001.mcap"
    with pytest.raises(StorageError, match=r"s3://no-such-bucket/trial\.parquet: is in no such bucket"):
        seatrial.export(recording, "s3://no-such-bucket/trial.parquet")
    same = f"{SEASON}/day_01/trial_001.mcap"
    result = CliRunner().invoke(app, ["check", same, "--repair", same])
    assert "is an input of this command" in str(result.exception)
    result = CliRunner().invoke(app, ["train", str(recording), "-o", f"s3://{BUCKET}/calibrator"])
    assert "is in an object store" in str(result.exception)
