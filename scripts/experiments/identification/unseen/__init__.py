"""Generator of objects and scenes that identification has not seen, and the judgement of what it
makes of them.

A seed gives a shape of one of ten classes (`grammar`), its geometric symmetry (`likeness`), a scene
with it, or with something else in its place (`scenes`), and the verdict on an identification
(`judge`). Perception never learns the class of a shape.
"""
