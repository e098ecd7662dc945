"""The search for what is missing: joint fits, what they are judged by, and what no effect of the catalogue is.

`paths` is the whole of a search, in order; `search` adds one effect after another, or two at once (`pairs`), by the
`joint_fits` that `judgement` lets pass beside other `trials`, and goes on from other `openings` where no tangent leads;
`steps` is what comes of it, and `recheck` looks again at what was found. `friction_law` and `friction_shape` ask
whether the friction of the axis is what it was taken for, `given_inertia`, `given_load` and `given_setup` whether what
the user said of it can be; `beyond` holds effects against causes that are none, and `remainder` describes what is left.
At the end `conclusion` makes `findings` of it all, with what `unfitted` records alone show.
"""
