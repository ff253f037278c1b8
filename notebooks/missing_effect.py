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
beside: dict[str, str] = {}  # pages to link to, by what they are
figures_folder = "figures"

# %%
from hybrid.report import story_sections as story
from hybrid.report.show import links, shown_in

told = story.load_story(folder)
show = shown_in(figures_folder)
show(story.add_question, told)

# %%
links(beside)

# %% [markdown]
# ## Found
#
# The force that the model lacks, estimated through a filter that knows how noisy the sensors are and how the sea
# pushes, and averaged where the ship was alike: at one speed, one rate of turn, one wind. A missing effect leaves
# a pattern.

# %%
show(story.add_found, told)

# %% [markdown]
# ## Named
#
# Each effect of the catalogue leaves a pattern of its own. One is named only if it is no chance among all that
# were tried, if it predicts legs that were left out, and if it keeps its own form over speed, drift, turning and
# thrust.

# %%
show(story.add_named, told)

# %% [markdown]
# ## Added

# %%
show(story.add_added, told)

# %% [markdown]
# ## Shown
#
# On windows that took no part in naming or fitting: other legs say what is missing and how much of it, and these
# judge.

# %%
show(story.add_shown, told)

# %% [markdown]
# ## What that rests on

# %%
show(story.add_granted, told)
