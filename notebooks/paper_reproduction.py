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
# # The paper's results, reproduced
#
# Wang, Li et al. 2021, *Incorporating Approximate Dynamics Into Data-Driven Calibrator*: a model of R/V Gunnerus
# as it was before it was lengthened predicts the ship as it is now, and a calibrator learns what is wrong with
# it. Every number here comes from trials simulated anew; the paper's own stand beside it. The first half goes
# through the method on a small campaign, step by step; the second shows what `seatrial reproduce table3` made of
# fifteen whole ones.

# %% tags=["parameters"]
folder = "reproduction"  # what `seatrial reproduce table3 -o` wrote
sea_state = "gentle"  # of the small campaign
sequences = 12

# %%
import numpy as np
import pandas as pd
from IPython.display import display

import seatrial as st
from seatrial.hybrid.calibrators import make_calibrator
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import score, simulate_reference
from seatrial.hybrid.prediction.window_sets import draw_groups
from seatrial.notebooks.wang2021.campaign import MODEL, TRUTH, paper_campaign

# %% [markdown]
# ## The problem
#
# The ship was lengthened by 5 m. Its model was not: it knows the hull of before, from tank tests that nobody will
# repeat. Both turn with the same azimuth, but not alike.

# %%
circles = {name: st.vessel_check(name).of_kind("turning_circle")[0].indices for name in (MODEL, TRUTH)}
names = ("advance_m", "tactical_diameter_m")
display(
    pd.DataFrame({ship: {name: indices[name].value for name in names} for ship, indices in circles.items()}).round(
        1
    )
)

# %% [markdown]
# ## The data, and the windows that are held
#
# The truth sails zigzags in wind, waves and current, at 20 Hz and with the noise of its sensors. From the swings
# sequences of 30 s are drawn in which the thrusters are held: a prediction through a new order would be judged by
# the order. `control` is what is held, `start` the state at second 0, `track` what was measured then, second by
# second, and `past` the minute before, which a method may know. No second of a sequence lies in another one, nor
# in its past: a sequence that is left out is unseen to the last second.

# %%
campaign = paper_campaign(sea_state, seed=0, sequences=sequences)
windows = campaign.windows
speed_mps = np.hypot(windows.start[:, 3], windows.start[:, 4])
display(pd.DataFrame({"azimuth [deg]": campaign.azimuth_deg, "speed at the start [m/s]": speed_mps.round(1)}))

# %% [markdown]
# ## The approximate dynamics
#
# The old model simulates every sequence from its measured start, under the held controls and the measured wind.
# It knows nothing of waves and current. Its error grows with time; that it grows alike in all sequences, by the
# azimuth, is what a calibrator lives on.

# %%
plant = vessel_plant(st.load_vessel(MODEL))
tracks = simulate_reference(windows, plant)
error_m = score(tracks, windows.track).by_second
display(
    pd.Series({f"{second} s": error_m[second - 1] for second in (5, 10, 20, 30)}, name="mean error [m]").round(2)
)

# %% [markdown]
# ## The calibrator
#
# A calibrator sees the start and the approximate track and returns the track that is to be expected. The paper's
# is a network; `adaptive`, Seatrial's own, changes the coefficients of the model and estimates current and forces,
# which takes fewer sequences and no network. It learns from most sequences; some others end the training.

# %%
unseen = draw_groups(windows.leg, 0.25, seed=0)
stopping = np.zeros(len(windows), dtype=bool)
stopping[~unseen] = draw_groups(windows.leg[~unseen], 0.25, seed=0)
training = ~unseen & ~stopping
calibrator = make_calibrator("adaptive", 0, plant).fit(
    (windows.subset(training), tracks[training]), (windows.subset(stopping), tracks[stopping])
)

# %% [markdown]
# ## The validation
#
# On the sequences that were left out whole. The paper draws its test seconds at random from all sequences, so that
# those just before and after were learned from: the two splits stand side by side in the table below. With few
# sequences the gain is uncertain; the table's intervals draw whole sequences, with replacement.

# %%
judged = windows.subset(unseen)
predicted = {"reference": tracks[unseen], "hybrid": calibrator.predict(judged, tracks[unseen])}
errors = {name: score(track, judged.track) for name, track in predicted.items()}
rows = {name: [error.mean_distance_m, error.end_distance_m] for name, error in errors.items()}
display(pd.DataFrame(rows, index=["on average [m]", "at the end [m]"]).round(2))

# %% [markdown]
# ## Against what was published
#
# Now the whole campaigns. A reduction is one less the ratio of the calibrated error to the reference's. *Floor* is
# the true ship from the same measurements, *perfect start* the true ship from the true state, *waves only* all but
# the waves: no method is to be blamed for what lies below these.

# %%
show = st.reproduction_sections(folder)
display(show("cells", "shortfalls"))

# %% [markdown]
# ## Table III
#
# Look first at the reference's row, which says how wrong the model is, then at *gap closed*: how much of what can
# be removed is removed. A method whose random split is far better than its unseen sequences has learned the
# sequences, not the ship.

# %%
display(show("table"))

# %% [markdown]
# ## The figures
#
# Drawn from the campaigns of the table's first seed: the campaign and one sequence of it, then the error that is
# to be learned, then what is left of it. What to look for stands below each.

# %%
display(show("figures", only=("figure_04_tracks", "figure_05_channels")))

# %% [markdown]
# ### What is to be learned

# %%
display(show("figures", only=("figure_06_reference", "figure_07_errors")))

# %% [markdown]
# ### What is left

# %%
display(show("figures", only=("figure_09_predictions", "figure_10_distribution")))
