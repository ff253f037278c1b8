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
# # What the model lacks, and how that is known
#
# A simulation and a trial disagree. This is the story of what was found: where they disagree, which physical
# effect would explain it, what the model is with it, and whether it then predicts what it had not seen. It may
# also end with nothing missing, with something that has no name here, or with two names that these data cannot
# tell apart.

# %% tags=["parameters"]
folder = "diagnosis"  # what `seatrial diagnose -o` wrote
figures_folder = "figures"

# %%
import seatrial as st

diagnosis, extras = st.load_diagnosis(folder)
show = st.sections("diagnosis.html", figures_folder, diagnosis=diagnosis, extras=extras)
show("verdict")

# %% [markdown]
# ## Found
#
# The force that the model lacks, estimated through a filter that knows how noisy the sensors are and how the sea
# pushes, and averaged where the ship was alike: at one speed, one rate of turn, one wind. A missing effect leaves
# a pattern.

# %%
show("map", "consistency")

# %% [markdown]
# ## Named
#
# Each effect of the catalogue leaves a pattern of its own. One is named only if it is no chance among all that
# were tried, if it predicts legs that were left out, and if it keeps its own form over speed, drift, turning and
# thrust.

# %%
show("effects", "unknown", "rivals", "suspects")

# %% [markdown]
# ## Added

# %%
show("added")

# %% [markdown]
# ## Shown
#
# On windows that took no part in naming or fitting: other legs say what is missing and how much of it, and these
# judge.

# %%
show("gap", "calibrators")

# %% [markdown]
# ## What that rests on

# %%
show("granted")
