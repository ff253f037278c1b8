"""The calibrator that adapts the reference model itself.

It combines three ideas: an observer runs over the seconds before the start and estimates the ship's motion and
the force that the model lacks (observer.py, gains.py); the model's parameters are adapted until predictions fit
the measured tracks, no further than the data justify (adaptation.py, fit.py); and the accuracy of each
predictor over the last seconds determines its weight (calibrator.py).
"""
