"""Everything that rovid writes goes through here: nothing foreign is replaced, nothing is half written or lost."""

from rovid.ground.files.claim import Claim, Content, Output
from rovid.ground.files.folders import settle
from rovid.ground.files.form import Form

__all__ = ["Claim", "Content", "Form", "Output", "settle"]
