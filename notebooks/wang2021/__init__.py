"""The results of Wang, Li et al. 2021 from scratch: its campaign, its Table III and its figures."""
