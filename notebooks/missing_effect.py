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
from IPython.display import display

import seatrial as st

diagnosis, extras = st.load_diagnosis(folder)
show = st.sections("diagnosis.html", figures_folder, diagnosis=diagnosis, extras=extras)
display(show("verdict"))

# %% [markdown]
# ## Found
#
# The force that the model lacks, estimated through a filter that knows how noisy the sensors are and how the sea
# pushes, and averaged where the ship was alike: at one speed, one rate of turn, one wind. A missing effect leaves
# a pattern. Look for cells of one colour side by side, beyond the noise of their averages; single ones are chance.
# Sensors that contradict each other come first, as no effect explains them.

# %%
display(show("map", "consistency"))

# %% [markdown]
# ## Named
#
# Each effect of the catalogue leaves a pattern of its own: the model is linearised about the recorded motion, so
# that an effect's parameters and what they do to every measurement are one matrix. One is named only if it is no
# chance among all that were tried, if it predicts legs that were left out, and if it keeps its own form over
# speed, drift, turning and thrust. Look at the interval of its size, whether it is found in all parts of the
# recording, and at its rivals: two that these data cannot tell apart are named together.

# %%
display(show("effects", "unknown", "rivals", "suspects"))

# %% [markdown]
# ## Added
#
# The effects in the model, with the sizes that fit best together. The file is a vessel file like any other, for
# `st.vessel_check`, `st.predict` or another diagnosis.

# %%
display(show("added"))

# %% [markdown]
# ## Shown
#
# On windows that took no part in naming or fitting: other legs say what is missing and how much of it, and these
# judge. The floor is what noise alone would leave. Look how much of the gap between model and floor is closed, and
# not at the error itself: a small one may be all noise, a large one all sea.

# %%
display(show("gap", "calibrators"))

# %% [markdown]
# ## What that rests on
#
# What was taken for granted: if one of these is wrong, so may be the name.

# %%
display(show("granted"))
