"""The pins of constraints.txt: all that is asked for, in versions that admit every Python that is promised."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LINES = [
    line
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").replace("\\\n", "").splitlines()
    if line and not line.startswith("#")
]
PINS = [Requirement(line.partition("--hash")[0]) for line in LINES]
MINORS = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["project"]["classifiers"]))
PYTHONS = [f"{minor}.{patch}" for minor in MINORS for patch in range(10)]
CUDA = set(PROJECT["tool"]["uv"]["exclude-dependencies"])  # asked for by builds of PyTorch that the pins do without

every_python = pytest.mark.parametrize("python", PYTHONS)


def applies(requirement: Requirement, python: str) -> bool:
    """Whether a requirement without extras counts under a Python on a system such as this one."""
    told = {"python_full_version": python, "python_version": python.rpartition(".")[0], "extra": ""}
    return requirement.marker is None or requirement.marker.evaluate(told)


@cache
def pinned(python: str) -> dict[str, str]:
    """The version of each package under a Python."""
    pins = [(canonicalize_name(pin.name), str(pin.specifier)) for pin in PINS if applies(pin, python)]
    assert len(pins) == len(dict(pins)), "a package is pinned twice"
    assert all(specifier.startswith("==") for _, specifier in pins)
    return {name: specifier.removeprefix("==") for name, specifier in pins}


@cache
def installed(name: str, version: str) -> Distribution | None:
    """The package in this environment, whose metadata can be read, if it has the very version."""
    try:
        found = distribution(name)
    except PackageNotFoundError:
        return None
    return found if Version(found.version).public == version else None


@cache
def requirements(package: Distribution) -> list[Requirement]:
    return [Requirement(line) for line in package.requires or ()]


@cache
def pythons_of(package: Distribution) -> SpecifierSet:
    return SpecifierSet(package.metadata.get("Requires-Python") or "")


def installed_of(python: str) -> list[Distribution]:
    """Those of the packages pinned for a Python that are in this environment."""
    return [package for name, version in pinned(python).items() if (package := installed(name, version))]


def unmet(asked: list[Requirement], python: str) -> list[str]:
    """The requirements that no pin meets."""
    versions = pinned(python)
    counted = [(each, canonicalize_name(each.name)) for each in asked if applies(each, python)]
    return [
        str(each)
        for each, name in counted
        if name not in CUDA and not (name in versions and each.specifier.contains(versions[name], prereleases=True))
    ]


def test_the_tested_pythons_begin_with_the_lowest_promised() -> None:
    assert PROJECT["project"]["requires-python"] == f">={MINORS[0]}"


@pytest.mark.parametrize("line", LINES, ids=lambda line: str(line).partition(" ")[0])
def test_every_pin_has_the_hashes_of_its_files(line: str) -> None:
    pin, *hashes = line.split("--hash=")
    assert "--" not in pin
    assert hashes
    assert [each for each in hashes if not re.fullmatch(r"sha256:[0-9a-f]{64}\s*", each)] == []


def test_install_takes_nothing_without_a_hash_but_pytorch_and_this_package() -> None:
    """PyTorch's CPU build has other hashes, and PyTorch's own index; the CUDA libraries are pinned by PyTorch."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = makefile.partition("\n$(STAMP):")[2].partition("\n\n")[0].splitlines()
    installs = [line for line in recipe if "$(PIP" in line and " install " in line]
    assert any("--require-hashes --requirement constraints.txt" in line for line in installs)
    allowed = ("--require-hashes", "$(TORCH)", "--no-deps --no-build-isolation --editable .")
    assert [line for line in installs if not any(part in line for part in allowed)] == []


def test_build_backend_is_pinned_as_it_is_asked_for() -> None:
    assert unmet([Requirement(each) for each in PROJECT["build-system"]["requires"]], PYTHONS[0]) == []


@every_python
def test_every_dependency_is_pinned_within_its_range(python: str) -> None:
    project = PROJECT["project"]
    asked = map(Requirement, chain(project["dependencies"], *project["optional-dependencies"].values()))
    assert unmet([each for each in asked if each.name != project["name"]], python) == []


@every_python
def test_what_pinned_packages_ask_for_is_pinned_too(python: str) -> None:
    assert [lacking for package in installed_of(python) for lacking in unmet(requirements(package), python)] == []


@every_python
def test_every_pin_admits_the_python(python: str) -> None:
    """As far as this environment can tell: it has no metadata of a package that only another Python is given."""
    assert [package.name for package in installed_of(python) if python not in pythons_of(package)] == []
