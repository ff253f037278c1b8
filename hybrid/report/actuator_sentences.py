"""The effects of a ship's actuators in words: each kind by its own noun, one of them, a pair, or all of a kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from acquisition.core.actuators import Actuators, names_of
from hybrid.vessel.actuators import KINDS

_SEVERAL = {"both": "Both", "all": "All"}


@dataclass(frozen=True, slots=True)
class _Subject:
    """The subject of a sentence: ``The rudder``, ``The port propeller``, ``Both jets``."""

    which: str
    noun: str
    several: bool
    kind: str

    @property
    def words(self) -> str:
        """The subject; a name that says its kind already does not say it twice."""
        return self.with_noun(self.noun)

    def with_noun(self, noun: str) -> str:
        """The subject by another noun, that of a part of it."""
        return self.which if noun in self.which else f"{self.which} {noun}"

    def after_of(self, noun: str) -> str:
        """The subject by a noun, within a sentence."""
        words = self.with_noun(noun)
        return words[0].lower() + words[1:]

    def does(self, one: str, many: str) -> str:
        """The subject with its verb, as one or as several do it."""
        return f"{self.words} {many if self.several else one}"


def actuator_texts(name: str, actuators: Actuators) -> tuple[str, ...]:
    """The texts for an effect of one actuator, of a pair, or of all of a kind; none for another effect.

    The second text, where there is one, is for less than neutral.
    """
    name = "thrust_loss_tunnel" if name == "tunnel_thrust_loss" else name
    for stem, texts in _TEXTS.items():
        if name.startswith(f"{stem}_"):
            subject = _subject(name, name.removeprefix(f"{stem}_"), actuators)
            return texts(subject) if subject else ()
    return ()


def _subject(effect: str, which: str, actuators: Actuators) -> _Subject | None:
    """Whom an effect is about, by what follows its stem: an actuator, or all of a kind."""
    one = next((each for each in actuators if each.name == which), None)
    if one is not None:
        return _Subject(f"The {which.replace('_', ' ')}", one.noun, False, one.kind)
    first, _, group = which.partition("_")
    member = next((each for each in actuators if effect in _effects_of(each.kind, actuators)), None)
    if first not in _SEVERAL or member is None:
        return None
    return _Subject(_SEVERAL[first], group or f"{member.noun}s", True, member.kind)


def _effects_of(kind: str, actuators: Actuators) -> set[str]:
    """The names of the effects of a ship's actuators of one kind."""
    return {each.name for each in KINDS[kind].effects(names_of(actuators, kind))}


def _loss(subject: _Subject) -> tuple[str, str]:
    force = {"tunnel": "side force", "rudder": "force"}.get(subject.kind, "thrust")
    whose = "their" if subject.several else "its"
    return (
        f"{subject.does('lacks', 'lack')} {{}} % of {whose} {force}",
        f"{subject.does('has', 'have')} {{}} % more {force} than the model's",
    )


def _rudder_offset(subject: _Subject) -> tuple[str, str]:
    reported = "the reported angles" if subject.several else "the reported angle"
    stands = subject.does("is truly", "are truly")
    return f"{stands} {{}} deg to starboard of {reported}", f"{stands} {{}} deg to port of {reported}"


def _beyond(noun: str) -> Callable[[_Subject], tuple[str]]:
    """An angle of thrust: positive is to starboard of what is reported, which astern turns the ship to port."""

    def texts(subject: _Subject) -> tuple[str]:
        if subject.several:
            return (f"The true angles of {subject.after_of(noun)}s are the reported angles plus {{}} deg",)
        return (f"The true angle of {subject.after_of(noun)} is the reported angle plus {{}} deg",)

    return texts


def _wake(subject: _Subject) -> tuple[str, str]:
    water = f"The water at {subject.after_of(subject.noun)} is {{}} %"
    return f"{water} slower than the model's: the hull's wake is larger", f"{water} faster than the model's"


def _astern(subject: _Subject) -> tuple[str, str]:
    gives = subject.does("gives", "give")
    return (
        f"{gives} {{}} % more thrust astern than the model's",
        f"{gives} {{}} % less thrust astern than the model's",
    )


def _more_or_less_of(one: str, many: str, what: str) -> Callable[[_Subject], tuple[str, str]]:
    """A share that is more or less than the model's, in per cent of ``what`` the share is of."""

    def texts(subject: _Subject) -> tuple[str, str]:
        of = what.format(whose="their" if subject.several else "its")
        does = subject.does(one, many)
        return f"{does} {{}} % more of {of} than the model's", f"{does} {{}} % less of {of} than the model's"

    return texts


def _speed_loss(subject: _Subject) -> tuple[str]:
    return (f"{subject.does('loses', 'lose')} half the side force at {{}} m/s ahead",)


def _lag(subject: _Subject) -> tuple[str]:
    return (f"{subject.does('follows', 'follow')} the recorded settings with a lag of {{}} s",)


def _play(subject: _Subject) -> tuple[str]:
    angles = "the reported and the true angles" if subject.several else "the reported and the true angle"
    return (f"{subject.does('has', 'have')} {{}} deg of backlash between {angles}",)


_TEXTS: dict[str, Callable[[_Subject], tuple[str, ...]]] = {
    "thrust_loss": _loss,
    "azimuth_offset": _beyond("azimuth"),
    "nozzle_offset": _beyond("nozzle"),
    "rudder_loss": _loss,
    "rudder_offset": _rudder_offset,
    "wake": _wake,
    "thrust_deduction": _more_or_less_of("loses", "lose", "{whose} thrust to the hull"),
    "rudder_interaction": _more_or_less_of("draws", "draw", "{whose} side force from the hull"),
    "flow_straightening": _more_or_less_of("meets", "meet", "the drift at the stern"),
    "astern_thrust": _astern,
    "speed_loss": _speed_loss,
    "backlash": _play,
    "lag": _lag,
}
"""Its texts by the effect's stem, which is followed by an actuator's name, ``both`` or ``all``."""
