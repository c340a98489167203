"""Diagnosis of many campaigns, each in a process of its own, summarised in a table and on a page."""
