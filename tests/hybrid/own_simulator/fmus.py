"""FMUs of the ship of other_make.c, compiled where there is a compiler, and the maps of its variables."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

HERE = Path(__file__).parent
NAMES = ("x", "y", "yaw", "u", "v", "r", "n", "delta", "wind_from", "wind", "x0", "y0", "yaw0", "u0", "v0", "r0")
UNITS = {"x": "m", "y": "m", "yaw": "deg", "u": "kn", "v": "kn", "r": "deg/s", "n": "rps", "delta": "deg",
         "wind_from": "deg", "wind": "kn"}  # fmt: skip
MODES = {"": 0.0, "raises": 1.0, "hangs": 2.0, "dies": 3.0}

SHIP = """\
[ship]
name = "Sailer"
length_m = 30.0
draught_m = 2.0

[[actuator]]
name = "propeller"
kind = "propeller"
limit_rpm = 300.0

[[actuator]]
name = "rudder"
kind = "rudder"
limit_deg = 35.0

"""
MAP = """\
[state]
north = { variable = "y", unit = "m", start = "y0" }
east = { variable = "x", unit = "m", start = "x0" }
heading = { variable = "yaw", unit = "deg", zero = "east", positive = "port", start = "yaw0" }
surge = { variable = "u", unit = "kn", start = "u0" }
sway = { variable = "v", unit = "kn", positive = "port", start = "v0" }
yaw_rate = { variable = "r", unit = "deg/s", positive = "port", start = "r0" }

[control]
propeller_rpm = { variable = "n", unit = "rps" }
rudder_angle_deg = { variable = "delta", unit = "deg", positive = "port" }

[wind]
direction = { variable = "wind_from", unit = "deg", zero = "east", positive = "port" }
speed = { variable = "wind", unit = "kn" }
"""


FORMS = {
    "start in SI": ["-DSTART_SI"], "no reset": ["-DNO_RESET"], "settable": ["-DSETTABLE"],
    "fixed step": ["-DFIXED_S=0.1"], "tunable controls": [],
}  # fmt: skip
"""Other forms of the FMU, and what each is compiled with."""
IN_SI = {"yaw0": "rad", "u0": "m/s", "v0": "m/s", "r0": "rad/s"}


def variables(version: int, *, units: bool = True, form: str = "") -> str:
    """The variables of the model description, by the standard of a version."""
    kind = "Real" if version == 2 else "Float64"
    lines = []
    for number, name in enumerate((*NAMES, "mode")):
        causality = "output" if number < 6 else "input" if number < 10 else "parameter"
        variability = "fixed" if causality == "parameter" else "continuous"
        if form == "settable" and name.endswith("0"):
            variability = "tunable"
        if form == "tunable controls" and name in ("n", "delta"):
            causality, variability = "parameter", "tunable"
        stated = UNITS.get(name.removesuffix("0"), "") if units else ""
        if stated and form == "start in SI":
            stated = IN_SI.get(name, stated)
        unit = f' unit="{stated}"' if stated else ""
        start = "" if causality == "output" else ' start="0"'
        initial = ' initial="calculated"' if causality == "output" else ""
        common = f'name="{name}" valueReference="{number}" causality="{causality}" variability="{variability}"'
        if version == 2:
            lines.append(f"<ScalarVariable {common}{initial}><{kind}{unit}{start}/></ScalarVariable>")
        else:
            lines.append(f"<{kind} {common}{initial}{unit}{start}/>")
    return "\n".join(lines)


def description(version: int, *, units: bool = True, form: str = "") -> str:
    """The model description of the FMU."""
    token = 'guid="{sailer}"' if version == 2 else 'instantiationToken="{sailer}"'
    names = dict.fromkeys([*UNITS.values(), *IN_SI.values()])
    defined = "".join(f'<Unit name="{unit}"/>' for unit in names) if units else ""
    experiment = '<DefaultExperiment stepSize="0.1"/>' if form == "fixed step" else ""
    step = ' canHandleVariableCommunicationStepSize="true"'
    if form == "fixed step":
        step = ' fixedInternalStepSize="0.1"' if version == 3 else ""
    outputs = "".join(f'<Unknown index="{number}"/>' for number in range(1, 7)) if version == 2 else "".join(
        f'<Output valueReference="{number}"/>' for number in range(6))  # fmt: skip
    structure = f"<Outputs>{outputs}</Outputs>" if version == 2 else outputs
    return (
        f'<?xml version="1.0"?><fmiModelDescription fmiVersion="{version}.0" modelName="Sailer" {token}>'
        f'<CoSimulation modelIdentifier="sailer"{step}/>'
        f"{f'<UnitDefinitions>{defined}</UnitDefinitions>' if units else ''}"
        f"{experiment}<ModelVariables>{variables(version, units=units, form=form)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


@cache
def library(version: int, form: str) -> bytes:
    """The compiled model of an FMU; the test is skipped where there is no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler here, with which the FMU of this test is made")
    options = ["-O2", "-ffp-contract=off", "-shared", "-fPIC", f"-DFMI={version}", *FORMS.get(form, [])]
    with TemporaryDirectory() as folder:
        compiled = Path(folder) / "sailer.so"
        subprocess.run([compiler, *options, "-o", compiled, HERE / "other_make.c", "-lm"], check=True)
        return compiled.read_bytes()


def build_fmu(
    folder: Path, version: int, *, name: str = "sailer", mode: str = "", units: bool = True, form: str = ""
) -> Path:
    """An FMU and its map in a folder."""
    pytest.importorskip("fmpy", reason="FMPy, which runs FMUs, is not installed")
    file = folder / f"{name}.fmu"
    place = "binaries/linux64/sailer.so" if version == 2 else "binaries/x86_64-linux/sailer.so"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", description(version, units=units, form=form))
        archive.writestr(place, library(version, form))
    constants = f"\n[parameters]\nmode = {MODES[mode]}\n\n[solver]\npatience_s = 1.0\n" if mode else ""
    file.with_suffix(".toml").write_text(SHIP + MAP + constants)
    return file


def without_variables(text: str) -> str:
    """A map as a Python class has it, whose signals have no names."""
    import re

    return re.sub(r', start = "\w+"', "", re.sub(r'variable = "\w+", ', "", text))
