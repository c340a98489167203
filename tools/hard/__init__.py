"""Hard water: simulated campaigns that test a diagnosis. No code is shared with rovid.

A vehicle moves in surge, sway and yaw through waves, gusts and eddies; rotors, an autopilot or a person drive it;
compass, gyro and DVL measure with errors. A campaign has one hidden cause or none. `draw` makes a campaign from a
seed, `write_campaign` writes the files of a user to a folder, and `look` computes how visible the hidden cause is.
"""

from tools.hard.campaign import Campaign, draw
from tools.hard.causes import EFFECTS
from tools.hard.oracle import look
from tools.hard.vehicles import VEHICLES
from tools.hard.writing import write_campaign

__all__ = ["EFFECTS", "VEHICLES", "Campaign", "draw", "look", "write_campaign"]
