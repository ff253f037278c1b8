"""Vessel files: found by name or path, put together with their base, and the list of actuators in them.

What the numbers in them mean is in ``hybrid/vessel``; who records or imports asks for the actuators only.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from acquisition.config.toml_file import parse_toml, read_text
from acquisition.core.actuators import VESSELS, Actuator, Actuators, check_actuators
from acquisition.core.errors import ConfigurationError

Tree = dict[str, Any]
"""The tables of a vessel file."""


def vessel_names() -> list[str]:
    """The names of the vessels that come with Seatrial."""
    return sorted(path.stem for path in VESSELS.glob("*.toml"))


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
    raise ConfigurationError(
        f"no vessel {text!r}",
        why=f"it is neither a file nor one of {', '.join(vessel_names())}",
        fix="give one of these names, or the path of a vessel file",
    )


def vessel_of_ship(ship: str, folder: Path) -> Path | None:
    """The vessel file of the ship that a recording, a configuration or a column map in ``folder`` names.

    One of Seatrial's own, else one in ``folder`` or in the working directory: of that file name, or that says
    ``name = "SHIP"``. None where there is none. Raises :class:`ConfigurationError` where several say so.
    """
    ship = Path(ship).stem if ship.endswith(".toml") else ship
    for place in (VESSELS, folder, Path.cwd()) if ship else ():
        told = {path: _ships_told(path) for path in sorted(place.glob("*.toml"))}
        named = [path for path, names in told.items() if ship in names]
        found = [path for path in named if path.stem == ship] or named
        if len(found) > 1:
            raise ConfigurationError(
                f"{' and '.join(path.name for path in found)} are both of the ship {ship!r}", where=str(place),
                fix="give the one that is meant with --vessel, or each a name of its own",
            )  # fmt: skip
        if found:
            return found[0]
    return None


def name_of_ship(vessel: str | Path) -> str:
    """What a vessel is called, by her name in ``trials/vessels`` or from her file."""
    return str(vessel_tree(find_vessel(vessel))["name"])


def _ships_told(path: Path) -> tuple[str, ...]:
    """The names that a vessel file goes by: the file's own, and the one in it; none for another TOML file."""
    try:
        tree = parse_toml(read_text(path), path)
    except ConfigurationError:
        return (path.stem,)  # what is wrong with it is said when it is loaded
    return (path.stem, str(tree.get("name", ""))) if tree.keys() & {"base", "dimensions"} else ()


def vessel_tree(path: Path) -> Tree:
    """The tables of a vessel file with everything its base, and the base of that, states and it does not.

    A base is the name of one of Seatrial's own or a path, from the folder of the file that names it. A file that
    gives no name is called as it is itself, not as its base. Raises :class:`ConfigurationError` for what cannot be
    read, a base that is not there, and bases in a circle.
    """
    return {"name": path.stem, **_with_base(path, seen=())}


def load_actuators(vessel: str | Path) -> Actuators:
    """The names and kinds of the actuators of a vessel, by its name or from its file.

    Raises :class:`ConfigurationError` for what is no vessel file and for a list that cannot be one ship's.
    """
    path = find_vessel(vessel)
    listed = vessel_tree(path).get("actuator", [])
    try:
        return check_actuators(Actuator(str(each["name"]), str(each["kind"])) for each in listed)
    except (TypeError, KeyError) as error:
        fix = "write an [[actuator]] with name and kind for each"
        raise ConfigurationError("has actuators without name or kind", where=str(path), fix=fix) from error
    except ConfigurationError as error:
        raise error.at(path) from error


def actuators_of_ship(ship: str, folder: Path) -> Actuators:
    """The actuators of the ship that a file in ``folder`` names, none where there is no vessel file of her."""
    file = vessel_of_ship(ship, folder)
    return () if file is None else load_actuators(file)


def _with_base(path: Path, seen: tuple[Path, ...]) -> Tree:
    tree = parse_toml(read_text(path), path)
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


def _merged(below: Tree, above: Tree) -> Tree:
    """``below`` with what ``above`` says; another ``model`` takes the place of a table, actuators meet by name."""
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
    merged = {each.get("name"): each for each in below if isinstance(each, dict)}
    for each in above:
        name = each.get("name") if isinstance(each, dict) else None
        merged[name] = _merged(merged[name], each) if name in merged else each
    return list(merged.values())
