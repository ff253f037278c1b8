"""Effects that only a simulator of another make has: gains of its drives, and pushes on its hull per mass.

They stand for what cannot be asked inside it. A gain of a shaft looks as a loss of thrust does, drag as fouling or
a coefficient of the hull.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from seatrial.hybrid.vessel.actuators import KINDS, single_and_joint_effects
from seatrial.hybrid.vessel.black_box import BlackBox
from seatrial.hybrid.vessel.effect import Effect, Parameter, Values
from seatrial.hybrid.vessel.outside import DRAG, assumed_inertia

_GAIN = Parameter("factor", "1", 1.0, 0.5, 1.5, 1.05, 0.02, tolerance=0.002)
_GAINS = {"rps": "shaft", "rpm": "shaft", "pitch": "pitch", "angle": "angle"}
_AXES = {
    "surge": ("ahead", "towed load", "constant_X_n"),
    "sway": ("to starboard", "list or bent keel", "constant_Y_n"),
    "yaw": ("in yaw to starboard", "bent skeg or list", "constant_N_nm"),
}


def _add_push(model: BlackBox, values: Values, axis: int, force_name: str) -> BlackBox:
    """The simulator with a constant acceleration along an axis, degrees in yaw."""
    inertia = assumed_inertia(model.length_between_perpendiculars_m)[axis]
    (amount,) = values.values()
    return model.shifted(**{force_name: inertia * (np.deg2rad(amount) if axis == 2 else amount)})


def _push_effects() -> tuple[Effect, ...]:
    """A constant acceleration along each axis."""
    return tuple(
        Effect(
            f"{axis}_push", family="alignment" if axis != "surge" else "hull", kind="physics",
            what=f"A steady push {way}, as of a {cause}, per mass and added mass",
            source="Constant body force, the simplest form of what a hull or a tow may add",
            parameters=(
                Parameter("acceleration_dps2", "deg/s2", 0.0, -2.0, 2.0, 0.1, 0.02)
                if axis == "yaw"
                else Parameter("acceleration_mps2", "m/s2", 0.0, -0.3, 0.3, 0.008, 0.001),
            ),
            change=partial(_add_push, axis=place, force_name=force_name),  # type: ignore[arg-type]
            scope="day" if axis == "surge" else "ship",
        )
        for place, (axis, (way, cause, force_name)) in enumerate(_AXES.items())
    )  # fmt: skip


def _drag_effects() -> tuple[Effect, ...]:
    """Drag along each axis, more or less than the simulator has."""
    names = {
        "added_resistance": ("resistance to surge, by its square", (1e-3, 2e-4)),
        "added_sway_drag": ("resistance to sway, by sway times speed", (1e-2, 2e-3)),
        "added_yaw_drag": ("resistance to turning, by yaw rate times speed", (1e-2, 2e-3)),
    }
    return tuple(
        Effect(
            name, family="hull", kind="physics",
            what=f"More {words}, per mass and added mass; negative, less of it",
            source="The leading term of hull forces: ITTC resistance; Clarke et al., Trans. RINA 125 (1983)",
            parameters=(Parameter("drag_pm", "1/m", 0.0, -0.2, 0.2, *sizes),),
            change=lambda model, values, number=number: model.shifted(**{number: values["drag_pm"]}),  # type: ignore[misc]
            confused_with={"added_resistance": ("surge_push",)}.get(name, ()),
        )
        for number, (name, (words, sizes)) in zip(DRAG, names.items(), strict=True)
    )  # fmt: skip


BODY = (*_push_effects(), *_drag_effects())
"""Pushes on the hull, per mass."""


def gains(kind: str, names: tuple[str, ...]) -> tuple[Effect, ...]:
    """A gain of each control of the actuators of a kind, and of all alike; an azimuth's angle has one already."""
    labels = [label for label in KINDS[kind].labels if (kind, label) != ("azimuth", "angle")]
    return tuple(
        effect
        for label in labels
        for effect in single_and_joint_effects(
            f"{_GAINS[label]}_gain", names, lambda model, number, factor: model.scaled(factor, number),
            f"{label}_scale",
            family="alignment" if label == "angle" else "propulsion",
            what=f"The {_GAINS[label]} of the {{names}} acts as factor x the reported one",
            source="Gain of the feedback; a drive that gives more or less than the simulator has it give",
            parameter=_GAIN,
            joint_confused_with=("added_resistance", "surge_push") if label != "angle" and kind != "tunnel" else (),
            joint_word=kind if kind != "azimuth" else "",
        )
    )  # fmt: skip
