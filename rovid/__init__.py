"""rovid: from an underwater vehicle's trial logs to a dynamic model its owner can defend."""

__version__ = "0.3.0"
