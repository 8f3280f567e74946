"""Inputs and readings, artifacts and digests, claims and verdicts, report; knows no physics."""
