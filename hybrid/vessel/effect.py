"""What an effect is: a name, parameters with a neutral value, and a function from plant to plant.

Parameters are what people read: polar for what has a direction, a depth, a factor. Estimation wants numbers
that are zero where the effect is absent and smooth there; an effect's *free coordinates* are those, and
``free`` and ``values`` translate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import atan2, cos, degrees, hypot, inf, isnan, log2, radians, sin
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

from seatrial.acquisition.core.errors import ConfigurationError

if TYPE_CHECKING:
    from seatrial.hybrid.vessel.black_box import BlackBox
    from seatrial.hybrid.vessel.plant import Plant

FAMILIES = ("inertia", "hull", "propulsion", "alignment", "environment", "clock", "sensor")
"""The families of the catalogue, in the order in which they are listed."""

Kind = Literal["physics", "actuator", "sensor"]
Chart = Literal["linear", "polar", "inverse_square"]
Scope = Literal["ship", "day", "recording"]
Values = Mapping[str, float]
_ROUNDING = 1e-12
Change = Callable[["Plant", Values], "Plant"]
AnyModel = TypeVar("AnyModel", bound="Plant | BlackBox")


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect: its unit, neutral value, bounds (inclusive) and sizes.

    ``typical`` is an ordinary value, and the prior: before any data the free coordinate is thought to be
    normal about zero, where the effect is absent, with that of ``typical`` as its standard deviation.
    ``smallest`` is the smallest departure from neutral that anybody would care about. ``tolerance`` is the
    standard deviation of an error that every such sensor or drive has anyway: the effect is one only where
    it exceeds that. Zero for physics. All in the parameter's unit.
    """

    name: str
    unit: str
    neutral: float
    low: float
    high: float
    typical: float
    smallest: float
    tolerance: float = 0.0


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect that a model may lack.

    ``change`` gets a plant and a value for every parameter, never all neutral, and returns the plant with
    the effect in it; it must tend to no change as the values tend to neutral. ``chart`` says how parameters
    become free coordinates: ``linear`` (value - neutral), ``polar`` (size and direction in degrees become
    two components) or ``inverse_square`` (1 / value^2, for what is absent at infinity and tends to it so).
    ``confused_with`` names the effects that look much the same in many trials; of two such effects one names the
    other in the files, and each in a catalogue. ``scope`` says whose it is: the ship's, the same in all its
    recordings; the day's, as wind and sea are; or that of a recording, as clocks and sensors are. ``excluded_by``
    are the declarations of a trial's context that each rule it out, such as ``still water``.
    """

    name: str
    family: str
    kind: Kind
    what: str
    source: str
    parameters: tuple[Parameter, ...]
    change: Change
    chart: Chart = "linear"
    confused_with: tuple[str, ...] = ()
    scope: Scope = "ship"
    excluded_by: tuple[str, ...] = ()

    @property
    def base(self) -> str:
        """The name in the catalogue."""
        return self.name

    def coordinates_by_piece(self, free: Sequence[float]) -> list[tuple[float, ...]]:
        """Free coordinates by parts of a trial: an effect that stays as it is has one."""
        return [tuple(free)]

    @property
    def neutral_values(self) -> dict[str, float]:
        """The values at which the effect is not there."""
        return {parameter.name: parameter.neutral for parameter in self.parameters}

    @property
    def typical_values(self) -> dict[str, float]:
        """Values of an ordinary size."""
        return {parameter.name: parameter.typical for parameter in self.parameters}

    def apply(self, plant: AnyModel, values: Values) -> AnyModel:
        """``plant``, or a simulator, with this effect at ``values``; parameters left out are neutral.

        At neutral values it is the same plant. Raises :class:`ConfigurationError` for a name that is no
        parameter or a value out of bounds.
        """
        complete = self.complete_values(values)
        if self.is_absent(complete):
            return plant
        return cast("AnyModel", self.change(cast("Plant", plant), complete))  # a simulator has its numbers, too

    def is_absent(self, values: Values) -> bool:
        """Whether the values mean that the effect is not there."""
        deciding = self.parameters[:1] if self.chart == "polar" else self.parameters
        return all(values[parameter.name] == parameter.neutral for parameter in deciding)

    def complete_values(self, values: Values) -> dict[str, float]:
        """``values`` completed with neutral ones, or :class:`ConfigurationError` saying what is possible."""
        names = [parameter.name for parameter in self.parameters]
        unknown = [name for name in values if name not in names]
        if unknown:
            raise ConfigurationError(
                f"effect {self.name} has no parameter {', '.join(unknown)}", fix=f"it has {', '.join(names)}"
            )
        complete = {**self.neutral_values, **{name: float(value) for name, value in values.items()}}
        for parameter in self.parameters:
            value = complete[parameter.name]
            if isnan(value) or not parameter.low <= value <= parameter.high:
                raise ConfigurationError(
                    f"effect {self.name}: {parameter.name} = {value:g} is out of bounds",
                    # factors have the unit 1
                    fix=f"give {parameter.low:g} to {parameter.high:g} {parameter.unit}".removesuffix(" 1"),
                )
        return complete

    def free_coordinates(self, values: Values) -> tuple[float, ...]:
        """Free coordinates of ``values``: zero where the effect is absent."""
        complete = {**self.neutral_values, **values}
        numbers = [complete[parameter.name] for parameter in self.parameters]
        if self.chart == "polar":
            size, direction_deg = numbers
            return size * cos(radians(direction_deg)), size * sin(radians(direction_deg))
        if self.chart == "inverse_square":
            return tuple(1.0 / number**2 for number in numbers)
        return tuple(number - parameter.neutral for number, parameter in zip(numbers, self.parameters, strict=True))

    def values_at(self, free: Sequence[float]) -> dict[str, float]:
        """The inverse of :meth:`free_coordinates`."""
        names = [parameter.name for parameter in self.parameters]
        if self.chart == "polar":
            along, across = free
            return {names[0]: hypot(along, across), names[1]: degrees(atan2(across, along)) % 360.0}
        if self.chart == "inverse_square":
            return {name: number**-0.5 if number > 0.0 else inf for name, number in zip(names, free, strict=True)}
        return {p.name: p.neutral + number for p, number in zip(self.parameters, free, strict=True)}

    def nearest_within_bounds(self, free: Sequence[float]) -> tuple[float, ...]:
        """The nearest free coordinates whose values are in bounds."""
        if self.chart == "polar":
            within = self.parameters[0].high * (1.0 - _ROUNDING)  # which the size of the components must be, too
            share = min(1.0, within / max(hypot(*free), 1e-300))
            return tuple(share * number for number in free)
        ends = [
            sorted(self.free_coordinates({p.name: end})[i] for end in (p.low, p.high))
            for i, p in enumerate(self.parameters)
        ]
        return tuple(min(max(number, low), high) for number, (low, high) in zip(free, ends, strict=True))

    @property
    def free_scale(self) -> tuple[float, ...]:
        """The ordinary size of each free coordinate: the standard deviation of its prior."""
        if self.chart == "polar":
            return (self.parameters[0].typical,) * 2
        return tuple(abs(number) for number in self.free_coordinates(self.typical_values))

    @property
    def smallest_free(self) -> tuple[float, ...]:
        """The smallest size of interest in each free coordinate."""
        first = self.parameters[0]
        if self.chart == "polar":
            return (first.smallest,) * 2
        if self.chart == "inverse_square":
            return self.free_coordinates({parameter.name: parameter.smallest for parameter in self.parameters})
        return tuple(parameter.smallest for parameter in self.parameters)

    def as_dict(self) -> dict[str, Any]:
        """The effect as plain data, without its function; infinite numbers become ``None``."""
        plain = {key: getattr(self, key) for key in ("name", "family", "kind", "scope", "what", "source")}
        parameters = [
            {key: None if value in (inf, -inf) else value for key, value in asdict(parameter).items()}
            for parameter in self.parameters
        ]
        return {**plain, "parameters": parameters, "confused_with": list(self.confused_with)}


DIRECTION = Parameter("direction_deg", "deg", 0.0, -360.0, 360.0, 60.0, 10.0)
"""The direction that something goes to, from true north; it alone makes no effect."""


def shift(plant: Plant, number: str, amount: float) -> Plant:
    """An amount added to a number of the plant, in degrees where that is an angle."""
    return plant.shifted(**{number: radians(amount) if "_rad" in number else amount})


def shifted(*numbers: str) -> Change:
    """The change that adds an effect's parameters to these numbers, each to its own."""

    def change(plant: Plant, values: Values) -> Plant:
        for number, amount in zip(numbers, values.values(), strict=True):
            plant = shift(plant, number, amount)
        return plant

    return change


def multiplied(*numbers: str) -> Change:
    """The change that multiplies these numbers by an effect's only parameter."""
    return lambda plant, values: plant.scaled(next(iter(values.values())), *numbers)


def scaling(
    name: str,
    family: str,
    numbers: Sequence[str] | Callable[[Plant], Sequence[str]],
    sizes: tuple[float, float],
    *,
    what: str,
    source: str,
    parameter: str = "factor",
    bounds: tuple[float, float] = (0.0, 5.0),
    confused_with: tuple[str, ...] = (),
    excluded_by: tuple[str, ...] = (),
) -> Effect:
    """An effect of physics that multiplies ``numbers`` of the plant, tables included, by one factor.

    ``numbers`` are their names, or tell them of a plant.
    ``sizes`` are its ordinary value and its smallest departure from one of interest.
    """

    def change(plant: Plant, values: Values) -> Plant:
        return plant.scaled(values[parameter], *(numbers(plant) if callable(numbers) else numbers))

    parameters = (Parameter(parameter, "1", 1.0, *bounds, *sizes),)
    return Effect(
        name, family, "physics", what, source, parameters, change, confused_with=confused_with,
        excluded_by=excluded_by,
    )  # fmt: skip


USUAL_LENGTH_M = 30.0
"""The length of a ship for which ordinary sizes of effects are stated; they scale with length by their unit."""

_POWERS = {
    "N": 3.0, "N m": 4.0, "m": 1.0, "m2": 2.0, "m/s": 0.5, "1/s": -0.5, "1/m": -1.0, "deg/s2": -1.0,
}  # fmt: skip


def scale_of(length_m: float) -> float:
    """How many times as long a ship is as the usual one, in powers of two: sizes are orders of magnitude."""
    return float(2.0 ** round(log2(length_m / USUAL_LENGTH_M)))


def froude_growth(unit: str, scale: float) -> float:
    """The factor of what is ordinary of a ``unit`` on a ship ``scale`` times as long, at the same Froude number."""
    return float(scale ** _POWERS.get(unit, 0.0))
