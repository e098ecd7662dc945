"""Pages, pictures and recordings of what the verbs return.

`report` is the HTML page, `tour` the rerun recording of a diagnosis; `scene` shows a model in motion, `portrait` the
friction of a plant. `figure` draws the curves of them all.
"""
