# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Trial validation
#
# What one trial, or several, say about a ship, and about a simulation model and a calibrator on top of it: the
# sections of the report that `seatrial report` writes, one by one.

# %% tags=["parameters"]
recordings: list[str] = []  # MCAP files
calibrator: str | None = None  # the folder that `seatrial train` wrote
method: str | None = None  # the code of a calibrator of your own, FILE.py:CLASS
vessel: str | None = None  # a vessel or its file; without it the calibrator's, else the recordings'
horizon_s: int | None = None  # how far is predicted; without it what the calibrator does, or 15 s
time_range = "0..100"  # of each recording's time in percent, where predictions are judged
repair = True  # put right before what is certainly wrong
allow_seen = False  # also recordings that the calibrator was trained on
length_m: float | None = None  # of the ship between perpendiculars, where no vessel file says it
diagnosis: str | None = None  # what `seatrial diagnose` wrote of these recordings
figures_folder = "figures"  # every figure as SVG and PDF, its numbers as JSON

# %%
import pandas as pd
from IPython.display import display

import seatrial as st
from seatrial.hybrid.report.trial_form import INDEX_HEADER, index_tables

case = st.load_case(
    recordings, calibrator, vessel, horizon_s, time_range=time_range, repair=repair, allow_seen=allow_seen,
    length_m=length_m, method=method,
)  # fmt: skip
show = st.sections("trial.html", figures_folder, case=case, remark="", folder=diagnosis, links={})

# %% [markdown]
# ## The trial
#
# Whose ship, in what loading, water and weather, on which course: without these no figure below can be compared
# with a contract or with another day. What nobody recorded is said once.

# %%
display(show("cover"))

# %% [markdown]
# ## The indices of manoeuvrability
#
# Every turning circle, zigzag and stop is found by its helm and shafts, and measured from the order on, as the
# standards count. Look at the interval first: it holds what sensors, waves and an unknown moment of the order leave
# open, so that a limit inside it is neither met nor missed.

# %%
display(show("indices"))

# %% [markdown]
# ## Track and channels
#
# Look for what no ship does: jumps of the track, speeds that stand still, a rate of turn without a helm.

# %%
display(show("figures"))

# %% [markdown]
# ## The model by its predictions
#
# A prediction knows the motion, the wind and the thruster settings at its start, and goes on with both held. It
# is judged only where the thrusters were really held, so that the error is the model's and not the next order's.
# The baseline is constant velocity: a model that is no better than that adds nothing over this time. Look whether
# the error grows with time (a wrong start) or with its square (a wrong force), and to which side. With a
# calibrator, the hybrid is the model after what it learned on other recordings; its regions hold 95 % if they are
# honest.

# %%
display(show("model", "diagnosis"))

# %% [markdown]
# ## The model by what a yard asks
#
# The same indices from the model, in two ways. *Predicted*: the test sailed anew in still air, at the same
# approach speed, helm and helm rate. *Replayed*: the recorded controls and wind from the state at the order. If
# the replay agrees and the prediction does not, weather or the way in which the test was sailed are the reason;
# if both are off to the same side, it is the model. A star marks what lies outside the measured interval.

# %%
if not case.obstacle:
    for title, lines in index_tables(case.indices):
        display(title, pd.DataFrame(lines, columns=INDEX_HEADER))

# %% [markdown]
# ## The data
#
# What was found in the channels and repaired before. A doubt about a sensor is a doubt about all that rests on it.

# %%
display(show("data"))

# %% [markdown]
# ## Where the model is off
#
# The acceleration measured less what the model has at the same speeds, settings and wind, by what might cause it:
# a pattern over the drift angle speaks of the hull, over the wind's direction of the wind, over a shaft's speed of
# its propeller. Then on what ground: the range of the training, and what an adaptive calibrator has learned.

# %%
display(show("methods"))
