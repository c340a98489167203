"""Hard water: simulated campaigns to judge a diagnosis by. Shares nothing with what it judges.

A vehicle moves in surge, sway and yaw through waves, gusts and eddies; rotors, an autopilot or a person drive it;
compass, gyro and DVL look at it with their faults. One cause is hidden in it, or none. `draw` makes a campaign from a
seed, `write_campaign` puts into a folder what a user would have, `look` says how far the hidden cause shows.
"""

from tools.hard.campaign import Campaign, draw
from tools.hard.causes import EFFECTS
from tools.hard.oracle import look
from tools.hard.vehicles import VEHICLES
from tools.hard.writing import write_campaign

__all__ = ["EFFECTS", "VEHICLES", "Campaign", "draw", "look", "write_campaign"]
