"""Does anything that stands in a file, or happens to a disk or a process, make rovid lose, hang, leak or break?

Run ``python -m benchmarks.torture --seed 1 --inputs 1000000 --jobs 2 --state build/torture.jsonl``. Small files of
every format, mutated and cut, go through the commands that read them; the same state file takes up a run that was
ended, and ``--only csv:init:4711`` does one input again. ``python -m benchmarks.torture.faults`` kills commands, fills
disks and lets commands meet.
"""
