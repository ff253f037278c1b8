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
vessel: str | None = None  # a vessel of trials/vessels or a vessel file; without it the calibrator's
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
from hybrid.report import ground_sections as ground
from hybrid.report import prediction_sections as prediction
from hybrid.report import story_sections
from hybrid.report import trial_sections as trial
from hybrid.report.case import load_case
from hybrid.report.show import links, shown_in

case = load_case(recordings, calibrator, vessel, horizon_s, part=part, repair=repair, allow_seen=allow_seen)
show = shown_in(figures_folder)
show(prediction.add_headline, case, remark)

# %%
show(story_sections.add_in_short, diagnosis)

# %%
pages = {} if interactive is None else trial.write_interactive_pages(case, interactive)
links({"how the diagnosis came to that": story, **pages})

# %% [markdown]
# ## Run sheet

# %%
show(trial.add_sheet, case)

# %% [markdown]
# ## Data quality
#
# Flags follow QARTOD: 1 good, 2 not evaluated, 3 suspect, 4 bad, 9 missing. What is certainly wrong is put right,
# or left out, before all that follows, and what was done is listed; the recording itself stays as it is.

# %%
show(trial.add_data_quality, case)

# %% [markdown]
# ## Where she went

# %%
show(trial.add_tracks, case)

# %% [markdown]
# ## What she did
#
# A prediction knows the motion, the wind and the thruster settings at its start, and goes on with both held. It
# is judged only where the thrusters were really held, which is shaded.

# %%
show(trial.add_time_series, case)

# %% [markdown]
# ## Manoeuvres

# %%
show(trial.add_indices, case)

# %% [markdown]
# ## How well her way was predicted

# %%
show(prediction.add_baselines, case)

# %%
show(prediction.add_by_second, case)

# %% [markdown]
# ### From many starts

# %%
show(prediction.add_fans, case)

# %% [markdown]
# ### Errors, and whether the regions hold what they say

# %%
show(prediction.add_distributions, case)

# %% [markdown]
# ## Where the model is off
#
# Acceleration measured, less what the model has at the same speeds, settings and wind. A model that lacks nothing
# is white everywhere but for noise.

# %%
show(ground.add_residual_maps, case)

# %% [markdown]
# ## On what ground: the range of the training

# %%
show(ground.add_coverage, case)

# %% [markdown]
# ## Parameters

# %%
show(ground.add_parameters, case)
