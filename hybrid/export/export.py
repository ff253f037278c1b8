"""A vessel's model written for other simulators, and how far each form is off."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from io import StringIO
from math import isinf
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from seatrial.acquisition.core import errors, result, trial
from seatrial.acquisition.core.files import atomic_file, require_suffix, write_text
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.effects import Catalogue, catalogue_of, vessel_plant
from seatrial.hybrid.export import fmu, matrices, matrix_files, symbolic
from seatrial.hybrid.export.deviations import Deviation, StandardRun, deviations, standard_runs, step_by_step
from seatrial.hybrid.export.equations import Equations, equations_of, flat_parameters
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.plant import Plant

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.text import Text

FORMS = {
    ".py": "Python module", ".casadi": "CasADi functions", ".fmu": "FMU for co-simulation",
    ".m": "matrices for MATLAB", ".mat": "matrices for MATLAB", ".sdf": "plugins of Gazebo",
    ".csv": "table of the numbers",
}  # fmt: skip
"""The forms by the suffixes of their files."""
_MODULE_WIDTH = 112
_TABLE_COLUMNS = ("name", "value", "unit", "group", "source", "low", "high")
_TWO_SIDED = 1.96  # standard deviations: 95 %


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ModelExport(result.Result):
    """A model as it was exported: its files, what is to be said of it, and how far runs by it are off.

    ``tracks`` has for each standard run its name, the simulator's states [K+1, 6] and those of the exported model.
    """

    vessel: str
    form: str
    files: tuple[Path, ...]
    remarks: tuple[str, ...]
    deviations: tuple[Deviation, ...] = ()
    tracks: tuple[tuple[str, Floats, Floats], ...] = field(default=())
    view: ClassVar[str] = "seatrial.hybrid.export.export:export_view"
    drawing: ClassVar[str] = "seatrial.hybrid.export.export:draw_export"

    def as_dict(self) -> dict[str, Any]:
        """For JSON, without the tracks."""
        names = ("run", "distance_m", "distance_lengths", "heading_deg")
        return {
            "vessel": self.vessel, "form": self.form, "files": [str(path) for path in self.files],
            "remarks": list(self.remarks),
            "deviations": [{name: getattr(off, name) for name in names} for off in self.deviations],
        }  # fmt: skip


def export_view(export: ModelExport) -> Text:
    """What the terminal shows of an export."""
    from rich.text import Text

    lines = [f"{', '.join(map(str, export.files))}: {export.form} of {export.vessel}", *export.remarks]
    return Text("\n".join(lines))


def draw_export(figure: Figure, export: ModelExport) -> None:
    """The tracks of the runs by the simulator and by the exported model."""
    for number, (name, simulated, exported) in enumerate(export.tracks, 1):
        axes = figure.add_subplot(1, len(export.tracks), number)
        for states, label, style in ((simulated, "simulator", "-"), (exported, "exported model", "--")):
            axes.plot(states[:, 1], states[:, 0], style, label=label)
        axes.set(title=name, xlabel="east [m]", ylabel="north [m]", aspect="equal")
        axes.legend()


def export_model(
    vessel: Vessel, output: str | Path, fmi: int = 3, catalogue: Catalogue | None = None
) -> ModelExport:
    """Write the model of a vessel, with its effects, in the form that the suffix of ``output`` says.

    Raises :class:`ConfigurationError` for a model that cannot be exported and for a library that is not installed,
    :class:`InputError` for another suffix.
    """
    path, form = Path(output), require_suffix(output, *FORMS)
    if fmi not in (2, 3):
        raise errors.UsageError("is neither 2 nor 3", where="--fmi")
    model = ExportedModel(vessel, catalogue)
    files, said, tracks, off = _WRITERS[form](model, path, fmi)
    return ModelExport(vessel.name, FORMS[form], tuple(files), tuple(said), tuple(off), tuple(tracks))


class ExportedModel:
    """A vessel as it is exported: its plant with all effects, its equations, its standard runs."""

    def __init__(self, vessel: Vessel, catalogue: Catalogue | None = None) -> None:
        self.vessel = vessel
        self.plant: Plant = vessel_plant(vessel, catalogue)
        self.catalogue = catalogue_of(vessel) if catalogue is None else catalogue
        self.equations: Equations = equations_of(vessel, self.plant)
        self.runs: list[StandardRun] = standard_runs(vessel, self.plant)

    def remarks(self) -> list[str]:
        """What holds of every form: where it is from, and what no form has."""
        effects = dict(self.vessel.effects)
        recorded = [name for name in effects if name == "command_delay" or self.catalogue[name].kind == "sensor"]
        sentences = [f"Exported by {trial.software_version()} from the vessel {self.vessel.name}"
                     + (f", with {', '.join(effects)}." if effects else "."),
                     "Three degrees of freedom; waves, gusts and what sensors report are not in it, and outside "
                     "the speeds that the vessel file calls valid its forces mean nothing."]  # fmt: skip
        if recorded:
            sentences.append(f"Left out, since they concern what is recorded: {', '.join(recorded)}.")
        if self.plant.wind_direction_bias_rad or self.plant.wind_speed_factor != 1.0:
            sentences.append("The wind is that which the ship's own sensor reports, with its error.")
        if not self.runs:
            sentences.append("No standard run stays in the range of the model, so it could not be compared.")
        return sentences

    def measured(
        self, track: Callable[[StandardRun], Floats]
    ) -> tuple[list[tuple[str, Floats, Floats]], list[Deviation], list[str]]:
        """The tracks of the standard runs, how far the exported model is off, and that in words."""
        exported = [track(run) for run in self.runs]
        tracks = [(run.name, run.states, states) for run, states in zip(self.runs, exported, strict=True)]
        off = deviations(self.runs, exported)
        words = [f"Against the simulator, {deviation}." for deviation in off]
        return tracks, off, words


Written = tuple[list[Path], list[str], list[tuple[str, Floats, Floats]], list[Deviation]]
"""The files, what is to be said of them, the tracks and how far they are off."""


def _write_module(model: ExportedModel, path: Path, _: int) -> Written:
    space: dict[str, Any] = {}
    exec(compile(_module_text(model.vessel, model.equations, model.remarks()), "exported.py", "exec"), space)

    def track(run: StandardRun) -> Floats:
        def after(state: Floats, orders: Floats) -> Floats:
            return np.asarray(space["step"](state, orders, np.zeros(2), run.dt_s))

        return step_by_step(run, len(model.equations.extra_states), after)

    tracks, off, words = model.measured(track)
    remarks = [*model.remarks(), _IN_STEP, *words]
    return [write_text(path, _module_text(model.vessel, model.equations, remarks))], remarks, tracks, off


def _module_text(vessel: Vessel, equations: Equations, remarks: Sequence[str]) -> str:
    """The source of the module."""
    states = {"acting": "the controls that act", "behind": "the controls behind their gears' play"}
    drives = ["the drives' feedback", *(states[name] for name in equations.extra_states)]
    head = _MODULE_HEAD.format(
        title=_safe_in_docstring(f"{vessel.name}: {vessel.description or 'a ship in three degrees of freedom'}."),
        remarks="\n\n".join(_safe_in_docstring(fill(remark, _MODULE_WIDTH)) for remark in remarks),
        controls=", ".join(equations.controls), drives=", then ".join(drives),
        rpm=", those of tunnel thrusters per minute" if any("_rpm" in name for name in equations.controls) else "",
    )  # fmt: skip
    names = f"CONTROLS = ({', '.join(_quoted(name) for name in equations.controls)},)"
    numbers = f"PARAMETERS = {_dict_source(equations.parameters, '')}"
    return "\n\n".join([head, f"{symbolic.array_functions()}\n", f"{names}\n\n{numbers}\n", equations.text]) + "\n"


def _safe_in_docstring(text: str) -> str:
    """A text that ends no docstring and begins no escape."""
    return text.replace("\\", "/").replace('"""', "'''")


def _quoted(text: str) -> str:
    return f'"{text}"'


def _dict_source(values: dict[str, Any], indent: str) -> str:
    inner = f"{indent}    "
    entries = [f"{inner}{_quoted(name)}: {_value_source(value, inner)}," for name, value in values.items()]
    return "\n".join(["{", *entries, f"{indent}}}"])


def _value_source(value: Any, indent: str) -> str:
    if isinstance(value, dict):
        return _dict_source(value, indent)
    if isinstance(value, tuple):
        return f"xp.array([{', '.join(_value_source(part, indent) for part in value)}])"
    return ("-xp.inf" if value < 0.0 else "xp.inf") if isinf(value) else repr(float(value))


_MODULE_HEAD = '''"""{title}

{remarks}

``derivative`` is the rate of change of the six states while the controls that act hold, ``runge_kutta`` a step of
it, ``step`` one of the ship with its drives, which follow orders. The last axis of an array has the states, the
controls or the wind; other axes are of a batch. Angles are in radians, shafts turn in revolutions per
second{rpm}.

    state     north [m], east [m], heading [rad], surge, sway over ground [m/s], yaw rate [rad/s]
    controls  {controls}
    wind      where it comes from [rad], its speed [m/s]

For ``step`` the state goes on with {drives}, a number for each control.
A number of ``PARAMETERS`` may be changed, or an own table handed over as ``p``. For gradients and compilation put
jax.numpy in numpy's place below.
"""

import numpy as xp
'''

_IN_STEP = (
    "The drives' lags, rates and limits, and lags and play of gears, are states of `step`; `derivative` has none "
    "of them: its controls act."
)


def _write_casadi(model: ExportedModel, path: Path, _: int) -> Written:
    ship = symbolic.SymbolicShip(model.equations)
    step_path = path.with_name(f"{path.stem}_step{path.suffix}")
    derivative, step = ship.derivative(), ship.step()

    def track(run: StandardRun) -> Floats:
        def after(state: Floats, orders: Floats) -> Floats:
            moved = step(state=state, orders=orders, wind=np.zeros(2), dt=run.dt_s)
            return np.asarray(moved["next_state"])

        return step_by_step(run, len(model.equations.extra_states), after)

    tracks, off, words = model.measured(track)
    remarks = [*model.remarks(), _CASADI.format(step=step_path.name), _IN_STEP, *words]
    for function, file in ((derivative, path), (step, step_path)):
        with atomic_file(file) as temporary:
            function.save(str(temporary))
    controls = f"controls: {', '.join(model.equations.controls)}"
    inputs = "\n".join([controls, *(f"{name} = {value!r}" for name, value in ship.values.items())])
    notes = write_text(path.with_name(f"{path.name}.txt"), "\n\n".join([*remarks, inputs]) + "\n")
    return [path, step_path, notes], remarks, tracks, off


_CASADI = (
    "casadi.Function.load gives `derivative` and, from {step}, `step`. Their inputs are arrays in SI and then "
    "every number of the ship by its name, which may be left out."
)


def _write_fmu(model: ExportedModel, path: Path, fmi: int) -> Written:
    built = fmu.build_fmu(model.vessel, model.equations, fmi)
    remarks = [*model.remarks(), _FMU]
    built.write(path, remarks)
    try:
        fmu.load_fmpy()
    except errors.ConfigurationError:
        return [path], [*remarks, built.said, "FMPy is not installed, so it was not run."], [], []
    if not built.has_library:
        return [path], [*remarks, built.said], [], []
    tracks, off, words = model.measured(partial(fmu.track_of_fmu, path, model.vessel.actuators))
    built.write(path, [*remarks, *words])
    return [path], [*remarks, built.said, *words], tracks, off


_FMU = (
    "Inputs are the orders to the drives and the wind; they hold during a step. The drives' lags, rates and limits "
    "are states and begin at the first orders. Steps are divided into ones of internal_step_s at most (0.1 s)."
)


def _write_matrices(model: ExportedModel, path: Path, _: int) -> Written:
    matrix = matrices.matrix_model(model.vessel, model.plant)
    tracks, off, words = model.measured(partial(matrices.track_of_matrices, model.vessel, matrix))
    remarks = [*model.remarks(), _MATRICES, *_fit_in_words(matrix.fit), *words]
    if path.suffix.lower() == ".mat":
        matrix_files.write_mat(path, model.vessel, matrix, remarks)
    else:
        name = path.stem if path.stem.isidentifier() else "ship"
        matrix_files.write_m(path, name, matrix, remarks)
    return [path], remarks, tracks, off


def _write_gazebo(model: ExportedModel, path: Path, _: int) -> Written:
    matrix = matrices.matrix_model(
        model.vessel, model.plant, matrix_files.GAZEBO_TERMS, matrix_files.GAZEBO_STEERING
    )
    tracks, off, words = model.measured(partial(matrices.track_of_matrices, model.vessel, matrix))
    shares = ", ".join(f"{axis} {share:.2f}" for axis, share in matrix_files.added_mass_shares(matrix).items())
    unstable = _ADDED_MASS.format(shares=shares)
    remarks = [*model.remarks(), _GAZEBO, *matrix_files.command_remarks(model.vessel, matrix),
               *_fit_in_words(matrix.fit), unstable, *words]  # fmt: skip
    matrix_files.write_sdf(path, model.vessel, model.plant, matrix, remarks)
    return [path], remarks, tracks, off


def _write_table(model: ExportedModel, path: Path, _: int) -> Written:
    """The numbers of the model: name, value, unit, where it is from, and its interval; remarks as comments before.

    An interval of 95 % is there for a number whose standard deviation the vessel file has in ``[estimated]``.
    """
    text, remarks, vessel, hull = StringIO(), model.remarks(), model.vessel, set(model.plant.hull_model.numbers)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_TABLE_COLUMNS)
    kinds = {actuator.name: actuator.kind for actuator in vessel.actuators}
    for name, value in flat_parameters(model.equations).items():
        group = _group_of(name, vessel, hull)
        keys = f"{group}.{name.removeprefix(f'{group}_')}", f"{group}.{name}"  # both may be in [estimated]
        share = next((vessel.estimated[key] for key in keys if key in vessel.estimated), None)
        spread = None if share is None else _TWO_SIDED * share * abs(value)
        interval = ("", "") if spread is None else (repr(value - spread), repr(value + spread))
        kind = kinds.get(group, group)  # the vessel file says where a part is from by its name or that of its kind
        parts = (group, kind, f"{kind}s", f"{group}s", *(("thrusters",) if group in kinds else ()))
        source = next((vessel.provenance[part] for part in parts if part in vessel.provenance), "")
        writer.writerow([name, repr(value), fmu.unit_of_number(name, vessel.actuators), group, source, *interval])
    comments = "".join(f"# {remark}\n" for remark in remarks)
    return [write_text(path, comments + text.getvalue())], remarks, [], []


def _group_of(name: str, vessel: Vessel, hull: set[str]) -> str:
    """The part of the ship that a number is of: its hull, an actuator, the wind, else the ship."""
    if name in hull:
        return "hull"
    actuators = [actuator.name for actuator in vessel.actuators if name.startswith(f"{actuator.name}_")]
    if actuators:
        return max(actuators, key=len)
    wind = ("CX_", "CY_", "CN_", "wind_", "air_", "frontal_", "lateral_")
    inertia = ("mass_kg", "yaw_inertia", "Xud", "Yvd", "Yrd", "Nrd", "centre_of")
    return "wind" if name.startswith(wind) else "inertia" if name.startswith(inertia) else "ship"


def _fit_in_words(fit: tuple[float, float, float]) -> list[str]:
    shares = ", ".join(f"{axis} {share:.1%}" for axis, share in zip("XYN", fit, strict=True))
    return [f"The terms leave of the force that they are fitted to, root mean square: {shares}."]


_MATRICES = (
    "A matrix form has no wind, no current, no drives (they are to be put before it, as for the comparison), "
    "and no force that is not a term of u, v, r, of the shaft and of the helm: no four quadrants of a propeller, "
    "no side force of one astern."
)
_GAZEBO = (
    "Axes are Gazebo's: x ahead, y to port, z up. The plugins have terms of second order in the speeds, thrust by "
    "the shaft alone (as at the service speed ahead) and a rudder in the flow of the ship's own speed; no race, no "
    "side force of pods, no wind, no drives (the comparison had them). Gazebo warns of terms without abs; Coriolis "
    "forces are among them, so that the plugin's own are disabled. Compared by the plugins' equations, not run in "
    "Gazebo; heave, roll and pitch are not in it, inertias in roll and pitch are placeholders. Thrusters are "
    "commanded by newtons, not by shaft speeds: by these (use_angvel_cmd) the plugin has one coefficient for ahead "
    "and astern, and clamps rad/s by limits in newtons; thrust_coefficient, that of ahead, only spins the blades."
)
_ADDED_MASS = (
    "The plugin applies the added mass as a force of the last step's acceleration, which swings up where it "
    "exceeds the ship's own mass (here {shares} of it): near or above 1, set disable_added_mass and give the same "
    "numbers, positive, as fluid_added_mass of the link's inertial."
)

_WRITERS: Mapping[str, Callable[[ExportedModel, Path, int], Written]] = {
    ".py": _write_module, ".casadi": _write_casadi, ".fmu": _write_fmu, ".m": _write_matrices,
    ".mat": _write_matrices, ".sdf": _write_gazebo, ".csv": _write_table,
}  # fmt: skip
