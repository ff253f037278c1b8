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
# What one trial, or several, say about a simulation model and a calibrator on top of it: first whether the data
# can be trusted, then what the ship did, then how well her way was predicted, where it was not, and on what
# ground.

# %% tags=["parameters"]
recordings: list[str] = []  # MCAP files
calibrator: str | None = None  # the folder that `seatrial train` wrote
vessel: str | None = None  # a vessel or its file; without it the calibrator's, else the recordings'
horizon_s: int | None = None  # how far is predicted; without it what the calibrator does, or 15 s
part = "0..100"  # of each recording's time in percent, where predictions are judged
repair = True  # put right before what is certainly wrong
allow_seen = False  # also recordings that the calibrator was trained on
diagnosis: str | None = None  # what `seatrial diagnose` wrote of these recordings
story: str | None = None  # the report on it, to link to
remark = ""  # something to say at the top
interactive: str | None = None  # the folder for a page to zoom into
figures_folder = "figures"  # every figure as SVG and PDF, its numbers as JSON

# %%
import seatrial as st

case = st.load_case(recordings, calibrator, vessel, horizon_s, part=part, repair=repair, allow_seen=allow_seen)
show = st.sections("trial.html", figures_folder, case=case, remark=remark)
show("headline")

# %%
st.sections("diagnosis.html", figures_folder)("in_short", folder=diagnosis)

# %%
pages = {} if interactive is None else st.write_interactive_pages(case, interactive)
st.links({"how the diagnosis came to that": story, **pages})

# %% [markdown]
# ## Run sheet

# %%
show("sheet")

# %% [markdown]
# ## Data quality
#
# Flags follow QARTOD: 1 good, 2 not evaluated, 3 suspect, 4 bad, 9 missing. What is certainly wrong is put right,
# or left out, before all that follows, and what was done is listed; the recording itself stays as it is.

# %%
show("data_quality")

# %% [markdown]
# ## Where she went

# %%
show("tracks")

# %% [markdown]
# ## What she did
#
# A prediction knows the motion, the wind and the thruster settings at its start, and goes on with both held. It
# is judged only where the thrusters were really held, which is shaded.

# %%
show("time_series")

# %% [markdown]
# ## Manoeuvres

# %%
show("indices")

# %% [markdown]
# ## How well her way was predicted

# %%
show("baselines")

# %%
show("by_second")

# %% [markdown]
# ### From many starts

# %%
show("fans")

# %% [markdown]
# ### Errors, and whether the regions hold what they say

# %%
show("distributions")

# %% [markdown]
# ## Where the model is off
#
# Acceleration measured, less what the model has at the same speeds, settings and wind. A model that lacks nothing
# is white everywhere but for noise.

# %%
show("residual_maps")

# %% [markdown]
# ## On what ground: the range of the training

# %%
show("coverage")

# %% [markdown]
# ## Parameters

# %%
show("parameters")
