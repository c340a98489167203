"""Other tools that fit the same motion to the same log, each a script of its own that imports nothing of rovid's."""
