"""How logs become Records: columns, units, time stamps, counts of an encoder, joints of a robot."""
