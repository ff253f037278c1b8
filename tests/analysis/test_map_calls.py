"""Calls on worker processes: their results in order, whatever the number of workers, and the first error raised."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from importlib import import_module
from math import sqrt

import pytest

from seatrial.analysis import batch as module
from seatrial.analysis.batch import map_calls


@pytest.fixture(scope="module", autouse=True)
def one_cluster() -> Iterator[None]:
    """The workers of all tests here, threads of this process: to start processes takes longer than all that they
    do, and a batch is tried on those."""
    distributed = import_module("distributed")
    cluster = distributed.LocalCluster(2, threads_per_worker=1, processes=False, dashboard_address=None)
    client = distributed.Client(cluster, set_as_default=False)
    with cluster, client, pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_dask_client", lambda workers, scheduler: nullcontext(client))
        yield


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_calls(workers: int) -> None:
    shares: list[float] = []
    assert map_calls([(sqrt, 9.0), (divmod, 7, 2), (sqrt, 4.0)], workers, shares.append) == [3.0, (3, 1), 2.0]
    assert shares == pytest.approx([1 / 3, 2 / 3, 1.0])


@pytest.mark.parametrize("workers", [1, 2])
def test_each_result_is_told_with_its_number_as_soon_as_it_is_there(workers: int) -> None:
    told: dict[int, object] = {}
    results = map_calls([(sqrt, 9.0), (sqrt, 4.0)], workers, finished=told.__setitem__)
    assert [told[0], told[1]] == results == [3.0, 2.0]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_ends_all(workers: int) -> None:
    with pytest.raises(ValueError, match="math domain"):
        map_calls([(sqrt, 9.0), (sqrt, -1.0)], workers)
