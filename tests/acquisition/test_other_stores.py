"""Addresses gs://, az:// and abfs://: the same requests go to the file system that fsspec has for them.

Neither package is needed: fsspec's own file system in memory stands in for both.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import seatrial as st
from seatrial.acquisition.core.errors import SeatrialError
from tests.acquisition.test_stores import write_voyage

fsspec = pytest.importorskip("fsspec", reason="fsspec, which reads object stores, is not installed")
PACKAGES = {"gs": "gcsfs", "az": "adlfs", "abfs": "adlfs", "abfss": "adlfs"}


@pytest.fixture(params=PACKAGES)
def scheme(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A store of each kind, its package and file system by what is in memory."""
    from fsspec.implementations.memory import MemoryFileSystem
    from fsspec.registry import _registry

    stand_in = type("StandIn", (MemoryFileSystem,), {"protocol": request.param, "store": {}, "pseudo_dirs": [""]})
    monkeypatch.setitem(sys.modules, PACKAGES[request.param], ModuleType(PACKAGES[request.param]))
    monkeypatch.setitem(_registry, request.param, stand_in)
    yield request.param
    stand_in.clear_instance_cache()


@pytest.fixture(scope="module")
def voyage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_voyage(tmp_path_factory.mktemp("voyage") / "voyage.mcap", 60)


def test_recording_in_a_store_is_that_of_the_file(scheme: str, voyage: Path, tmp_path: Path) -> None:
    """Its samples, its channels, and a table that is exported into the store."""
    fsspec.filesystem(scheme).put_file(str(voyage), "season/voyage.mcap")
    place = f"{scheme}://season/voyage.mcap"
    expected = st.read(voyage)
    assert st.read(place).equals(expected)
    described, local = st.info(place).as_dict(), st.info(voyage).as_dict()
    assert described["channels"] == local["channels"]
    st.export(place, f"{scheme}://tables/voyage.parquet")
    st.export(voyage, tmp_path / "voyage.parquet")
    files = fsspec.filesystem(scheme)
    assert [Path(name).name for name in files.find("tables")] == [path.name for path in tmp_path.iterdir()]
    assert files.cat_file("tables/voyage.parquet") == (tmp_path / "voyage.parquet").read_bytes()


def test_what_is_not_there_is_one_line(scheme: str) -> None:
    with pytest.raises(SeatrialError, match=f"{scheme}://season/none.mcap: does not exist"):
        st.info(f"{scheme}://season/none.mcap")


@pytest.mark.parametrize(
    ("scheme", "variable"),
    [("gs", "GOOGLE_APPLICATION_CREDENTIALS"), ("az", "AZURE_STORAGE"), ("abfss", "AZURE_STORAGE")],
)
def test_missing_credentials_are_those_of_the_store(
    scheme: str, variable: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not those of another kind."""

    class DefaultCredentialsError(Exception):
        pass

    def refuse(*_: object, **__: object) -> None:
        raise DefaultCredentialsError("none")

    monkeypatch.setitem(sys.modules, PACKAGES[scheme], ModuleType(PACKAGES[scheme]))
    monkeypatch.setattr(fsspec, "filesystem", refuse)
    with pytest.raises(SeatrialError, match=f"needs credentials for its store.*{variable}"):
        st.info(f"{scheme}://season/voyage.mcap")


@pytest.mark.parametrize("scheme", PACKAGES)
def test_missing_package_is_named(scheme: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, PACKAGES[scheme], None)
    with pytest.raises(SeatrialError, match=f"pip install '{PACKAGES[scheme]}'"):
        st.info(f"{scheme}://season/voyage.mcap")


def test_address_that_is_not_read_is_told_from_a_missing_file() -> None:
    with pytest.raises(SeatrialError, match=r"of addresses s3://.*abfs://.*are read"):
        st.info("ftp://host/voyage.mcap")
