"""The calibrator that adapts the reference model itself.

Three ideas, each of them plain: an observer follows the seconds before the start with the model and infers how the
ship moves and what force the model lacks (observer.py, gains.py); the model's own numbers are adapted until
predictions meet the tracks that were measured, no further than the data demand (adaptation.py, fit.py); and what
each way of predicting would have been worth in the seconds just past decides how far it is trusted (calibrator.py).
"""
