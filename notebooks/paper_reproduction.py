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
# as she was before she was lengthened predicts the ship as she is now, and a calibrator learns what is wrong with
# it. Every number here comes from trials simulated anew; the paper's own stand beside it.

# %% tags=["parameters"]
folder = "reproduction"  # what `seatrial reproduce table3 -o` wrote

# %%
import seatrial as st

show = st.reproduction_sections(folder)

# %% [markdown]
# ## Against what was published
#
# A reduction is one less the ratio of the calibrated error to the reference's. The paper judges seconds drawn at
# random from the sequences that it trained on; here whole sequences count that nothing was learned from.

# %%
show("cells", "shortfalls")

# %% [markdown]
# ## Table III

# %%
show("table")

# %% [markdown]
# ## The figures
#
# Drawn from the campaigns of the table's first seed. What each shows stands below it.

# %%
show("figures")
