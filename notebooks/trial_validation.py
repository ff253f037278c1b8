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
part = "0..100"  # of each recording's time in percent, where predictions are judged
repair = True  # put right before what is certainly wrong
allow_seen = False  # also recordings that the calibrator was trained on
length_m: float | None = None  # of the ship between perpendiculars, where no vessel file says it
diagnosis: str | None = None  # what `seatrial diagnose` wrote of these recordings
figures_folder = "figures"  # every figure as SVG and PDF, its numbers as JSON

# %%
import seatrial as st

case = st.load_case(
    recordings, calibrator, vessel, horizon_s, part=part, repair=repair, allow_seen=allow_seen, length_m=length_m,
    method=method,
)  # fmt: skip
show = st.sections("trial.html", figures_folder, case=case, remark="", folder=diagnosis, pages={})
show("cover")

# %%
show("indices")

# %%
show("figures")

# %% [markdown]
# A prediction knows the motion, the wind and the thruster settings at its start, and goes on with both held. It
# is judged only where the thrusters were really held.

# %%
show("model", "diagnosis")

# %%
show("data")

# %% [markdown]
# Where the model is off: acceleration measured, less what the model has at the same speeds, settings and wind; on
# what ground: the range of the training; and what an adaptive calibrator has learned.

# %%
show("methods")
