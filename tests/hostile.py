"""Names that steer terminals, spoil files and break parsers."""

from __future__ import annotations

import re

from tests.whole.test_bad_input import assert_one_message, folder  # noqa: F401 - a fixture

# What a terminal must never get from a name.
STEERING = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
# All of them can stand in rovid.toml; the last few are called as parts of a target's file are.
NAMES = (
    "\x1b[31mred\x1b[0m",
    "\x1b]0;title\x07",
    "\x9b2J",
    "\0",
    "\x7f\x08\r\n\t",
    "\u202etxt.exe",
    "\ufffe",
    "😀 ü 前",
    "[red]bold[/red] :smile:",
    '=HYPERLINK("http://x","y")',
    "+1;=2,@3",
    "'single' \"double\" `",
    '"""',
    "-->--]]>&<a/>",
    "</script><!--",
    "${1+1} $(arg x)",
    "\\",
    "\\x1b",
    "{0}%s\\n#",
    "a b",
    "a_b",
    "a_b_2",
    "1",
    "base",
    "bias_torque",
    "x" * 200,
)
