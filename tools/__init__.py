"""Tools that are run from the checkout: an independent simulator of trial days, and converters of logs.

Nothing here imports rovid, so that what rovid finds can be checked against a truth it has no part in.
"""
