"""The words of the page of results."""

HEAD = """# Diagnosis benchmark: how often hidden effects are named correctly

```
make benchmark-diagnosis SIZE={size}
python -m tests.benchmarks.diagnosis_trials -o results.jsonl --size {size} --page docs/diagnosis_benchmark.md
```

simulates trials with hidden effects, diagnoses each from its 13 channels alone, and compares the result with the
truth. This page is written by that command: size `{size}`, {cases} of its {whole} cases
(the last table says which are none; `--only` and `--every` select cases, `--done` writes the page from existing
results), {version}, catalogue version {catalogue} with {effects} effects, tolerance 1 %.
In brackets: the counts and the exact 95 % interval (Clopper and Pearson 1934) in percent.
The same with measured data: [effects hidden in measured data](hidden_in_measured.md)."""

ABOUT = """Errors of parameters are divided by the bound: the standard error of a joint fit of the hidden effects
with everything else known. For an estimator that attains the bound the quartiles are 0.32, 0.67 and
1.15, the root mean square is 1. The gap is the mean distance between tracks predicted over 15 s and
measured ones, on held-out legs."""

GROUPS_ARE = """## The trials

Ship, sea and sensors come from an independent simulator (`tests/benchmarks/other_ship`), with forces
programmed from the published model, and its own integrator, drives, gusts, waves and heel. One
single in ten is simulated by the simulator that the diagnosis uses, for comparison.

- **nothing**: seas from calm to rough, five programmes; the model exact, or with errors of its coefficients or
  in the form of a polynomial; usual and doubled sensor noise, correlated noise, 1 % outliers, 3 % gaps, 1 to 10
  Hz. The simulator's percentage is of the root mean square of the thrusters' forces, which is less than their
  range: 1.3 % brings the error to about the tolerance of 1 % of the range, 2 % beyond it.
- **singles**: each effect of the catalogue at 1.2, 2 and 4 times the limit predicted for a trial of that kind,
  the size that nine of ten such trials show. Sign and direction are drawn. An effect whose limit is beyond five
  times its ordinary size, or whose size would be out of bounds, cannot be identified by that trial and is not a
  case. If another effect of free size differs by less than 9 in twice the log likelihood, the trial cannot
  distinguish the two, and only the reported set is scored.
- **singles, the model off**: each effect at 3 times its limit with a model error of about the tolerance, in
  coefficients or as a polynomial. Intervals allow for this error; if the model is exact they are wider than
  necessary.
- **pairs**, **triples**: effects of different families, each at 2 to 4 times its limit given the others; drawn
  among those that keep a quarter of their information when the others are unknown, and that no other effect
  imitates.
- **outside**: forces that no effect of the catalogue describes, at 3 times the size at which nine of ten trials
  show a remainder. That size follows from the gain of the most significant family of remainders in a trial with
  this force alone: minus its expectation by chance, the gain grows with the square of the size. A thrust that
  fades while the side force of the pods stays is counted separately: it is a loss of thrust that changes with
  time, together with a growing side force.
- **without**: an effect at 3 times its limit that the analyst's catalogue lacks. Silently misnamed means
  verdict `named` with an effect that is not there; `unknown` and `indistinguishable` warn that it may be
  another. Two effects often add up to the missing one, such as losses of thrust at port and starboard: then no
  data can tell.
- **cannot tell**: effects at 3 times their limit in trials of one heading, of one speed with turns, of both,
  and of zigzags with both thrusters always alike; cases are those in which another effect of free size differs
  by less than 4 in twice the log likelihood. If a manoeuvre is proposed, the same ship sails it on another day,
  and both recordings are diagnosed: resolved means that the hidden effect is named alone and without rivals."""
