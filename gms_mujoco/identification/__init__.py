"""What a fit is made of: observations, the misfit and its derivatives, starts, noise, intervals, screening.

`observe` makes observations of records, FRFs and runs of a servo; `inverse` is the torque that a plant needs along a
measured motion, given what its `readings` show of it, where it is at `rest`, and what lies `between_samples`. A fit
begins at `starts` and `rough`, goes down the `misfit` by `least_squares`, and ends in `refine`; `noise` is what a
perfect model would leave, `screen` and `held_out` what an effect could still explain.
"""
