"""The manoeuvre that a diagnosis asks for, made by the other ship, and the diagnosis of both together."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isnan

import pandas as pd

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid.diagnosis.planning import MINUTES, CandidateManoeuvre, candidates_of_ship, shafts_of, usual_rpm
from seatrial.hybrid.diagnosis.verdict import TOLERANCE
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.simulation.manoeuvres import Leg, Manoeuvre
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.workflows import DiagnosisRun, diagnose_tables
from tests.benchmarks.diagnosis.design import Design, Hidden, simulated
from tests.benchmarks.other_ship.programmes import HOLD, STEER, TURN, ZIGZAG, Order

_ANOTHER_DAY = pd.Timedelta(days=1)
_ANOTHER_SEED = 50_000_000


def with_next_manoeuvre(
    design: Design, hidden: Hidden, table: pd.DataFrame, examined: DiagnosisRun, vessel: Vessel
) -> DiagnosisRun:
    """The diagnosis of the recording and of the manoeuvre that it asked for, the same hidden in both."""
    asked = examined.diagnosis.next_manoeuvre
    assert asked is not None
    orders = orders_of(candidate_of(asked.what, examined, vessel).legs)
    later = replace(design, seed=design.seed + _ANOTHER_SEED, duration_s=60.0 * MINUTES)
    second, _ = simulated(later, hidden, orders=orders)
    return diagnose_tables([table, second.set_axis(second.index + _ANOTHER_DAY)], vessel, TOLERANCE, CATALOGUE)


def candidate_of(what: str, examined: DiagnosisRun, vessel: Vessel) -> CandidateManoeuvre:
    """The candidate of the repertoire that is asked for in these words."""
    for each in candidates_of_ship(
        shafts_of(vessel, usual_rpm(examined.conclusion.accepted.evidence.equations.log))
    ):
        if what.startswith(each.what):
            return each
    raise ConfigurationError(f"no candidate reads {what!r}")


def orders_of(legs: Manoeuvre) -> tuple[Order, ...]:
    """A manoeuvre in the orders of the other simulator; swings that follow each other are one zigzag."""
    orders: list[Order] = []
    course_deg = 0.0
    for leg in legs:
        if not isnan(leg.course_deg):
            course_deg = leg.course_deg
        order = _order(leg, course_deg)
        last = orders[-1] if orders else None
        if (
            last is not None
            and order.kind == ZIGZAG
            and last.kind == ZIGZAG
            and order.course_deg == last.course_deg
        ):
            orders[-1] = replace(last, switches=last.switches + 1.0, seconds=last.seconds + order.seconds)
        else:
            orders.append(order)
    return tuple(orders)


def _order(leg: Leg, course_deg: float) -> Order:
    rpm, angle, own = leg.rpm, leg.helm_deg, leg.orders
    order = Order(
        HOLD, own.get("port_rpm", rpm), own.get("starboard_rpm", rpm), own.get("port_angle_deg", angle),
        own.get("starboard_angle_deg", angle), own.get("tunnel_rpm", 0.0), course_deg, seconds=leg.at_most_s,
    )  # fmt: skip
    if not isnan(leg.course_deg):
        return replace(order, kind=STEER)
    if not isnan(leg.deviation_deg):
        swing = abs(order.port_deg)
        return replace(
            order, kind=ZIGZAG, port_deg=swing, starboard_deg=swing, turn_deg=abs(leg.deviation_deg), switches=1.0
        )
    if not isnan(leg.turn_deg):
        return replace(order, kind=TURN, turn_deg=leg.turn_deg, seconds=min(leg.at_most_s, 600.0))
    if order.seconds == inf:
        raise ConfigurationError("a leg without an end")
    return order
