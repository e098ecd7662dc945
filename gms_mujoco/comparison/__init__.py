"""Where a plant and measurements disagree, as data that report, pictures and recordings show.

`residuals` has all views of the torque, `servo_residuals` those of a servo's position, `compare_frf` those of a
response; `score` says what an error is of.
"""
