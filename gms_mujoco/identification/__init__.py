"""What a fit is made of: observations, the misfit and its derivatives, starts, noise, intervals, screening."""
