"""How logs become Records: columns, units, time stamps, counts of an encoder, joints of a robot.

`record_files` leads from an entry of `dataset.toml` to Records, `measured_axis` from its table [axis] to the axis;
`plausible` looks at what was read and asks whether it can be what it says.
"""
