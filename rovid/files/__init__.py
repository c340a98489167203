"""Everything that rovid writes goes through here: nothing foreign is replaced, nothing is half written or lost."""

from rovid.files.claim import Claim, Output
from rovid.files.folders import settle
from rovid.files.form import Form

__all__ = ["Claim", "Form", "Output", "settle"]
