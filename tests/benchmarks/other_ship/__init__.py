"""A second simulator of the ship, by other means: truths for judging the diagnosis blind.

A program that fits with the equations it is tested on proves little. Here are the published equations written
anew: velocities relative to the water as the state, hull forces as one matrix of monomials, Heun's method,
roll as a fourth degree of freedom, gusts, waves and drives of other kinds. Nothing of the package's own
physics is used, only the numbers of the vessel file. A trial that has nothing hidden still differs from the
reference model by the ship's heel, and on demand by a model error whose size is stated.
"""

from tests.benchmarks.other_ship.effects import EFFECTS
from tests.benchmarks.other_ship.outside import OUTSIDE
from tests.benchmarks.other_ship.programmes import PROGRAMMES
from tests.benchmarks.other_ship.sea import SEAS, Sea
from tests.benchmarks.other_ship.trial import make_trial

__all__ = ["EFFECTS", "OUTSIDE", "PROGRAMMES", "SEAS", "Sea", "make_trial"]
