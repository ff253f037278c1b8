"""The words of the page of results."""

HEAD = """# How well the diagnosis names what is hidden

```
make benchmark-diagnosis SIZE={size}
python -m tests.benchmarks.diagnosis_trials -o results.jsonl --size {size} --page docs/diagnosis_benchmark.md
```

simulates trials with effects hidden in them, has each diagnosed from its 13 channels alone, and compares what was
said with the truth afterwards. This page is written by that command: size `{size}`, {cases} of its {whole} cases
(`--only` and `--every` choose among them, `--done` writes the page of what is done), {version}, catalogue version
{catalogue} with {effects} effects, tolerance 1 %.
In brackets: how many of how many, and the exact 95 % interval (Clopper and Pearson 1934) in percent.
On measured data: [effects hidden in them](hidden_in_measured.md)."""

ABOUT = """Errors of parameters are divided by the standard error that a joint fit of what is truly hidden has,
all else known: the bound. Of an estimator that meets the bound the quartiles are 0.32, 0.67 and
1.15, the root mean square is 1. The gap is the mean distance of tracks predicted over 15 s from
measured ones, on legs that took no part."""

GROUPS_ARE = """## The trials

Ship, sea and sensors are those of a second simulator (`tests/benchmarks/other_ship`), with forces
written from the published model and its own integrator, drives, gusts and waves, and with heel. One
single in ten is simulated by the simulator that the diagnosis fits with, so that a difference
shows.

- **nothing**: seas from calm to rough, five programmes; the model exact, or off in the forms of coefficients or
  of a polynomial; sensor noise as usual and doubled, correlated noise, 1 % outliers, 3 % gaps, 1 to 10 Hz.
  The simulator's percentage is of the root mean square of the thrusters' forces, which is less than their range:
  1.3 % brings the error to about the tolerance of 1 % of the range, 2 % beyond it.
- **singles**: each effect of the catalogue at 1.2, 2 and 4 times the limit predicted for a trial of that kind,
  the size that nine of ten such trials show. Sign and direction are drawn. An effect whose limit is beyond five
  times its ordinary size, or whose size would be out of bounds, cannot be identified by that trial and is no
  case. Nor does a name count that a trial of that kind cannot give: where another effect of free size differs
  by less than 9 in twice the log likelihood, only the reported set is judged.
- **singles, the model off**: each effect at 3 times its limit where the model is off by about the tolerance, in the
  forms of coefficients or of a polynomial. Intervals are as wide as this error takes; where the model is exact
  they are wider than they need be, which nobody aboard can know.
- **pairs**, **triples**: effects of different families, each at 2 to 4 times its limit given the others; drawn
  among those that keep a quarter of their information when the others are unknown, and that nothing imitates.
- **outside**: what no effect of the catalogue describes, at 3 times the size at which nine of ten trials show
  that something remains. That size follows from the gain of the family of remainders that stands out most in a
  trial where it is alone, beside whatever the search names there: less what chance gives, the gain grows with
  the square of the size. A thrust that fades while the side force of the pods stays is counted by itself: it is a
  loss of thrust that drifts, and a side force that grows against it.
- **without**: an effect at 3 times its limit that the analyst's catalogue lacks. Silently misnamed is what is
  `named` and is not there; beside it stand `unknown` and `indistinguishable`, which say that it may be another.
  Two effects often make up one that is lacking, a loss of thrust at port and one at starboard that at both: then
  no data tell.
- **cannot tell**: effects at 3 times their limit in trials of one heading, of one speed with turns, of both,
  and of zigzags with both thrusters always alike; cases are those in which another effect of free size differs
  by less than 4 in twice the log likelihood. Where a manoeuvre is proposed, the same ship makes it another day,
  and both recordings are diagnosed: resolved means the hidden effect named, alone and without rivals."""
