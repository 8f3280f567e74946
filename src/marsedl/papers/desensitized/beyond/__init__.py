"""Designs that the paper gives up: beyond what it prints."""
