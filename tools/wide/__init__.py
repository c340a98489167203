"""Wide campaigns: vehicles over decades of size and time constant, and every effect of yaw in several laws.

The simulator shares no code with what it judges. `draw` makes a campaign from a seed and an index, `write_campaign`
writes what a user would have, `truth_of` what is true of it, and `after_refit` how far the hidden cause shows.
"""

from tools.wide.campaign import Campaign, draw
from tools.wide.causes import FORMS
from tools.wide.truth import after_refit, truth_of, visibility
from tools.wide.writing import write_campaign

__all__ = ["FORMS", "Campaign", "after_refit", "draw", "truth_of", "visibility", "write_campaign"]
