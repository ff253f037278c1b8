"""Vessel files: finding them by name or path, merging them with their base, and listing their actuators.

``hybrid/vessel`` interprets the numbers in them; recording and importing need the actuators only.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from seatrial.acquisition.config.toml_file import parse_toml, read_text
from seatrial.acquisition.core.actuators import SHIPPED, VESSELS, Actuator, Actuators, check_actuators
from seatrial.acquisition.core.errors import ConfigurationError

Tree = dict[str, Any]
"""The tables of a vessel file."""


def vessel_names() -> list[str]:
    """The names of the vessels that come with Seatrial."""
    return sorted(SHIPPED)


def find_vessel(name_or_file: str | Path, folder: Path | None = None) -> Path:
    """The file of a vessel by its name in ``trials/vessels``, or by a path from ``folder`` (else from here).

    Raises :class:`ConfigurationError` for what is neither.
    """
    text = str(name_or_file)
    named = VESSELS / f"{text}.toml"
    if "/" not in text and named.is_file():
        return named
    path = (folder or Path.cwd()) / text
    if path.is_file():
        return path
    why = f"it is neither a file nor one of {', '.join(vessel_names())}"
    fix = "give one of these names, or the path of a vessel file"
    raise ConfigurationError(f"no vessel {text!r}", why=why, fix=fix)


def vessel_of_ship(ship: str, folder: Path) -> Path | None:
    """The vessel file of the ship named by a recording, a configuration or a column map in ``folder``.

    One that comes with Seatrial, else one in ``folder`` or the working directory: with that file name, or with
    ``name = "SHIP"``. None if there is none. Raises :class:`ConfigurationError` if several match.
    """
    ship = Path(ship).stem if ship.endswith(".toml") else ship
    for place in (VESSELS, folder, Path.cwd()) if ship else ():
        names_by_path = {path: _ship_names(path) for path in sorted(place.glob("*.toml"))}
        named = [path for path, names in names_by_path.items() if ship in names]
        matches = [path for path in named if path.stem == ship] or named
        if len(matches) > 1:
            what = f"{' and '.join(path.name for path in matches)} are both of the ship {ship!r}"
            raise ConfigurationError(what, where=str(place), fix="choose one with --vessel, or rename one")
        if matches:
            return matches[0]
    return None


def name_of_ship(vessel: str | Path) -> str:
    """The name of a vessel: her name in ``trials/vessels`` or the name in her file."""
    return str(vessel_tree(find_vessel(vessel))["name"])


def _ship_names(path: Path) -> tuple[str, ...]:
    """The names of a vessel file: the file's own, and the one in it; none for another TOML file."""
    try:
        tree = parse_toml(read_text(path), path)
    except ConfigurationError:
        return (path.stem,)  # errors in it are reported when it is loaded
    return (path.stem, str(tree.get("name", ""))) if tree.keys() & {"base", "dimensions"} else ()


def vessel_tree(path: Path) -> Tree:
    """The tables of a vessel file merged with its base, and that with its own base.

    A base is the name of a vessel that comes with Seatrial or a path, relative to the file that names it. A
    file without a name takes its own file name, not its base's. Raises :class:`ConfigurationError` for an
    unreadable file, a missing base, and circular bases.
    """
    return {"name": path.stem, **_with_base(path, seen=())}


def load_actuators(vessel: str | Path) -> Actuators:
    """The names and kinds of a vessel's actuators, by her name or from her file.

    Raises :class:`ConfigurationError` for anything but a vessel file, and for a list that cannot be one ship's.
    """
    path = find_vessel(vessel)
    listed = vessel_tree(path).get("actuator", [])
    try:
        return check_actuators(Actuator(str(entry["name"]), str(entry["kind"])) for entry in listed)
    except (TypeError, KeyError) as error:
        fix = "write an [[actuator]] with name and kind for each"
        raise ConfigurationError("has actuators without name or kind", where=str(path), fix=fix) from error
    except ConfigurationError as error:
        raise error.at(path) from error


def length_of_ship(ship: str, folder: Path) -> float | None:
    """The length between perpendiculars [m] of the ship named by a file in ``folder``; None without a vessel file.

    What the effects of a vessel file make of the length is not in it.
    """
    file = vessel_of_ship(ship, folder)
    length_m = {} if file is None else vessel_tree(file).get("dimensions", {})
    value = length_m.get("length_between_perpendiculars_m") if isinstance(length_m, dict) else None
    return float(value) if isinstance(value, int | float) else None


def actuators_of_ship(ship: str, folder: Path) -> Actuators:
    """The actuators of the ship named by a file in ``folder``, none if she has no vessel file."""
    file = vessel_of_ship(ship, folder)
    return () if file is None else load_actuators(file)


def _with_base(path: Path, seen: tuple[Path, ...]) -> Tree:
    tree = parse_toml(read_text(path), path)
    _check_names(tree, path)
    base = tree.get("base", "")
    if not base:
        return {key: value for key, value in tree.items() if key != "base"}
    if not isinstance(base, str):
        raise ConfigurationError("base is not a name", where=str(path), fix='write base = "NAME or FILE"')
    below = find_vessel(base, path.parent)
    seen = (*seen, path.resolve())
    if below.resolve() in seen:
        fix = "let it build on another vessel, or on none"
        raise ConfigurationError(f"base {base!r} leads back to a file that builds on it", where=str(path), fix=fix)
    return _merged({key: value for key, value in _with_base(below, seen).items() if key != "name"}, tree)


def _check_names(tree: Tree, path: Path) -> None:
    """Actuators are merged by name. Raises :class:`ConfigurationError` for a name that is no text."""
    listed = tree.get("actuator", [])
    names = (
        [entry.get("name", "") for entry in listed if isinstance(entry, dict)] if isinstance(listed, list) else []
    )
    if not all(isinstance(name, str) for name in names):
        fix = 'write name = "NAME" in each [[actuator]]'
        raise ConfigurationError("has an actuator whose name is no text", where=str(path), fix=fix)


def _merged(below: Tree, above: Tree) -> Tree:
    """``below`` overridden by ``above``: tables of the same ``model`` key by key, actuators by name."""
    result = dict(below)
    for key, value in above.items():
        under = result.get(key)
        if key == "actuator" and isinstance(under, list) and isinstance(value, list):
            result[key] = _merged_by_name(under, value)
        elif (
            isinstance(under, dict)
            and isinstance(value, dict)
            and value.get("model", under.get("model")) == under.get("model")
        ):
            result[key] = _merged(under, value)
        else:
            result[key] = value
    return result


def _merged_by_name(below: list[Any], above: list[Any]) -> list[Any]:
    merged = {entry.get("name"): entry for entry in below if isinstance(entry, dict)}
    for entry in above:
        name = entry.get("name") if isinstance(entry, dict) else None
        merged[name] = _merged(merged[name], entry) if name in merged else entry
    return list(merged.values())
