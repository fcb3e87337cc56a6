"""Experiments: many cases in worker processes, resumed after an interruption, summed up on a page.

Names are imported on first use: rows need pyarrow, which a single run does without.
"""

from uuv.sim.interfaces.lazy_names import names_of_stub

__getattr__, __dir__, __all__ = names_of_stub(__name__, __file__)
