"""The map of an FMU, proposed from the names, units and descriptions of its variables.

What exactly one variable can be is proposed and the reason given; what several or none can be, and conventions that
no unit tells, are asked. Answers are ``KEY=VALUE``, and nothing is guessed without a word.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.errors import ConfigurationError, InputError, UsageError
from seatrial.acquisition.core.quantities import unit_scale
from seatrial.hybrid.vessel import fmu, simulator_map
from seatrial.hybrid.vessel.actuators import KINDS
from seatrial.hybrid.vessel.fmu_runs import read_description
from seatrial.hybrid.vessel.signals import STATES

_WORDS = {
    "north": {"north", "northing"}, "east": {"east", "easting"}, "latitude": {"latitude", "lat"},
    "longitude": {"longitude", "lon", "long"}, "heading": {"heading", "yaw", "psi", "hdg"},
    "surge": {"surge", "u", "forward", "longitudinal", "ahead"}, "sway": {"sway", "v", "lateral", "transverse"},
    "yaw_rate": {"r", "rot", "yawrate", "turn"},
}  # fmt: skip
"""The words by which a state is recognised, in its name or description."""
_MEANINGS = {
    "north": "position to north", "east": "position to east", "latitude": "latitude", "longitude": "longitude",
    "heading": "heading", "surge": "speed along the bow, not to north or along the course",
    "sway": "speed across the bow, not to east", "yaw_rate": "rate at which the heading turns",
}  # fmt: skip
_NOT = {"heading": {"rate", "rot", "moment", "torque"}, "north": {"wind"}, "east": {"wind"}}
_START = re.compile(r"(?:start[_.](?P<after>.+)|(?P<before>.+?)[_.]?(?:0|start|init|initial))$", re.IGNORECASE)
_CHANNEL = re.compile(r"(.+?)(?:_order)?_(?:rpm|angle_deg|pitch_percent)$")
"""The name of a control channel, or of the order to one: the actuator before its ending."""
_SIDE = re.compile(r"positive turns the (?:ship|thrust|jet's thrust) to (starboard|port)")
_WIND_SAYS = {
    "convention": {"comes from": "from", "blows to": "to"}, "zero": {"from true north": "north"},
    "positive": {r"(?<!counter)(?<!counter-)\bclockwise": "starboard"}, "frame": {"from true north": "true"},
}  # fmt: skip
"""What the description of a wind direction may say of it."""
_STATE_SAYS = {
    "zero": {r"from (?:true )?north": "north", r"from east": "east"},
    "positive": {
        r"(?:positive|to) (?:to )?(?:starboard|clockwise)|(?<!counter)(?<!counter-)(?<!anti)(?<!anti-)\bclockwise":
            "starboard",
        r"(?:positive|to) (?:to )?port|(?:counter|anti)-?clockwise": "port",
    },
}  # fmt: skip
"""What the description of a heading, sway or yaw rate may say of its zero and its positive side."""
_DRIVES = "with_drives"
"""The switch of FMUs that `vessel export` makes: whether controls are orders, which drives follow."""
_KINDS = {"rudder": {"rudder", "helm", "delta"}, "propeller": {"propeller", "prop", "shaft", "engine", "n", "rpm"}}
_SHAFT = {"limit": ("limit_rpm", "rpm"), "lag_s": ("shaft_lag_s", "s")}
_DRIVE_FIELDS = {"rps": _SHAFT, "rpm": _SHAFT, "pitch": {"lag_s": ("pitch_lag_s", "s")}}
"""By control other than an angle: what of a drive's numbers a map calls how, and its unit."""
_LARGE = 1e29  # what an FMU has for no limit
_PORT = {"positive": "port"}
AXES: Mapping[str, Mapping[str, Mapping[str, str]]] = {
    "ned": {},
    "enu": {"heading": {"zero": "east", **_PORT}, "sway": _PORT, "yaw_rate": _PORT},
}
"""Two usual sets of conventions, and what of them is not ours."""


@dataclass(frozen=True, slots=True)
class MapQuestion:
    """What a person has to say: the key of the answer, and the question with its choices."""

    key: str
    text: str

    def __str__(self) -> str:
        return f"{self.key}: {self.text}"


@dataclass(slots=True)
class MapProposal:
    """A proposed map: its ``text``, the ``reasons``, and the questions left open."""

    file: Path
    text: str = ""
    reasons: list[str] = field(default_factory=list)
    questions: list[MapQuestion] = field(default_factory=list)

    def __str__(self) -> str:
        lines = [
            *(f"proposed: {reason}" for reason in self.reasons),
            *(f"unclear: {text}" for text in self.questions),
        ]
        return "\n".join([*lines, "", self.text] if not self.questions else lines)


def propose_map(file: Path, answers: Mapping[str, str] | None = None) -> MapProposal:
    """The proposed map of an FMU. Raises :class:`InputError` for what is none, :class:`UsageError` for an answer to
    no question."""
    draft = _Draft(file, read_description(file), dict(answers or {}))
    tables = [
        draft.ship_table(),
        draft.state_table(),
        draft.control_tables(),
        draft.wind_table(),
        draft.acceleration_table(),
        draft.solver_table(),
        draft.parameter_table(),
    ]
    if unused := sorted(draft.answers.keys() - draft.used):
        known = [question.key for question in draft.proposal.questions] + sorted(draft.used)
        raise UsageError(f"{unused[0]} answers no question", where="--answer",
                         fix=f"answer of {', '.join(known) or 'none'}")  # fmt: skip
    draft.proposal.text = "\n".join(table for table in tables if table)
    return draft.proposal


def words_of(text: str) -> set[str]:
    """The words of a name or description, small, without numbers.

    >>> sorted(words_of("shipState.yawRate_0"))
    ['rate', 'ship', 'state', 'yaw']
    """
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", text)}


class _Draft:
    """A proposal in the making."""

    def __init__(self, file: Path, description: Any, answers: dict[str, str]) -> None:
        self.answers, self.used = answers, set[str]()
        self.proposal, self._description = MapProposal(file), description
        self._co_simulation = description.coSimulation
        numbers = [variable for variable in description.modelVariables if variable.type in ("Real", "Float64")]
        self._by_name = {variable.name: variable for variable in numbers}
        self._outputs = [variable for variable in numbers if variable.causality == "output"]
        self._inputs = [variable for variable in numbers if variable.causality == "input"]
        self._parameters = [variable for variable in numbers if variable.causality == "parameter"]
        self._constants = [v for v in numbers if v.causality == "parameter" or v.variability == "constant"]
        self._accelerations = self._extra_accelerations()
        self._starts: dict[str, str] = {}
        self._states: dict[str, str] = {}

    def _ask(self, key: str, question: str) -> str:
        """The answer of a key; without one the question is asked and the text is empty."""
        if key in self.answers:
            self.used.add(key)
            return self.answers[key]
        self.proposal.questions.append(MapQuestion(key, question))
        return ""

    def _answered(self, key: str) -> str:
        """The answer of a key, empty without one."""
        if key in self.answers:
            self.used.add(key)
        return self.answers.get(key, "")

    def _variable(self, key: str, name: str) -> Any:
        """The variable that an answer names. Raises :class:`InputError` for none."""
        if name not in self._by_name:
            raise InputError(
                f"has no number {name!r}", where=str(self.proposal.file), why=f"it is the answer to {key}",
                fix=f"name one of {', '.join(list(self._by_name)[:12])}",
            )  # fmt: skip
        return self._by_name[name]

    def ship_table(self) -> str:
        """Name and length."""
        name = self._answered("ship.name") or str(self._description.modelName or "")
        if not name:
            name = self.proposal.file.stem
            self.proposal.reasons.append(f"ship.name is {name}, after the file, as the FMU states none")
        elif "ship.name" not in self.answers:
            self.proposal.reasons.append(f"ship.name is {name}, the model's name in the FMU")
        words = {
            v.name: words_of(v.name) for v in self._constants if v.start and _is_unit_like(fmu.unit_of(v), "m")
        }
        between = [key for key, of in words.items() if "lpp" in of or {"length", "perpendiculars"} <= of]
        overall = [key for key, of in words.items() if "loa" in of or {"length", "overall"} <= of]
        others = [key for key, of in words.items() if "length" in of and key not in between + overall]
        length_m = self._length("length_m", between or others)
        length_m = length_m or self._ask("ship.length_m", "the ship's length between perpendiculars in m")
        overall_m = self._length("length_overall_m", overall)
        lines = [f"[ship]\nname = {json.dumps(name)}\nlength_m = {length_m}"]
        return "\n".join([*lines, *([f"length_overall_m = {overall_m}"] if overall_m else []), ""])

    def _length(self, key: str, names: list[str]) -> str:
        """A length that is answered, or the one that the FMU states."""
        length_m = self._answered(f"ship.{key}")
        if not length_m and len(names) == 1:
            length_m = str(float(self._by_name[names[0]].start))
            self.proposal.reasons.append(f"ship.{key} = {length_m}, as the FMU starts {names[0]} with it")
        return length_m

    def state_table(self) -> str:
        """The six states."""
        names = list(STATES)
        if not self._candidates("north") and self._candidates("latitude"):
            names = [*simulator_map.GEODETIC, *names[2:]]
        axes = self._stated_axes() or self._ask(
            "axes",
            "ned (heading from north, it, sway and yaw rate positive to starboard) or enu (from east, to port)",
        )
        if axes and axes not in AXES:
            raise UsageError(f"axes is {axes!r}", where="--answer", fix=f"write one of {', '.join(AXES)}")
        lines = []
        for name in names:
            variable = self._state_variable(name)
            if variable is None:
                continue
            self._states[name] = variable.name
            unit = self._unit(f"state.{name}", variable, {**STATES, **simulator_map.GEODETIC}[name])
            parts = [*_signal_lines(variable, unit), *self._convention_lines(variable, name, axes)]
            start = self._start_of(variable, name)
            self._starts[name] = start
            if start and start != variable.name:
                parts.append(f"start = {json.dumps(start)}")
                start_unit = fmu.unit_of(self._by_name[start]) or unit
                parts.append(f'start_unit = "{start_unit}"' if start_unit != unit else "")
            lines.append(f"{name} = {{ {', '.join(filter(None, parts))} }}")
        origin = ""
        if names[0] == "latitude":
            keys = ("origin.latitude_deg", "origin.longitude_deg")
            values = [self._ask(key, "that of the recordings' north and east, in deg") for key in keys]
            origin = f"\n[origin]\nlatitude_deg = {values[0]}\nlongitude_deg = {values[1]}\n"
        return "[state]\n" + "\n".join(lines) + "\n" + origin

    def _convention_lines(self, variable: Any, name: str, axes: str) -> list[str]:
        """Where a state is zero and which side is positive: as answered, as its description says, by the axes."""
        of_axes, lines = AXES.get(axes, {}).get(name, {}), list[str]()
        keys = {"heading": ("zero", "positive"), "sway": ("positive",), "yaw_rate": ("positive",)}
        for key in keys.get(name, ()):
            usual = {"zero": "north", "positive": "starboard"}[key]
            expected, stated = of_axes.get(key, usual), _stated(variable, _STATE_SAYS[key])
            convention = self._answered(f"state.{name}.{key}") or stated or expected
            if axes and convention != expected:
                why = "as its description says" if convention == stated else "as answered"
                self.proposal.reasons.append(f"state.{name}.{key} is {convention}, {why}")
            if convention != usual:
                lines.append(f'{key} = "{convention}"')
        return lines

    def _stated_axes(self) -> str:
        if axes := self._answered("axes"):
            return axes
        text = " ".join(str(v.description or "") for v in self._outputs).upper() + str(
            self._description.description
        )
        stated = [axes for axes in AXES if re.search(rf"\b{axes.upper()}\b", text)]
        if len(stated) == 1:
            self.proposal.reasons.append(f"axes {stated[0]}, as descriptions say")
            return stated[0]
        return ""

    def _candidates(self, name: str) -> list[Any]:
        """The outputs that can be a state: of a unit that measures it, by its name, else by its description."""
        unit = {**STATES, **simulator_map.GEODETIC}[name]
        fitting = [v for v in self._outputs if _is_unit_like(fmu.unit_of(v), unit)]
        for text_of in (lambda v: v.name, lambda v: str(v.description or "")):
            matches = [v for v in fitting if self._is_called(words_of(text_of(v)), name)]
            if matches:
                return matches
        return []

    def _is_called(self, words: set[str], name: str) -> bool:
        is_rate = bool(words & {"rate", "dot"})
        if name == "yaw_rate" and is_rate and words & {"yaw", "psi", "heading", "turn"}:
            return True
        return (
            bool(words & _WORDS[name])
            and not (words & _NOT.get(name, set()))
            and not (is_rate and name == "heading")
        )

    def _state_variable(self, name: str) -> Any:
        key = f"state.{name}"
        if answer := self._answered(key):
            return self._variable(key, answer)
        candidates = self._candidates(name)
        if len(candidates) == 1:
            variable = candidates[0]
            self.proposal.reasons.append(f"{key} is the output {_label_of(variable)}")
            return variable
        unit = {**STATES, **simulator_map.GEODETIC}[name]
        choices = candidates or [output for output in self._outputs if _is_unit_like(fmu.unit_of(output), unit)]
        listed = "; ".join(_label_of(variable) for variable in choices[:10])
        listed = listed or f"there is none in {unit} or alike: export the FMU with one"
        self._ask(key, f"which output is the {_MEANINGS[name]}? {listed}")
        return None

    def _unit(self, key: str, variable: Any, like: str) -> str:
        unit = fmu.unit_of(variable) or self._answered(f"{key}.unit")
        share = f"; '300 {like}' where 1 is that much" if key.startswith("control.") else ""
        question = f"the unit of {variable.name}, as {like}, which the FMU does not state{share}"
        return unit or self._ask(f"{key}.unit", question)

    def _start_of(self, variable: Any, name: str) -> str:
        """What a state starts with: itself where that can be set, else the parameter called like it."""
        if answer := self._answered(f"state.{name}.start"):
            return str(self._variable(f"state.{name}.start", answer).name)
        if variable.initial in ("exact", "approx"):
            return str(variable.name)
        for parameter in self._parameters:
            match = _START.match(parameter.name)
            if match and (match["after"] or match["before"]).lower() == variable.name.lower():
                self.proposal.reasons.append(f"state.{name} starts with the parameter {parameter.name}")
                return str(parameter.name)
        return ""

    def control_tables(self) -> str:
        """The actuators, and the inputs that are their controls."""
        kinds = dict[str, str]()
        controls = dict[str, str]()
        for key in [key for key in self.answers if key.startswith("actuator.")]:
            kinds[key.removeprefix("actuator.")] = self._answered(key)
        are_named = bool(kinds)
        winds = {value for key, value in self.answers.items() if key.startswith("wind.")}
        if not are_named:
            controls = self._described_channels(kinds)
        for variable in self._inputs:
            words = words_of(variable.name) | words_of(str(variable.description or ""))
            if "wind" in words or variable.name in {*controls.values(), *self._accelerations.values()}:
                continue
            unit = fmu.unit_of(variable)
            recognised = [
                kind for kind, known in _KINDS.items()
                if words & known and _is_unit_like(unit, "deg" if kind == "rudder" else "rpm")
            ]  # fmt: skip
            if are_named or variable.name in winds or self._answered(f"input.{variable.name}") == "none":
                continue
            if len(recognised) == 1 and recognised[0] not in kinds.values():
                kinds[recognised[0]] = recognised[0]
                channel = ship.Actuator(recognised[0], recognised[0]).channels[0].name
                controls[channel] = variable.name
                self.proposal.reasons.append(f"control.{channel} is the input {_label_of(variable)}")
            else:
                self._ask(
                    f"input.{variable.name}",
                    f"{_label_of(variable)} is an input: name actuators with actuator.NAME=KIND and the input of "
                    "each of their channels with control.CHANNEL=INPUT, or wind.direction=INPUT and wind.speed="
                    "INPUT (or wind.north, wind.east), or say none: it stays at its start",
                )
        try:
            actuators = ship.check_actuators(ship.Actuator(name, kind) for name, kind in kinds.items())
        except ConfigurationError as error:
            self._ask(
                "actuator.NAME", f"{error.what}: name each with actuator.NAME=KIND of {', '.join(ship.KINDS)}"
            )
            return ""
        tables = "".join(
            "\n".join([f'[[actuator]]\nname = "{name}"\nkind = "{kind}"', *self._drive_lines(name, kind), "\n"])
            for name, kind in kinds.items()
        )
        return tables + "[control]\n" + "\n".join(self._control_lines(actuators, controls)) + "\n"

    def _drive_lines(self, name: str, kind: str) -> list[str]:
        """Place, limits and lags of an actuator's drives, where the FMU has them as `vessel export` calls them."""
        constants = {variable.name: variable for variable in self._constants if variable.start is not None}
        named = {f"{name}_{key}": (key, "m") for key in ("x_m", "y_m")}
        for label in KINDS[kind].labels:
            for number, (field_name, unit) in (_DRIVE_FIELDS.get(label) or _fields_of_angle(kind)).items():
                named[f"{name}_{label}_{number}"] = field_name, unit
        lines = []
        for variable, (field_name, unit) in named.items():
            value = float(constants[variable].start) if variable in constants else inf
            stated = fmu.unit_of(constants[variable]) if variable in constants else ""
            if stated and abs(value) < _LARGE:
                lines.append(f"{field_name} = {float(f'{value * unit_scale(unit, stated):.12g}')}")
        if lines:
            what = ", ".join(line.partition(" ")[0] for line in lines)
            self.proposal.reasons.append(f"{what} of {name} are what the FMU starts its drives with")
        return lines

    def _described_channels(self, kinds: dict[str, str]) -> dict[str, str]:
        """The inputs by the control channels as which they are named and described; adds to ``kinds`` of whom."""
        inputs = {variable.name: str(variable.description or "") for variable in self._inputs}
        controls = dict[str, str]()
        names = Counter(match[1] for match in map(_CHANNEL.match, inputs) if match)
        for name, count in names.items():
            for kind in ship.KINDS:
                channels = {c.name: c.meaning for c in ship.Actuator(name, kind).channels}
                called = {
                    channel: key for channel, meaning in channels.items()
                    for key in (channel, ship.order_channel_name(channel)) if inputs.get(key, "").endswith(meaning)
                }  # fmt: skip
                if called.keys() == channels.keys() and len(channels) == count:
                    kinds[name] = kind
                    controls |= called
                    self.proposal.reasons.append(f"{name} is of kind {kind}, as {', '.join(called.values())} say")
        return controls

    def _control_lines(self, actuators: ship.Actuators, controls: dict[str, str]) -> list[str]:
        lines = []
        for channel in ship.control_channels(actuators):
            key = f"control.{channel.name}"
            listed = "; ".join(_label_of(v) for v in self._inputs)
            name = self._answered(key) or controls.get(channel.name, "")
            name = name or self._ask(key, f"which input is it? {listed}")
            if not name:
                continue
            variable = self._variable(key, name)
            parts = _signal_lines(variable, self._unit(key, variable, channel.unit))
            if channel.unit == "deg":
                question = f"starboard or port, which is {variable.name} positive to? {channel.meaning}"
                stated = _SIDE.search(str(variable.description or ""))
                side = self._answered(f"{key}.positive") or (stated[1] if stated else "")
                side = side or self._ask(f"{key}.positive", question)
                parts.append(f'positive = "{side}"')
            lines.append(f"{channel.name} = {{ {', '.join(parts)} }}")
        return lines

    def wind_table(self) -> str:
        """The wind, if the FMU has any."""
        winds = [v for v in self._inputs if "wind" in words_of(v.name) | words_of(str(v.description or ""))]
        inputs = {
            name: self._variable(f"wind.{name}", answer)
            for form in simulator_map.WINDS.values() for name in form if (answer := self._answered(f"wind.{name}"))
        }  # fmt: skip
        for variable in winds if not inputs else ():
            words, unit = words_of(variable.name) | words_of(str(variable.description or "")), fmu.unit_of(variable)
            part = next((name for name in ("north", "east") if name in words), None)
            is_angle = unit in ("deg", "rad") or bool(words & {"direction", "dir", "angle", "from", "to"})
            is_angle = is_angle and not (unit and _is_unit_like(unit, "m/s"))
            inputs["direction" if is_angle and (unit or not part) else part or "speed"] = variable
        if not inputs:
            self.proposal.reasons.append(
                "no wind, as no input is called so; wind.direction=INPUT and so on if one is"
            )
            return ""
        lines = []
        for name, variable in inputs.items():
            unit = self._unit(f"wind.{name}", variable, "deg" if name == "direction" else "m/s")
            parts = _signal_lines(variable, unit)
            self.proposal.reasons.append(f"wind.{name} is the input {_label_of(variable)}")
            if name == "direction":
                questions = {"convention": "from or to", "zero": "north or east", "positive": "starboard or port",
                             "frame": "true, relative or apparent"}  # fmt: skip
                answers = {key: self._stated_of_wind(variable, key) or self._ask(f"wind.direction.{key}", text)
                           for key, text in questions.items()}  # fmt: skip
                parts += [f'{key} = "{value}"' for key, value in answers.items()]
            lines.append(f"{name} = {{ {', '.join(parts)} }}")
        return "[wind]\n" + "\n".join(lines) + "\n"

    def _stated_of_wind(self, variable: Any, key: str) -> str:
        """What the description of a wind direction says, unless the answer is given."""
        return "" if f"wind.direction.{key}" in self.answers else _stated(variable, _WIND_SAYS[key])

    def _extra_accelerations(self) -> dict[str, str]:
        """The inputs for what the simulator lacks per mass, by axis; none unless there is one for each."""
        units = {"surge": "m/s2", "sway": "m/s2", "yaw": "rad/s2"}
        inputs = {
            axis: [v.name for v in self._inputs
                   if v.unit == unit and {"extra", "acceleration", axis} <= words_of(v.name)]
            for axis, unit in units.items()
        }  # fmt: skip
        is_complete = all(len(names) == 1 for names in inputs.values())
        return {axis: names[0] for axis, names in inputs.items()} if is_complete else {}

    def acceleration_table(self) -> str:
        """The inputs for what the simulator lacks."""
        if not self._accelerations:
            return ""
        self.proposal.reasons.append(f"acceleration is set by {', '.join(self._accelerations.values())}")
        lines = [f"{axis} = {json.dumps(name)}" for axis, name in self._accelerations.items()]
        return "\n".join(["[acceleration]", *lines, ""])

    def parameter_table(self) -> str:
        """Drives that are switched off: the controls of recordings are what drives report, not orders."""
        switches = [v.name for v in self._description.modelVariables if v.type == "Boolean"]
        if _DRIVES not in switches:
            return ""
        self.proposal.reasons.append(f"{_DRIVES} = false, as the controls of recordings are what drives report")
        return f"[parameters]\n{_DRIVES} = false\n"

    def solver_table(self) -> str:
        """How runs begin."""
        own = [v.name for v in self._parameters
               if {"longest", "step", "integration"} <= words_of(str(v.description or "").lower())]  # fmt: skip
        missing = [name for name, start in self._starts.items() if not start]
        if missing:
            self.proposal.reasons.append(
                f'solver.start = "run_in", as nothing starts {", ".join(missing)}; state.NAME.start=PARAMETER if so'
            )
            return '[solver]\nstart = "run_in"\n'
        if len(own) == 1:
            self.proposal.reasons.append(f"solver.own_step is {own[0]}: set as vessel files are integrated")
            return f"[solver]\nown_step = {json.dumps(own[0])}\n"
        fixed_s, experiment = self._co_simulation.fixedInternalStepSize, self._description.defaultExperiment
        why = "as the FMU says"
        if not (fixed_s or self._co_simulation.canHandleVariableCommunicationStepSize) and experiment is not None:
            fixed_s, why = experiment.stepSize, "the step of its experiment, as it takes no other"
        if fixed_s:
            self.proposal.reasons.append(f"solver.fixed_step_s = {float(fixed_s):g}, {why}")
            return f"[solver]\nfixed_step_s = {float(fixed_s):g}\n"
        return ""


def _stated(variable: Any, says: Mapping[str, str]) -> str:
    """The one convention of which a variable's description has the words; empty for none and several."""
    text = str(variable.description or "").lower()
    stated = [value for pattern, value in says.items() if re.search(pattern, text)]
    return stated[0] if len(stated) == 1 else ""


def _fields_of_angle(kind: str) -> dict[str, tuple[str, str]]:
    """As :data:`_DRIVE_FIELDS`, of an angle, whose gear has a name in each kind."""
    rate, lag = KINDS[kind].gear or ("rate_limit_dps", "lag_s")
    limit = {"limit": ("limit_deg", "deg")} if "limit_deg" in KINDS[kind].entry.__dataclass_fields__ else {}
    return {**limit, "rate": (rate, "deg/s"), "lag_s": (lag, "s")}


def _signal_lines(variable: Any, unit: str) -> list[str]:
    """Variable and unit, as a map has them."""
    return [f"variable = {json.dumps(variable.name)}", f'unit = "{unit}"']


def _is_unit_like(unit: str, like: str) -> bool:
    """Whether a unit measures what ``like`` does, as far as it is known."""
    if not unit:
        return True
    try:
        unit_scale(like, unit)
    except ConfigurationError:
        return False
    return True


def _label_of(variable: Any) -> str:
    """A variable by name, unit and description."""
    unit = f" [{variable.unit}]" if variable.unit else ""
    return f"{variable.name}{unit}" + (f" ({variable.description})" if variable.description else "")
