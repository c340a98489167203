"""Campaigns of vehicles that move in surge, sway and yaw together.

The simulator shares no code with what it judges. `draw` makes a campaign from a seed and an index, `write_campaign`
writes what a user would have, and `truth_of` what is true of it.
"""

from tools.planar.campaign import Campaign, draw, simulated
from tools.planar.causes import FORMS
from tools.planar.truth import truth_of
from tools.planar.vehicles import FAMILIES
from tools.planar.writing import write_campaign

__all__ = ["FAMILIES", "FORMS", "Campaign", "draw", "simulated", "truth_of", "write_campaign"]
