"""Files that `rovid effect new` writes, with own_effect in place of the user's name."""
